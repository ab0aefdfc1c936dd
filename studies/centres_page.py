"""The section of the page that says why the paper needs more centres: three tables, a figure, what is settled."""

from collections.abc import Iterator, Sequence
from math import inf
from pathlib import Path

from matplotlib.figure import Figure

from sdm_deflect.cases.report.pictures import write_png
from studies.centres import ACCURACIES, FACTORS
from studies.centres_findings import findings
from studies.files import COLOURS
from studies.measure import GROWN
from studies.paper import paper
from studies.sections import Page
from studies.trends import among, title
from studies.trials import CASES, GMRES, TOLERANCE, Trials, cell, factors, of, row_name

TITLE = "Why fewer centres suffice here"
PICTURE = "centres.png"


def why(page: Page) -> str:
    """Return the section."""
    assert page.reasons is not None
    trials = page.reasons.trials
    return "\n\n".join(
        [
            f"## {TITLE}",
            f"The paper's rule ends here with {_ratios(page)} times as many centres as there. The paper does not "
            "describe its unit of length, its boxes and its GMRES, so one thing was changed at a time (`python -m "
            f"studies reasons`, scale `{page.reasons.scale}`): the rows are the paper's, with its initial centres and "
            "its M_add, and the numbers are centres in the end.",
            f"### The tolerance by the size of the model\n\n{_tolerance_words(trials)}",
            _tolerance(trials),
            f"![Centres against the factor by which the tolerance is divided, for the rows of tables 1, 3 and 4; "
            f"circles mark where the paper's number is reached.](figures/{PICTURE})",
            "### One thing changed, with the paper's tolerance",
            _changes(trials),
            "### GMRES that stops early",
            "The residual is that at which GMRES stops, by the norm of the right-hand side, lengths in metres; in the "
            f'last rows it stops after some iterations, or at {ACCURACIES[-1]:g}. "Stuck": the sites that are still '
            "off by more than the tolerance are centres already, or it took twice the paper's iterations.",
            _solver(trials),
            "### What is settled, and what is not",
            "\n".join(f"- {line}" for line in findings(page)),
            "All numbers: [reasons.json](tables/reasons.json).",
        ]
    )


def _ratios(page: Page) -> str:
    pairs = [
        (ours.centers, theirs.centers)
        for result in page.results.values()
        for ours, theirs in zip(result.by(GROWN), result.table.rows, strict=True)
    ]
    found = [ours / theirs for ours, theirs in pairs]
    return f"{min(found):.2f} to {max(found):.2f}"


def _table(heads: Sequence[str], rows: Iterator[list[str]]) -> str:
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _tolerance(trials: Trials) -> str:
    found = factors(trials)

    def rows() -> Iterator[list[str]]:
        for key, factor in found.items():
            own = [one for one in of(trials, TOLERANCE) if (one.table, one.angle, one.columns) == key]
            text = f"{factor:.1f}" if factor < inf else "none"
            yield [row_name(own[0]), str(own[0].theirs), *(cell(one) for one in own), text]

    heads = ["8e-5 m divided by", "paper", *(f"{factor:g}" for factor in FACTORS), "paper's number at"]
    return _table(heads, rows())


def _tolerance_words(trials: Trials) -> str:
    tail = among(paper().tables["table4"].rows, "z")[0]
    return (
        "A displacement and a tolerance that are both so many times larger give the same centres, so dividing the "
        "tolerance is the same as a larger model. The last column is interpolated: the factor with which a row has the "
        f"paper's number. The tail's rows end at {tail.centers} centres, where the paper's errors are "
        + ", ".join(f"{row.max_error:.1e}" for row in paper().tables["table4"].rows)
        + " in x, y, z."
    )


def _changes(trials: Trials) -> str:
    kept = [one for one in trials if one.change not in ("tolerance", GMRES)]

    def rows() -> Iterator[list[str]]:
        for change, value in dict.fromkeys((one.change, one.value) for one in kept):
            own = {(one.table, one.columns): one for one in kept if (one.change, one.value) == (change, value)}
            cells = [own.get((table, d)) for table in ("table1", "table4") for d in "xyz"]
            yield [f"{change} {value}".strip(), *("" if one is None else cell(one) for one in cells)]

    heads = ["", *(f"{CASES[table]} f_{d}" for table in ("table1", "table4") for d in "xyz")]
    return _table(heads, rows())


def _solver(trials: Trials) -> str:
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
    crossings = factors(trials)
    for axes, (table, case) in zip(figure.subplots(1, 3, sharey=True), CASES.items(), strict=True):
        for key, crossing in crossings.items():
            if key[0] == table:
                own = [one for one in of(trials, TOLERANCE, table) if (one.angle, one.columns) == key[1:]]
                style = "--" if key[1] == -30.0 else "-"
                label = f"${title(key[2])}$" + (f" at {key[1]:+g} deg" if table == "table3" else "")
                x, y = [one.factor for one in own], [one.centers for one in own]
                axes.loglog(x, y, style, marker=".", color=COLOURS[key[2]], label=label)
                if crossing < inf:
                    axes.plot(crossing, own[0].theirs, "o", color=COLOURS[key[2]], mec="black", ms=8)
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
