"""How far the surfaces of the cases are from CAD that turned rigidly: the table of docs/cases.md."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from sdm_deflect.cases.aircraft.pipeline import run_case
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.output import write_table
from sdm_deflect.cases.run.progress import Stopwatch

# Cases, and their angles in degrees.
ROWS = (
    ("aileron-free", (-30.0, 15.0)), ("aileron", (-12.0, -30.0, 20.0)), ("aileron-chimera", (-12.0, -30.0, 20.0)),
    ("tail", (12.0, -12.0, 24.0)), ("rudder", (15.0, -30.0, 30.0)), ("all", (12.0, -12.0, 20.0)),
)  # fmt: skip
# Parts of a surface that `rigid_cad_predicted` measures, in the order of the table.
PARTS = ("whole", "strip", "hinge_edges", "faces", "trailing_edge", "root", "beyond_root", "cad_to_surface")
# Distances (m) below this are rounding, and shown as 0.
ROUNDING = 1e-12
CSV, TABLE = "distances.csv", "distances.md"


def write_distances(scale: str, folder: Path, watch: Stopwatch, cache: bool) -> str:
    """Run all cases, and write the largest distance (mm) of each part, as .csv and as a table; return the table."""
    rows = [(name, angle, _largest(name, angle, scale, folder, watch, cache)) for name, angle in _cases()]
    write_table(folder / CSV, [["case", "angle_deg", *PARTS], *([*row[:2], *row[2].values()] for row in rows)])
    lines = [f"| `{name}` | {angle:+g}° | {' | '.join(map(_shown, found.values()))} |" for name, angle, found in rows]
    text = "\n".join([f"| case | angle | {' | '.join(PARTS).replace('_', ' ')} |", "|---" * 10 + "|", *lines])
    (folder / TABLE).write_text(text + "\n", encoding="utf-8")
    return text


def _cases() -> Iterator[tuple[str, float]]:
    return ((name, angle) for name, angles in ROWS for angle in angles)


def _largest(
    name: str, angle: float, scale: str, folder: Path, watch: Stopwatch, cache: bool
) -> dict[str, float | None]:
    """Return the largest distance (m) of each part, over the surfaces of a case; None for a part that none has."""
    own = folder / "runs" / f"{name}{angle:+g}"
    own.mkdir(parents=True)
    run = run_case(replace(case_named(name, scale), angle=angle), watch, own, cache, report=False)
    found = [one.figures for one in run.checks if one.name.partition(":")[0] == "rigid_cad_predicted"]
    return {part: max((one[part]["largest"] for one in found if part in one), default=None) for part in PARTS}


def _shown(metres: float | None) -> str:
    return "" if metres is None else "0" if metres < ROUNDING else f"{1e3 * metres:.3g}"
