"""The guide's half wing, its flap at 25 degrees, by others: ``python -m benchmarks.peers_motion > peers_motion.md``.

All get the same boundary: the flap's nodes go where ours puts them, the wing stays. OpenFOAM's solvers move the whole
mesh, and let nodes slip on the symmetry plane. "All boundary nodes" is one dense system with every one
as a centre, evaluated at every node by SciPy, as PyGeM's `RBF` does with the control points that it is given; nodes on
the symmetry plane stay.

It needs OpenFOAM (``apt-get install --no-install-recommends openfoam``) and what the tests need.
"""

import runpy
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.interpolate import RBFInterpolator

from benchmarks.foam_motion import LAPLACIAN, SBR, GivenBoundary, Motion
from benchmarks.measure import FloatArray, processor_seconds
from benchmarks.repair_peers import HEAD, Outcome, Task, judge, row
from benchmarks.results import machine
from sdm_deflect.cases.api import deflect
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.rbf.fitting import RepairMode
from sdm_deflect.deform.volume.deflection import BoxDeflection
from sdm_deflect.meshing.formats.registry import read

WING = Path(__file__).parents[1] / "docs" / "examples" / "naca_wing.py"
HINGE, ANGLE = [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]], 25.0


def wing(folder: Path) -> Task:
    """Return the half wing of the guide, the flap blended."""
    runpy.run_path(str(WING))["build"](folder)
    mesh: Mesh = read(folder / "naca.su2")

    def ours(repair: RepairMode) -> BoxDeflection:
        result = deflect(
            mesh, "flap", HINGE, ANGLE, motion="blended", fixed="wing", slide="symmetry:plane", repair=repair
        )
        return result.deflection.boxes[0]

    title = f"Half wing of the guide, {len(mesh.cells[0])} tetrahedra, {ANGLE:g} degrees blended"
    return Task.of(title, mesh, "far_field", ours, folder / "wing")


def all_boundary_nodes(given: GivenBoundary) -> Outcome:
    """Interpolate with every boundary node as a centre, at every node."""
    mesh = given.mesh
    nodes = mesh.on(*mesh.names)
    values = np.zeros((len(mesh.points), 3))
    values[given.nodes] = given.displacement
    begin = processor_seconds()
    found = RBFInterpolator(mesh.points[nodes], values[nodes], kernel="thin_plate_spline", degree=1)
    moved: FloatArray = mesh.points + found(mesh.points)
    seconds = processor_seconds() - begin
    moved[nodes] = mesh.points[nodes] + values[nodes]
    return Outcome(moved, seconds)


def outcomes(task: Task, folder: Path) -> Iterator[tuple[str, Outcome]]:
    """Yield where each method puts the nodes; seconds with start and reading of programs, without them of functions."""
    for name, motion in {
        "OpenFOAM, Laplacian, 1 step": Motion(LAPLACIAN, 1),
        "OpenFOAM, Laplacian, 10 steps": Motion(LAPLACIAN, 10),
        "OpenFOAM, SBRStress, 10 steps": Motion(SBR, 10),
    }.items():
        yield name, Outcome(*task.given.moved(motion, folder / "moved"))
    yield "all boundary nodes, dense", all_boundary_nodes(task.given)
    modes: tuple[tuple[str, RepairMode], ...] = (("ours without repair", "off"), ("ours with repair", "auto"))
    for name, mode in modes:
        begin = processor_seconds()
        points = task.ours(mode).points
        yield name, Outcome(points, processor_seconds() - begin)


def page(folder: Path) -> Iterator[str]:
    """Yield the lines of the page."""
    task = wing(folder)
    (quality,) = task.touched.quality(task.given.mesh.points)
    yield f"# {task.title}\n"
    yield f"Made by `python -m benchmarks.peers_motion`. {machine()}.\n"
    yield f"Quality: {quality.measure} of the {quality.cells} cells in the box of ours; checkMesh judges the whole"
    yield "mesh. With OpenFOAM nodes slip on the far field and on the symmetry plane. 'All boundary nodes': one dense"
    yield "system with every one as a centre, evaluated at every node by SciPy, as PyGeM's `RBF` does with the control"
    yield (
        "points that it is given. Processor seconds of one run: of OpenFOAM with its start, of ours with plan and "
        "checks.\n"
    )
    yield from HEAD
    yield row("undeflected", judge(task, task.given.mesh.points, folder / "judged"), None)
    for name, outcome in outcomes(task, folder):
        yield row(name, judge(task, outcome.points, folder / "judged"), outcome.seconds)


def main() -> None:
    """Print the page."""
    with tempfile.TemporaryDirectory() as name:
        for line in page(Path(name)):
            print(line, flush=True)


if __name__ == "__main__":
    main()
