"""How far the surfaces of the aircraft can turn: the one place of the limits that the pages quote."""

import csv
from collections.abc import Iterator
from pathlib import Path

from sdm_deflect.cases.aircraft.pipeline import case_search, mesh_of_case
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.output import write_table
from sdm_deflect.cases.run.progress import Stopwatch

# Cases with one surface each.
CASES = ("aileron", "rudder", "tail")
# Smallest acceptable mean ratio of a cell that may change, and to how many degrees the limits are found.
LEAST, RESOLUTION = 0.25, 1.0
HEADS = ("case", "repair", "angle_deg", "quality", "ends")
FILE = "limits.csv"


def write_limits(scale: str, folder: Path, watch: Stopwatch, cache: bool) -> str:
    """Find the limits of the cases, and write them as .csv; return what the pages say of them."""
    rows = [row for name in CASES for row in _limits(name, scale, watch, cache)]
    write_table(folder / FILE, [list(HEADS), *rows])
    return "\n".join(pieces(folder / FILE))


def _limits(name: str, scale: str, watch: Stopwatch, cache: bool) -> Iterator[list[object]]:
    case = case_named(name, scale)
    search = case_search(case, mesh_of_case(case, watch, cache)[0], LEAST, RESOLUTION)
    with watch.stage(f"limit of {name}") as progress:
        found = search.limits("auto", progress)
    for one in found:
        parts = one.end.split("; ")  # checks that fail and the worst cell, or a fault and a way out
        end = parts[-1] if parts[-1].startswith("least quality") else parts[0]
        yield [name, one.repair, f"{one.angle:g}", f"{one.at.quality_min:.3f}", end]


def pieces(path: Path) -> list[str]:
    """Return the sentence of README, lesson and slides, and the table of docs/cases.md, by the file of the limits."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = [*csv.DictReader(file)]
    ends = {(row["case"], row["repair"], float(row["angle_deg"]) > 0.0): row for row in rows}
    first, *others = (
        f"{_whole(ends[name, 'auto', False])} to {_whole(ends[name, 'auto', True])} degrees of the {name}"
        for name in CASES
    )
    sentence = f"With repair, no cell is below {LEAST:g} from {first}, {others[0]}, and {others[1]}."
    heads = ("case", "repair", "limit", "least quality there", "what ends it")
    lines = [
        f"| `{row['case']}` | {row['repair']} | {float(row['angle_deg']):+g}° | {row['quality']} | {row['ends']} |"
        for row in rows
    ]
    return [sentence, "\n".join([f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *lines])]


def _whole(row: dict[str, str]) -> str:
    """Return the whole degrees of a limit, towards zero."""
    return f"{int(float(row['angle_deg'])):+d}"
