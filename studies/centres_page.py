"""Tables and picture of the adaptations in which one thing was changed."""

from collections.abc import Iterator, Sequence
from math import inf
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdm_deflect.cases.report.pictures import write_png
from studies.centres import FACTORS
from studies.files import COLOURS
from studies.paper import paper
from studies.trends import title
from studies.trials import CASES, GMRES, TOLERANCE, Trials, cell, factors, of, row_name

PICTURE = "centres.png"


def _table(heads: Sequence[str], rows: Iterator[list[str]]) -> str:
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def tolerance(trials: Trials) -> str:
    """Return the table of centres by the factor that divides the tolerance."""
    found = factors(trials)

    def rows() -> Iterator[list[str]]:
        for key, factor in found.items():
            own = [one for one in of(trials, TOLERANCE) if (one.table, one.angle, one.columns) == key]
            text = f"{factor:.1f}" if factor < inf else "none"
            yield [row_name(own[0]), str(own[0].theirs), *(cell(one) for one in own), text]

    heads = ["8e-5 m divided by", "paper", *(f"{factor:g}" for factor in FACTORS), "paper's number at"]
    return _table(heads, rows())


def changes(trials: Trials) -> str:
    """Return the table of centres by what else was changed."""
    kept = [one for one in trials if one.change not in ("tolerance", GMRES)]

    def rows() -> Iterator[list[str]]:
        for change, value in dict.fromkeys((one.change, one.value) for one in kept):
            own = {(one.table, one.columns): one for one in kept if (one.change, one.value) == (change, value)}
            cells = [own.get((table, d)) for table in ("table1", "table4") for d in "xyz"]
            yield [f"{change} {value}".strip(), *("" if one is None else cell(one) for one in cells)]

    heads = ["", *(f"{CASES[table]} f_{d}" for table in ("table1", "table4") for d in "xyz")]
    return _table(heads, rows())


def solver(trials: Trials) -> str:
    """Return the table of centres by where GMRES was stopped."""
    runs = of(trials, GMRES)
    angles = {one.table: one.angle for one in runs}

    def rows() -> Iterator[list[str]]:
        for factor, value, columns in dict.fromkeys((one.factor, one.value, one.columns) for one in runs):
            own = {one.table: one for one in runs if (one.factor, one.value, one.columns) == (factor, value, columns)}
            limit = value if value.endswith("iterations") else f"residual {value}"
            yield [
                f"{title(columns)}, 8e-5 m / {factor:g}",
                limit,
                *(cell(own[table]) if table in own else "" for table in CASES),
            ]

    return _table(["", "GMRES", *(f"{CASES[one]} {angles[one]:+g}°" for one in CASES)], rows())


def draw(trials: Trials, path: Path) -> None:
    """Draw centres against the factor."""
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    for axes, (table, case) in zip(figure.subplots(1, 3, sharey=True), CASES.items(), strict=True):
        _curves(axes, trials, table)
        if table == "table4":
            axes.axhline(paper().tables[table].max_centers, color="0.3", lw=1, ls=":", label="limit")
        axes.set_title(case, fontsize="medium")
        axes.set_xticks(FACTORS, [f"{factor:g}" for factor in FACTORS])
        axes.minorticks_off()
        axes.set_xlabel("tolerance divided by")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="x-small")
    figure.axes[0].set_ylabel("centres")
    write_png(figure, path)


def _curves(axes: Axes, trials: Trials, table: str) -> None:
    """Draw the rows of a table of the paper, with a circle where the paper's number is reached."""
    for key, crossing in factors(trials).items():
        if key[0] != table:
            continue
        own = [one for one in of(trials, TOLERANCE, table) if (one.angle, one.columns) == key[1:]]
        style = "--" if key[1] == -30.0 else "-"
        label = f"${title(key[2])}$" + (f" at {key[1]:+g} deg" if table == "table3" else "")
        x, y = [one.factor for one in own], [one.centers for one in own]
        axes.loglog(x, y, style, marker=".", color=COLOURS[key[2]], label=label)
        if crossing < inf:
            axes.plot(crossing, own[0].theirs, "o", color=COLOURS[key[2]], mec="black", ms=8)
