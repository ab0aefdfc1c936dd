"""Ours beside OpenFOAM's mesh motion and gmsh's untangler: ``python -m benchmarks.repair_peers``.

All get the same boundary: the aileron's nodes go where ours puts them, other walls stay, the faces of the box slip. Two
meshes: the Chimera block of tetrahedra at -30 and -60 degrees, and half the aircraft by snappyHexMesh at -12 and -25
degrees. Printed is a table in Markdown for each, as in `repair_peers.md`. Seconds are the processor's, medians of the
motion alone: without the start of programs and the reading of files, which are given beside.

It needs OpenFOAM (``apt-get install --no-install-recommends openfoam``) and what the tests need.
"""

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median

import gmsh
import numpy as np

from benchmarks.foam_motion import LAPLACIAN, SBR, GivenBoundary, Motion
from benchmarks.measure import FloatArray, processor_seconds
from benchmarks.results import machine
from sdm_deflect.cases.aircraft.job import BLOCK, plan_of
from sdm_deflect.cases.aircraft.pipeline import meshed
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.api import deflect
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.base.arrays import IntArray
from sdm_deflect.deform.mesh.cells import Cells, Patch, taken
from sdm_deflect.deform.mesh.edges import area_vectors, polygons_of
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.sliding import Plane
from sdm_deflect.deform.mesh.touched import TouchedCells
from sdm_deflect.deform.rbf.fitting import RepairMode
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.deform.volume.deflection import BoxDeflection
from sdm_deflect.deform.volume.deflection import deflect as carried_out
from sdm_deflect.geometry.datum import hinge_line
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from tests.cases import foam, snappy

VERDICT = r"Mesh OK|Failed (\d+) mesh checks"
HEAD = (
    "| | least quality | mean | inverted | non-orthogonality | skewness | checkMesh | off the planes, m | s |",
    f"{'| --- ' * 9}|",
)
READ = "import sys; from sdm_deflect.cases.api import read; read(sys.argv[1])"
TETRA, PRISM = 4, 6
"""What gmsh calls these elements."""

Ours = Callable[[RepairMode], BoxDeflection]
"""The deflection by ours, given when it shall repair."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Where a method put the nodes (N, 3), and in how many processor seconds."""

    points: FloatArray = field(repr=False)
    seconds: float


Method = Callable[[], Outcome]


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What is deflected: its title, the boundary that all get, how ours does it, the cells that are judged."""

    title: str
    given: GivenBoundary
    ours: Ours
    touched: TouchedCells

    @classmethod
    def of(cls, title: str, mesh: Mesh, box: str, ours: Ours, case: Path) -> "Task":
        """Deflect without repair, cut the patch `box` into its plane faces, and write the mesh as a case."""
        cut, deflection = faced(mesh, box), ours("off")
        if not case.exists():
            OpenFoam().write(cut, case)
        moving, nodes = deflection.plan.surface, deflection.plan.sites.moving
        displacement = deflection.points[nodes] - mesh.points[nodes]
        sides = tuple(name for name in cut.names if name not in mesh.names)
        return cls(title, GivenBoundary(case, cut, moving, displacement, sides), ours, deflection.plan.touched)


@dataclass(frozen=True, slots=True)
class Judged:
    """What became of a mesh.

    Attributes
    ----------
    least, mean : quality of the cells in the box of ours.
    inverted : cells of them that are inverted.
    orthogonality, skewness : largest ones by checkMesh, degrees and a ratio.
    failed : checks of checkMesh that failed.
    off : largest distance (m) by which nodes on the plane faces left them.
    """

    least: float
    mean: float
    inverted: int
    orthogonality: float
    skewness: float
    failed: int
    off: float


def faced(mesh: Mesh, name: str) -> Mesh:
    """Return the mesh with a patch for each direction in which faces of one patch look."""
    faces = polygons_of(mesh.patch(name).faces)
    normals = area_vectors(mesh.points, faces)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    found, side = np.unique(np.round(normals, 3) + 0.0, axis=0, return_inverse=True)
    sides = (np.flatnonzero(side.ravel() == k) for k in range(len(found)))
    cut = tuple(Patch(f"{name}_{k}", (taken(faces, rows),)) for k, rows in enumerate(sides))
    return replace(mesh, patches=(*(patch for patch in mesh.patches if patch.name != name), *cut))


def chimera(folder: Path, angle: float) -> Task:
    """Return case 5.2, small."""
    case = replace(case_named("aileron-chimera"), angle=angle)
    mesh = meshed(case, Stopwatch())[0]

    def ours(repair: RepairMode) -> BoxDeflection:
        wanted = replace(case, repair=repair)
        plan = plan_of(wanted, mesh)
        return carried_out(plan, plan.angle).boxes[0]

    title = f"Chimera block, {len(mesh.cells[0])} tetrahedra, {angle:g} degrees"
    return Task.of(title, mesh, BLOCK, ours, folder / "block")


def aircraft(source: Path, folder: Path, angle: float) -> Task:
    """Return half the aircraft of the case `source`, the aileron blended."""
    mesh, moving = OpenFoam().read(source), snappy.SURFACE
    motion = Blended(Rotation.about(*hinge_line(Fighter(), moving)))
    fixed = [name for name in mesh.names if name not in (moving, "far_field")]

    def ours(repair: RepairMode) -> BoxDeflection:
        return deflect(mesh, [moving], angle=angle, motion=motion, fixed=fixed, repair=repair).deflection.boxes[0]

    title = f"snappyHexMesh, {len(mesh.cells[0])} cells with layers, {angle:g} degrees blended"
    return Task.of(title, mesh, "far_field", ours, folder / "aircraft")


def methods_of(task: Task, folder: Path, start: float) -> dict[str, Method]:
    """Return what is compared; `start` are the seconds in which moveDynamicMesh starts and reads the mesh."""

    def openfoam(solver: str, steps: int, slips: bool = True) -> Method:
        def move() -> Outcome:
            points, seconds = task.given.moved(Motion(solver, steps, slips), folder / "moved")
            return Outcome(points, seconds - start)

        return move

    def own(repair: RepairMode) -> Method:
        def move() -> Outcome:
            begin = processor_seconds()
            points = task.ours(repair).points
            return Outcome(points, processor_seconds() - begin)

        move()
        return move

    def untangler(points: FloatArray) -> Method:
        return lambda: untangled(task.given.mesh.with_points(points))

    surface = task.given.mesh.points.copy()
    surface[task.given.nodes] += task.given.displacement
    pinned = openfoam(LAPLACIAN, 10, False)
    found = {
        "OpenFOAM, Laplacian, 1 step": openfoam(LAPLACIAN, 1),
        "OpenFOAM, Laplacian, 10 steps": openfoam(LAPLACIAN, 10),
        "OpenFOAM, Laplacian, 10 steps, box pinned": pinned,
        "OpenFOAM, SBRStress, 10 steps": openfoam(SBR, 10),
    }
    if isinstance(task.given.mesh.cells[0], Cells):
        found |= {
            "gmsh's untangler, from the moved surface alone": untangler(surface),
            "gmsh's untangler, after Laplacian with box pinned": untangler(pinned().points),
            "gmsh's untangler, after ours without repair": untangler(task.ours("off").points),
        }
    return found | {"ours without repair": own("off"), "ours with repair": own("auto")}


def untangled(mesh: Mesh) -> Outcome:
    """Let gmsh untangle a mesh of tetrahedra; its boundary stays.

    Raises ValueError for other cells: gmsh has no polyhedra, and refuses prisms.
    """
    block = mesh.cells[0]
    if not isinstance(block, Cells) or block.shape != "tetra":
        raise ValueError(f"{mesh.name}: gmsh's untangler gets tetrahedra")
    return Outcome(*optimized(mesh.points, block.nodes, mesh.on(*mesh.names), TETRA))


def optimized(points: FloatArray, cells: IntArray, boundary: IntArray, kind: int) -> tuple[FloatArray, float]:
    """Let gmsh untangle cells (M, k) of one kind; return the points (N, 3), and the processor seconds that it took.

    Nodes of `boundary` (K,) are on a surface, so that they stay; all nodes must be in cells. gmsh numbers nodes anew,
    but keeps the order of cells.
    """
    inner = np.setdiff1d(np.arange(len(points)), boundary)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("mesh")
        gmsh.model.addDiscreteEntity(2, 1)
        gmsh.model.addDiscreteEntity(3, 1, [1])
        for dimension, nodes in ((2, boundary), (3, inner)):
            gmsh.model.mesh.addNodes(dimension, 1, nodes + 1, points[nodes].ravel())
        gmsh.model.mesh.addElementsByType(1, kind, [], cells.ravel() + 1)
        begin = processor_seconds()
        gmsh.model.mesh.optimize("UntangleMeshGeometry", force=True)
        seconds = processor_seconds() - begin
        tags, places, _ = gmsh.model.mesh.getNodes()
        by_tag = np.empty((int(tags.max()) + 1, 3))
        by_tag[tags] = places.reshape(-1, 3)
        moved = points.copy()
        moved[cells.ravel()] = by_tag[gmsh.model.mesh.getElementsByType(kind)[1]]
    finally:
        gmsh.finalize()
    return moved, seconds


def judge(task: Task, points: FloatArray, folder: Path) -> Judged:
    """Judge the deflected points (N, 3) by the project's measure, and by checkMesh in a fresh folder."""
    shutil.rmtree(folder, ignore_errors=True)
    OpenFoam().rewrite(task.given.case, points, folder)
    text = foam.run("checkMesh", folder)
    found, (quality,) = foam.metrics(text), task.touched.quality(points)
    return Judged(
        least=quality.min,
        mean=quality.mean,
        inverted=quality.inverted,
        orthogonality=found["non-orthogonality"],
        skewness=found["skewness"],
        failed=failed_checks(text),
        off=max(left(task.given.mesh, name, points) for name in task.given.box),
    )


def left(mesh: Mesh, name: str, points: FloatArray) -> float:
    """Return the largest distance by which nodes left the plane of a patch, with the nodes at `points` (N, 3)."""
    nodes = mesh.patch(name).nodes
    plane = Plane.fitted(mesh.points[nodes])
    return float(np.abs(plane.distance(points[nodes]) - plane.distance(mesh.points[nodes])).max())


def failed_checks(text: str) -> int:
    """Return how many checks failed, by what checkMesh printed; ValueError if it came to no verdict."""
    found = re.search(VERDICT, text)
    if found is None:
        raise ValueError(f"checkMesh came to no verdict: {text[-200:]!r}")
    return int(found[1] or 0)


def row(name: str, found: Judged, seconds: float | None) -> str:
    """Return a row of the table."""
    figures = [f"{found.least:.3f}", f"{found.mean:.4f}", f"{found.inverted}", f"{found.orthogonality:.1f}"]
    figures += [f"{found.skewness:.2f}", f"{found.failed} failed" if found.failed else "OK", f"{found.off:.0e}"]
    figures.append("" if seconds is None else f"{seconds:.2f}")
    return f"| {name} | {' | '.join(figures)} |"


def table(task: Task, folder: Path, rounds: int) -> Iterator[str]:
    """Yield the lines of a task's table."""
    starts = [task.given.moved(Motion(LAPLACIAN, 0), folder / "moved")[1] for _ in range(rounds)]
    reads = [seconds_of([sys.executable, "-c", READ, str(task.given.case)]) for _ in range(rounds)]
    methods = methods_of(task, folder, median(starts))
    turns = [{name: method() for name, method in methods.items()} for _ in range(rounds)]
    (quality,) = task.touched.quality(task.given.mesh.points)
    yield f"## {task.title}\n"
    yield f"Quality: {quality.measure} of the {quality.cells} cells in the box of ours. To start and to read the mesh"
    yield f"takes moveDynamicMesh {median(starts):.2f} s, ours {median(reads):.2f} s.\n"
    yield from HEAD
    yield row("undeflected", judge(task, task.given.mesh.points, folder / "judged"), None)
    for name, outcome in turns[-1].items():
        seconds = median(turn[name].seconds for turn in turns)
        yield row(name, judge(task, outcome.points, folder / "judged"), seconds)
    yield ""


def seconds_of(words: Sequence[str]) -> float:
    """Return the processor seconds of a program."""
    begin = processor_seconds()
    subprocess.run(words, check=True)
    return processor_seconds() - begin


def tasks(folder: Path) -> Iterator[Task]:
    """Yield what is deflected."""
    for angle in (-30.0, -60.0):
        yield chimera(folder, angle)
    snappy.make(folder / "snappy")
    for angle in (-12.0, -25.0):
        yield aircraft(folder / "snappy", folder, angle)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.repair_peers", description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, help="times that everything is timed")
    given = parser.parse_args()
    print(f"{machine()}\n")
    with tempfile.TemporaryDirectory() as name:
        for task in tasks(Path(name)):
            print("\n".join(table(task, Path(name), given.rounds)), flush=True)


if __name__ == "__main__":
    main()
