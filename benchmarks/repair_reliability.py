"""How good repaired meshes are: the mesher is not deterministic, so the least quality is measured on several meshes.

``python -m benchmarks.repair_reliability --count 10 --meshes FOLDER --json FILE`` deflects fresh meshes of every case
far, with and without repair. The meshes are kept in FOLDER and used again.

At the hinge of an aileron stand cells with an edge on the hinge, a node of the aileron and one beyond the box, which
stays: their dihedral angle at the hinge is given, and `dihedral_bound` says how good such a cell can be at most.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np
from scipy.optimize import minimize_scalar

from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.pipeline import meshed
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.compiled import FOLDER_VARIABLE
from sdm_deflect.deform.mesh.cells import Cells
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.volume.deflection import BoxDeflection, deflect
from sdm_deflect.geometry.datum import hinged

ASKED = (
    ("tail", 26.0, 0.0, 0.38), ("tail", -26.0, 0.0, 0.38),
    ("aileron", 60.0, 0.0, 0.35), ("aileron", 60.0, 0.006, 0.35),
    ("aileron", -60.0, 0.0, 0.35), ("aileron", -60.0, 0.006, 0.35),
    ("aileron-chimera", -30.0, 0.0, 0.55), ("aileron-chimera", -45.0, 0.0, 0.45),
    ("aileron-chimera", -60.0, 0.0, 0.35), ("aileron-chimera", -60.0, 0.006, 0.35),
    ("rudder", 40.0, 0.0, 0.3), ("all", 25.0, 0.0, 0.3),
)  # fmt: skip
"""Case, angle (degrees), `confinement.ahead` (m), and the least mean ratio that is asked for."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One mesh at one angle; several surfaces give their worst.

    `before`, `alone`, `repaired` are least mean ratios in the boxes: undeflected, of the interpolant, after the repair;
    `torn` and `inverted` the inverted cells of the last two; `bound` is that of the worst cell at a hinge.
    """

    before: float
    alone: float
    torn: int
    repaired: float
    inverted: int
    bound: float
    seconds: float


def named(name: str, angle: float, ahead: float) -> str:
    """Return how a row of the table is called."""
    return f"{name} {angle:+g}" + (f", box {1e3 * ahead:g} mm ahead" if ahead else "")


def trial(case: Case, mesh: Mesh) -> Trial:
    """Deflect every surface of a case in one step."""
    plan = plan_of(case, mesh)
    parts = [part(box) for box in deflect(plan, plan.angle).boxes]
    sums = {name: sum(getattr(one, name) for one in parts) for name in ("torn", "inverted", "seconds")}
    return Trial(**{name: min(getattr(one, name) for one in parts) for name in Trial.__slots__} | sums)


def part(found: BoxDeflection) -> Trial:
    """Measure one surface."""
    plan, repair = found.plan, found.repaired
    (before,), (after,) = plan.touched.quality_before, found.quality
    alone = repair.quality[0] if repair else after
    bounds = (dihedral_bound(angle) for angle in hinge_angles(found))
    seconds = repair.seconds if repair else 0.0
    return Trial(before.min, alone.min, alone.inverted, after.min, after.inverted, min(bounds, default=1.0), seconds)


def hinge_angles(found: BoxDeflection) -> Iterator[float]:
    """Yield the dihedral angles (radians) at the hinge of cells whose fourth node is beyond the box."""
    plan, points = found.plan, found.points
    mesh, surface = plan.mesh, plan.surface
    if not hinged(surface):
        return
    masks = np.zeros((3, len(points)), dtype=bool)
    masks[0, mesh.patch(surface).nodes] = True
    masks[1, mesh.on(*(name for name in mesh.names if name != surface))] = True
    masks[2, plan.changed] = True
    own, other, moves = masks
    edge, body, still = own & other, own & ~other, ~moves
    (block,) = mesh.cells
    assert isinstance(block, Cells)
    tets = block.nodes[plan.touched.rows[0]]
    for mask, count in ((edge, 2), (body, 1), (still, 1)):
        tets = tets[mask[tets].sum(axis=1) == count]
    for cell in tets:
        first, second = points[cell[edge[cell]]]
        yield dihedral(first, second, *points[cell[body[cell]]], *points[cell[still[cell]]])


def dihedral(first: FloatArray, second: FloatArray, one: FloatArray, other: FloatArray) -> float:
    """Return the angle (radians) at an edge between the planes to two points (3,)."""
    along = (second - first) / np.linalg.norm(second - first)
    a, b = ((point - first) - ((point - first) @ along) * along for point in (one, other))
    return float(np.arccos(np.clip(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)), -1.0, 1.0)))


def dihedral_bound(angle: float) -> float:
    """Return the largest mean ratio of a tetrahedron that has a dihedral angle (radians) at one edge.

    The best one is symmetric: an edge of length 2 a, and two points at distance 1 from its middle.
    """

    def worse(a: float) -> float:
        volume = a * np.sin(angle) / 3.0
        squares = 8.0 * a * a + 4.0 + 4.0 * np.sin(0.5 * angle) ** 2
        return float(-12.0 * np.cbrt(9.0 * volume * volume) / squares)

    return -float(minimize_scalar(worse, bounds=(0.05, 5.0), method="bounded", options={"xatol": 1e-10}).fun)


def table(found: dict[str, list[Trial]], asked: dict[str, float]) -> str:
    """Markdown: a row for each case and angle."""
    rows = []
    for name, trials in found.items():
        reached = [one for one in trials if one.repaired >= asked[name] and not one.inverted]
        short = [one for one in trials if one not in reached]
        proved = sum(one.bound < asked[name] for one in short)
        least = sorted(one.repaired for one in trials)
        rows.append(
            f"| {name} | {asked[name]:g} | {len(reached)} of {len(trials)} | {least[0]:.3f} | {median(least):.3f} "
            f"| {min(one.alone for one in trials):.3f} | {median(one.alone for one in trials):.3f} "
            f"| {sum(one.torn for one in trials)} | {sum(one.inverted for one in trials)} "
            f"| {min(one.before for one in trials):.3f} | {proved} of {len(short)} "
            f"| {median(one.seconds for one in trials):.2f} |"
        )
    head = (
        "| case, deg | asked | reached by | least | median | least alone | median alone | inverted alone "
        "| inverted | undeflected, least | short by a bound | s |"
    )
    return "\n".join([head, f"|{' --- |' * 12}", *rows, ""])


def main() -> None:
    """Deflect all meshes; the file is rewritten after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--meshes", type=Path, required=True, help="where the meshes are kept")
    parser.add_argument("--json", type=Path, required=True, help="result; a .md table goes beside it")
    options = parser.parse_args()
    found: dict[str, list[Trial]] = {}
    asked = {named(*one[:3]): one[3] for one in ASKED}
    for number in range(1, options.count + 1):
        os.environ[FOLDER_VARIABLE] = str(options.meshes / str(number))
        for name, angle, ahead, _ in ASKED:
            case = replace(case_named(name), angle=angle)
            confinement = replace(case.confinement, ahead=ahead)
            case = replace(case, adaptation=replace(case.adaptation, max_steps=1), confinement=confinement)
            mesh = meshed(case_named(name), Stopwatch())[0]
            found.setdefault(named(name, angle, ahead), []).append(trial(case, mesh))
        figures = {name: [asdict(one) for one in trials] for name, trials in found.items()}
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
        options.json.with_suffix(".md").write_text(table(found, asked))
        print(f"{number} of {options.count}", flush=True)


if __name__ == "__main__":
    main()
