"""The tables and sentences of docs/paper.md that quote figures, as Markdown: `python -m studies page` writes them."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from studies.files import read_rows
from studies.paper import Row, Size, paper
from studies.trends import Verdict, three_digits, title

Numbers = dict[str, Any]
SECTIONS = (
    ("table1", "figure2"), ("table2",), ("figure3",), ("table3",), ("figure4",), ("figure5",), ("table4",),
    ("figure7",), ("timings",),
)  # fmt: skip
"""Sections of the page that have a table of trends, by the tables and figures of the paper that they are about."""
CHANGES = (
    ("nothing changed", ""), ("margins", "x 0.25, zero sites as far apart"),
    ("margins", "x 0.25, the paper's number of zero sites"), ("distance of zero sites", "x 0.5"),
    ("fuselage panel", "does not move"), ("fuselage panel", "rough by 0.1 mm"), ("fuselage panel", "rough by 0.2 mm"),
    ("fuselage panel", "of facets of 9 deg"),
)  # fmt: skip
"""Changes of centres.csv that the page shows."""
CHANGED = (("table1", "x"), ("table1", "z"), ("table4", "x"), ("table4", "y"), ("table4", "z"))
"""Adaptations for which it shows them."""
TOLERANCES = (
    ("aileron, small hexahedron -12°, f_z", "table1", "z", "-12"), ("Chimera block -12°, f_z", "table3", "z", "-12"),
    ("Chimera block -30°, f_z", "table3", "z", "-30"), ("tail +12°, f_x", "table4", "x", "12"),
    ("tail +12°, f_z", "table4", "z", "12"),
)  # fmt: skip
"""Adaptations for which it shows what a smaller tolerance does."""


def blocks(tables: Path, numbers: Numbers) -> Iterator[str]:
    """Yield the blocks of the page, each of which ends with a line break, by the files in `tables`."""
    trends = [Verdict(**one) for one in numbers["trends"]]
    hold = sum(one.holds for one in trends)
    yield f"Of {len(trends)} trends that the paper states, {hold} hold here and {len(trends) - hold} do not.\n"
    yield _meshes(numbers)
    yield from (_sites(name, numbers) for name in ("table1", "table3", "table4"))
    yield _table1(tables)
    yield _table2(tables)
    yield _table3(tables)
    yield _table4(tables)
    for section in SECTIONS:
        yield _markdown(("the paper says", "here", "measured"), "---", [t.line for t in trends if t.table in section])
    yield from (_repaired(one) for one in numbers["counted"] if one["repair"] == "auto" and one["strategy"] == "squv")
    yield from (_checks(number, numbers) for number in (5, 8))
    yield _counts(numbers)
    yield _timings(numbers)
    yield from _reasons(tables / "centres.csv")


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


def _costed(first: Sequence[str], loop: str) -> tuple[str, ...]:
    seconds = ("seconds paper", f"{loop} here", "million pairs paper", "here")
    return (*first, "t_end paper", "here", "N_c,end paper", "here", *seconds)


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
    return _markdown(_costed(("", "initial"), "gmres"), "--- ---" + " ---:" * 8, lines)


def _table2(tables: Path) -> str:
    lines = [
        _row((a.setting.n_add, *_ends(a, b), f"{round(100 * (b.centers / a.centers - 1)):+d} %", *_costs(a, b, c)))
        for a, b, c in _beside(tables, "table2", "gmres")
    ]
    first, ends, costs = ("M_add",), _costed((), "gmres")[:4], _costed((), "gmres")[4:]
    return _markdown((*first, *ends, "differs by", *costs), "---:", lines)


def _table3(tables: Path) -> str:
    lines = [
        _row((f"{title(a.setting.columns)} at {a.setting.angle:+g}°", *_ends(a, b), *_costs(a, b, c)))
        for a, b, c in _beside(tables, "table3", "grown")
    ]
    return _markdown(_costed(("",), "grown"), "---" + " ---:" * 8, lines)


def _table4(tables: Path) -> str:
    lines = [
        _row((title(a.setting.columns), *_ends(a, b), f"{a.max_error:.2e}", f"{b.max_error:.2e}", *_costs(a, b, c)))
        for a, b, c in _beside(tables, "table4", "grown")
    ]
    ends, costs = _costed((), "grown")[:4], _costed((), "grown")[4:]
    return _markdown(("", *ends, "max error paper, m", "here", *costs), "---" + " ---:" * 10, lines)


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


def _reasons(path: Path) -> Iterator[str]:
    """Yield the tables of what was changed, of the tolerances, and of GMRES."""
    with path.open(newline="", encoding="utf-8") as file:
        found = {
            tuple(row[name] for name in ("change", "value", "table", "columns", "angle_deg")): row
            for row in csv.DictReader(file)
        }
    angle = {"table1": "-12", "table4": "12"}

    def cell(change: str, value: str, table: str, columns: str, at: str = "") -> str:
        row = found.get((change, value, table, columns, at or angle[table]))
        return _ended(row) if row else ""

    theirs = [next(row["paper"] for key, row in found.items() if key[2:4] == one) for one in CHANGED]
    lines = [_row(("the paper", *theirs))]
    lines += [_row((" ".join((*own,)).strip(), *(cell(*own, *one) for one in CHANGED))) for own in CHANGES]
    heads = ("", "aileron f_x", "f_z", "tail f_x", "f_y", "f_z")
    yield _markdown(heads, "--- ---: ---: ---: ---: ---:", lines)

    factors = ("1", "2", "4", "8", "16")
    lines = [
        _row((words, found["tolerance", "/ 1", *key]["paper"], *(cell("tolerance", f"/ {f}", *key) for f in factors)))
        for words, *key in TOLERANCES
    ]
    yield _markdown(("8e-5 m divided by", "paper", *factors), "---" + " ---:" * 6, lines)

    rows = paper().tables["table4"].rows
    lines = [
        _row(("the paper, at its limit", *(f"{one.centers}, left {1e3 * one.max_error:.2g} mm" for one in rows))),
        _row(("exact solves", *(cell("nothing changed", "", "table4", d) for d in "xyz"))),
    ]
    for restart, most in ((20, 300), (30, 300), (30, 900)):
        own = [cell("GMRES", f"({restart}), {most} iterations", "table4", d) for d in "xyz"]
        lines.append(_row((f"{restart}, {most}", *own)))
    yield _markdown(("GMRES restarted after, iterations in all", "f_x", "f_y", "f_z"), "--- ---: ---: ---:", lines)


def _ended(row: dict[str, str]) -> str:
    """Return the centres of a trial, and what it left if it did not converge."""
    if row["stop"] == "CONVERGED":
        return row["centers"]
    where = " at centres" if row["stop"] == "EXHAUSTED" else ""
    return f"{row['centers']}, left {1e3 * float(row['max_error']):.2g} mm{where}"
