"""The tables and sentences of docs/paper.md that quote figures, as Markdown: `python -m studies page` writes them."""

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from studies.centres import CHOICES, FACTORS, GMRES, NOTHING, SOLVERS, TOLERANCE
from studies.files import read_rows
from studies.paper import Row, Size, paper
from studies.trends import Verdict, mv_over_squv, three_digits, title

Numbers = dict[str, Any]
# Sections of the page that have a table of trends, by the tables and figures of the paper that they are about.
SECTIONS = (
    ("table1", "figure2"), ("table2",), ("figure3",), ("table3",), ("figure4",), ("figure5",), ("table4",),
    ("figure7",), ("timings",),
)  # fmt: skip
# Widths of the columns of trends, in per cent.
WIDTHS, ALL_WIDTHS = "40 6 54", "6 76 18"
# Heads of iterations and centres at the end.
ENDS = ("t_end paper", "here", "N_c,end paper", "here")
# Changes of centres.csv that the page shows.
CHANGES = (
    (NOTHING, ""), ("margins", "x 0.25, zero sites as far apart"),
    ("margins", "x 0.25, the paper's number of zero sites"), ("distance of zero sites", "x 0.5"),
    ("fuselage panel", "does not move"), ("fuselage panel", "rough by 0.1 mm"), ("fuselage panel", "rough by 0.2 mm"),
    ("fuselage panel", "of facets of 9 deg"),
)  # fmt: skip
# Adaptations for which it shows them.
CHANGED = (("table1", "x"), ("table1", "z"), ("table4", "x"), ("table4", "y"), ("table4", "z"))
# Adaptations for which it shows what a smaller tolerance does.
TOLERANCES = (
    ("aileron, small hexahedron -12°, f_z", "table1", "z", "-12"), ("Chimera block -12°, f_z", "table3", "z", "-12"),
    ("Chimera block -30°, f_z", "table3", "z", "-30"), ("tail +12°, f_x", "table4", "x", "12"),
    ("tail +12°, f_z", "table4", "z", "12"),
)  # fmt: skip


def blocks(tables: Path, numbers: Numbers) -> Iterator[str]:
    """Yield the blocks of the page, each of which ends with a line break, by the files in `tables`."""
    trends = [Verdict(**one) for one in numbers["trends"]]
    hold = sum(one.holds for one in trends)
    yield f"Of {len(trends)} trends that the paper states, {hold} hold here and {len(trends) - hold} do not.\n"
    yield _in_one_table(trends)
    yield _times(tables)
    yield _meshes(numbers)
    yield from (_sites(name, numbers) for name in ("table1", "table3", "table4"))
    yield _table1(tables)
    yield _table2(tables)
    yield _table3(tables)
    yield _table4(tables)
    for section in SECTIONS:
        own = [trend for trend in trends if trend.table in section]
        lines = (trend.line(before) for before, trend in pairwise([None, *own]) if trend)
        yield _of_widths(WIDTHS, _markdown(("the paper says", "", "measured here"), "---", lines))
    yield from (_repaired(one) for one in numbers["counted"] if one["repair"] == "auto" and one["strategy"] == "squv")
    yield from (_checks(number, numbers) for number in (5, 8))
    yield _counts(numbers)
    yield _timings(numbers)
    trials = Trials(tables / "centres.csv")
    yield from (trials.changes(), trials.tolerances(), trials.solvers())


def _in_one_table(trends: Sequence[Verdict]) -> str:
    """Return a table of all trends: whether each holds here, and the part of the page that says more."""
    lines = [_row((one.sign, one.sentence, f"[{_spaced(one.table)}](#{one.table})")) for one in trends]
    return _of_widths(ALL_WIDTHS, _markdown(("", "the paper says", "of"), "---", lines))


def _times(tables: Path) -> str:
    """Say which sentence about a cost is judged by seconds alone, and what the pairs are."""
    ours = read_rows(tables / "table1.csv", "grown")
    theirs, own = (_range(mv_over_squv(rows, "pairs")) for rows in (paper().tables["table1"].rows, ours))
    return (
        "A sentence about cost holds here only if seconds and pairs agree, as they do in the paper's own rows. One is "
        "judged by seconds alone: that MV takes more than twice the time of SQUV. A pair of MV serves all three "
        f"directions, so MV has {theirs} of the pairs of SQUV in the paper's rows, and {own} in ours.\n"
    )


def _range(values: Sequence[float]) -> str:
    return " to ".join(dict.fromkeys(f"{end:.2f}" for end in (min(values), max(values))))


def _spaced(name: str) -> str:
    """Return the name of a table or figure in words: ``table 1``. It is the name of a target of the page, too."""
    return re.sub(r"(\d)", r" \1", name)


def _of_widths(widths: str, table: str) -> str:
    """Return a table whose columns have widths in per cent: long texts would leave numbers no room."""
    return f":::{{table}}\n:widths: {widths}\n\n{table}\n:::\n"


def _markdown(heads: Sequence[str], marks: str, lines: Iterable[str]) -> str:
    """Return a table; `marks` has the alignment of each column, or one for all."""
    every = marks.split() if " " in marks else [marks] * len(heads)
    return "\n".join([_row(heads), _row(every), *lines, ""])


def _row(cells: Iterable[object]) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def _meshes(numbers: Numbers) -> str:
    names = {"full model": "aileron", "Chimera block": "aileron-chimera"}
    pairs = [(what, Size(**numbers["sizes"][name]), paper().size(name)) for what, name in names.items()]
    lines = [
        _row((what, f"{own.points:,}", f"{theirs.points:,}", f"{own.cells:,}", f"{theirs.cells:,}"))
        for what, own, theirs in pairs
    ]
    heads = ("", "points here", "in the paper", "tetrahedra here", "in the paper")
    return _markdown(heads, "--- ---: ---: ---: ---:", lines)


def _sites(name: str, numbers: Numbers) -> str:
    """Say how many sites a table has, and how far they go."""
    ground, theirs = numbers["grounds"][name], paper().size(paper().tables[name].case)
    own = Size(**ground["size"])
    moved = " and ".join(
        f"{', '.join(f'{most:.3g}' for most in one.values())} mm at {float(angle):+g}°"
        for angle, one in ground["largest_mm"].items()
    )
    return (
        f"Here are {_at(own)}. The paper has {_at(theirs)}. The largest prescribed displacement in x, y and z is "
        f"{moved}.\n"
    )


def _at(size: Size) -> str:
    zero = size.zero_sites
    text = f"{zero[0]:,}" if len({*zero}) == 1 else f"{zero[0]:,}, {zero[1]:,} and {zero[2]:,} (x, y, z)"
    return f"{size.surface:,} sites on the surface and {text} at zero"


def _costs(theirs: Row, grown: Row, timed: Row) -> tuple[str, ...]:
    """Return the cells of cost: seconds, the paper's and ours, and millions of pairs."""
    costs = (theirs.seconds, timed.seconds, theirs.pairs / 1e6, grown.pairs / 1e6)
    return tuple(map(three_digits, costs))


def _cost_heads(loop: str) -> tuple[str, ...]:
    return "seconds paper", f"{loop} here", "million pairs paper", "here"


def _beside(tables: Path, name: str, loop: str) -> list[tuple[Row, Row, Row]]:
    """Return the rows of a table: the paper's, those of "grown", and those of the loop that is timed."""
    path = tables / f"{name}.csv"
    return [*zip(paper().tables[name].rows, read_rows(path, "grown"), read_rows(path, loop), strict=True)]


def _ends(theirs: Row, own: Row) -> tuple[int, ...]:
    return theirs.iterations, own.iterations, theirs.centers, own.centers


def _table1(tables: Path) -> str:
    lines = [
        _row((title(a.setting.columns), "{}+{}".format(*a.setting.initial), *_ends(a, b), *_costs(a, b, c)))
        for a, b, c in _beside(tables, "table1", "gmres")
    ]
    return _markdown(("", "initial", *ENDS, *_cost_heads("gmres")), "--- ---" + " ---:" * 8, lines)


def _table2(tables: Path) -> str:
    lines = [
        _row((a.setting.n_add, *_ends(a, b), f"{round(100 * (b.centers / a.centers - 1)):+d} %", *_costs(a, b, c)))
        for a, b, c in _beside(tables, "table2", "gmres")
    ]
    return _markdown(("M_add", *ENDS, "differs by", *_cost_heads("gmres")), "---:", lines)


def _table3(tables: Path) -> str:
    lines = [
        _row((f"{title(a.setting.columns)} at {a.setting.angle:+g}°", *_ends(a, b), *_costs(a, b, c)))
        for a, b, c in _beside(tables, "table3", "grown")
    ]
    return _markdown(("", *ENDS, *_cost_heads("grown")), "---" + " ---:" * 8, lines)


def _table4(tables: Path) -> str:
    lines = [
        _row((title(a.setting.columns), *_ends(a, b), f"{a.max_error:.2e}", f"{b.max_error:.2e}", *_costs(a, b, c)))
        for a, b, c in _beside(tables, "table4", "grown")
    ]
    heads = ("", *ENDS, "max error paper, m", "here", *_cost_heads("grown"))
    return _markdown(heads, "---" + " ---:" * 10, lines)


def _repaired(counted: Numbers) -> str:
    theirs, (_, least) = counted["statement"], counted["least"]
    return (
        f"With the repair of `sdm run` the smallest of them at {theirs['angle']:+g}° is {least:.3f}; below "
        f"{theirs['below']:g}: {counted['near_after']:,}.\n"
    )


def _checks(figure: int, numbers: Numbers) -> str:
    """Return the checks of `sdm run` of what the paper judges by eye in a figure."""
    lines = [
        _row((f"`{one['name']}`", f"{one['angle']:+g}°", f"{one['value']:.2g} {one['unit']}", one["where"]))
        for one in numbers["seen"]
        if one["figure"] == figure and one["value"] is not None
    ]
    return _markdown(("check", "at", "found", "over"), "--- --- ---: ---", lines)


def _counts(numbers: Numbers) -> str:
    words = {
        "stay": "nodes that stay where the aileron meets the wing", "follow": "nodes of the trailing edge that follow",
        "gaps": "largest displacement in z, by the gap's width", "edges": "the same, by the median edge of cells there",
        "tail": "nodes of the tail", "panel": "nodes of the panel beside it",
    }  # fmt: skip
    lines = [
        _row((f"`{own['case']}` at {own['angle']:+g}°", text, *map(three_digits, (getattr(theirs, name), own[name]))))
        for theirs, own in zip(paper().counts, numbers["counts"], strict=True)
        for name, text in words.items() if getattr(theirs, name) is not None
    ]  # fmt: skip
    return _markdown(("case", "", "paper", "here"), "--- --- ---: ---:", lines)


def _timings(numbers: Numbers) -> str:
    lines = []
    for theirs, own in zip(paper().evaluations, numbers["evaluations"], strict=True):
        paper_s = (theirs.filter_seconds, theirs.inside_seconds, theirs.whole_seconds)
        own_s = (own["filter_seconds"], own["inside_seconds"], own["whole_seconds"])
        lines += [
            _row((theirs.case, "paper", theirs.centers, theirs.inside, *(f"{one:.3g}" for one in paper_s))),
            _row((theirs.case, "here", own["centers"], own["inside"], *(f"{one:.3g}" for one in own_s))),
        ]
    heads = ("case", "", "N_c", "points inside", "filter, s", "evaluation inside, s", "on the whole mesh, s")
    return _markdown(heads, "--- --- ---: ---: ---: ---: ---:", lines)


class Trials:
    """The trials of centres.csv: cells of the tables that say why the paper needs more centres."""

    def __init__(self, path: Path) -> None:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [*csv.DictReader(file)]
        names = ("change", "value", "table", "columns", "angle_deg")
        self.rows = {tuple(row[name] for name in names): row for row in rows}

    def cell(self, change: str, value: str, table: str, columns: str, angle: str = "") -> str:
        """Return what came of a trial, at the table's first angle unless one is given; "" if there was none."""
        first = paper().tables[table].rows[0].setting.angle
        row = self.rows.get((change, value, table, columns, angle or f"{first:g}"))
        return _ended(row) if row else ""

    def paper_centres(self, *key: str) -> str:
        """Return the paper's number of centres, by table, direction, and perhaps the angle."""
        return next(row["paper"] for own, row in self.rows.items() if own[2 : 2 + len(key)] == key)

    def changes(self) -> str:
        """Return the table of what was changed."""
        lines = [_row(("the paper", *(self.paper_centres(*one) for one in CHANGED)))]
        lines += [_row((" ".join(own).strip(), *(self.cell(*own, *one) for one in CHANGED))) for own in CHANGES]
        return _markdown(("", "aileron f_x", "f_z", "tail f_x", "f_y", "f_z"), "---" + " ---:" * 5, lines)

    def tolerances(self) -> str:
        """Return the table of smaller tolerances."""
        values = [f"/ {factor:g}" for factor in FACTORS]
        lines = [
            _row((words, self.paper_centres(*key), *(self.cell(TOLERANCE, value, *key) for value in values)))
            for words, *key in TOLERANCES
        ]
        heads = ("8e-5 m divided by", "paper", *(f"{factor:g}" for factor in FACTORS))
        return _markdown(heads, "---" + " ---:" * (1 + len(FACTORS)), lines)

    def solvers(self) -> str:
        """Return the table of a GMRES that is restarted and stopped early."""
        ended = (f"{one.centers}, left {1e3 * one.max_error:.2g} mm" for one in paper().tables["table4"].rows)
        exact = (self.cell(NOTHING, "", "table4", d) for d in "xyz")
        lines = [_row(("the paper, at its limit", *ended)), _row(("exact solves", *exact))]
        for twice in CHOICES:
            for restart, most in SOLVERS:
                own = (self.cell(GMRES, f"({restart}), {most} iterations{twice}", "table4", d) for d in "xyz")
                lines.append(_row((f"{restart}, {most}{twice}", *own)))
        return _markdown(("GMRES restarted after, iterations in all", "f_x", "f_y", "f_z"), "---" + " ---:" * 3, lines)


def _ended(row: dict[str, str]) -> str:
    """Return the centres of a trial, and what it left if it did not converge."""
    if row["stop"] == "CONVERGED":
        return row["centers"]
    where = " at centres" if row["stop"] == "EXHAUSTED" else ""
    return f"{row['centers']}, left {1e3 * float(row['max_error']):.2g} mm{where}"
