"""Meshes with layers beside dense TPS and OpenFOAM's solvers: ``python -m benchmarks.layers FOLDER > layers.md``.

FOLDER holds two public meshes: ``30p30n_L1_coarse.su2`` and ``717_wl_L2.cgns``. All others are made. It needs OpenFOAM
(``apt-get install --no-install-recommends openfoam cgns-convert``) and what the tests need.
"""

import argparse
import runpy
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import RBFInterpolator

from benchmarks import memory, repair_peers
from benchmarks.c_grid import c_grid
from benchmarks.foam_motion import LAPLACIAN, SBR, Motion
from benchmarks.measure import FloatArray, processor_seconds
from benchmarks.peers_motion import HINGE, WING
from benchmarks.results import machine
from sdm_deflect.cases.api import deflect, read
from sdm_deflect.deform.mesh.cells import Cells, Patch
from sdm_deflect.deform.mesh.edges import are_lines, polygons_of, unit
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.touched import layers
from sdm_deflect.deform.rbf.fitting import RepairMode
from sdm_deflect.deform.volume.deflection import BoxDeflection
from sdm_deflect.deform.volume.plan import BoxPlan
from tests.cases import snappy
from tests.meshing.formats.wing import wing

ANGLES = (-30.0, -20.0, -10.0, -5.0, 5.0, 10.0, 20.0, 30.0)
DENSE = 12_000
"""Centres of the dense system at most: beyond, every n-th wall node is one."""
GROWTH = 1.3
HEAD = (
    "| angle | method | least | 1 % | mean | inverted | first height | first edge, deg | non-orthogonality | s | MB |",
    f"{'| --- ' * 11}|",
)


@dataclass(frozen=True, slots=True)
class Example:
    """A mesh: what it is, how it is made, and the settings that deflect it."""

    name: str
    mesh: Callable[[], Mesh]
    settings: dict[str, Any]


class Outcome(NamedTuple):
    """Where a method put the nodes (N, 3), in how many processor seconds, with how much memory beside what was used."""

    points: FloatArray
    seconds: float
    megabytes: float


def measured(move: Callable[[], FloatArray]) -> Outcome:
    """Return the outcome of a method."""
    memory.reset_peak()
    before, begin = memory.peak(), processor_seconds()
    points = move()
    return Outcome(points, processor_seconds() - begin, (memory.peak() - before) / 1e6)


def examples(folder: Path, scratch: Path) -> Iterator[Example]:
    """Yield the meshes but that of snappyHexMesh."""
    for hinge in ((0.41, -0.005), (0.41025, -0.02073)):
        settings: dict[str, Any] = {"surfaces": "flap", "hinge": [hinge], "fixed": "wall"}
        settings["select"] = {"flap": "wall#3"}
        yield Example(f"30P30N, flap about {hinge}", lambda: read(folder / "30p30n_L1_coarse.su2"), settings)
    blended: dict[str, Any] = {"surfaces": "flap", "motion": "blended", "fixed": "wing"}
    rear = "wall side:5.5,0,4.3,4.1,0,-1.1 box:-inf,-inf,4.3,inf,inf,8.4"
    settings = {**blended, "select": {"flap": rear}, "fixed": "wall", "strip": 0.05}
    settings["hinge"] = [[5.5, -0.15, 4.3], [6.6, -0.15, 8.4]]
    subprocess.run(["cgnsconvert", "-h", folder / "717_wl_L2.cgns", scratch / "717.cgns"], check=True)
    yield Example("717 wing, the rear of its inner half", lambda: read(scratch / "717.cgns"), settings)
    sides = {"symmetry": "plane", "end": "plane"}
    for chord, flap, first, strip in ((0.7, (0.3, 0.7), 1e-6, 0.1), (0.95, (0.4, 0.6), 6e-8, 0.04)):
        ends = [[chord, y, 0.0] for y in flap]
        settings = {**blended, "hinge": ends, "slide": sides, "strip": strip}
        span = np.concatenate([np.linspace(a, b, 14)[:-1] for a, b in ((0.0, flap[0]), flap, (flap[1], 1.0))])
        grid = partial(c_grid, chord, flap, first, np.append(span, 1.0))
        yield Example(f"C-grid, first layer {first:g}, flap behind {chord:g} of the chord", grid, settings)
    guide = {**blended, "hinge": HINGE, "slide": {"symmetry": "plane"}}
    yield Example("the guide's half wing with 20 layers from 1e-6", lambda: layered(scratch), guide)
    coarse = {**blended, "surfaces": "flap_*", "fixed": "wing_*", "hinge": wing().hinge, "strip": 0.1}
    hybrid = wing(first_height=1e-6, layers=20).mesh
    yield Example("coarse half wing of hexahedra, prisms and tetrahedra", lambda: hybrid, coarse)


def layered(folder: Path, first: float = 1e-6, count: int = 20) -> Mesh:
    """Return the guide's half wing, its wall pushed outwards over layers of prisms that grow by `GROWTH`."""
    runpy.run_path(str(WING))["build"](folder)
    mesh: Mesh = read(folder / "naca.su2")
    walls = ("wing", "flap")
    wall, old = mesh.on(*walls), mesh.points
    normal = -normals(mesh, old, walls)[wall]
    normal[old[wall, 1] == old[mesh.patch("symmetry").nodes, 1].min(), 1] = 0.0
    heights = first * (GROWTH ** np.arange(count + 1) - 1.0) / (GROWTH - 1.0)
    new = old.copy()
    new[wall] += heights[-1] * normal
    points = np.vstack([new, *(old[wall] + height * normal for height in heights[:-1])])
    column = np.empty((count + 1, len(old)), dtype=np.intp)
    column[:], row = np.arange(len(old)), np.arange(len(wall))
    column[:-1, wall] = len(old) + len(wall) * np.arange(count)[:, None] + row
    faces = {name: mesh.patch(name).faces[0].nodes for name in mesh.names}
    triangles = np.concatenate([faces[name] for name in walls])
    wedges = np.concatenate([np.hstack([column[k][triangles], column[k + 1][triangles]]) for k in range(count)])
    edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    root = edges[np.isin(edges, mesh.patch("symmetry").nodes).all(axis=1)]
    quads = np.concatenate([np.column_stack([column[k][root], column[k + 1][root[:, ::-1]]]) for k in range(count)])
    faces |= {name: column[0][faces[name]] for name in walls}
    patches = [Patch(name, (Cells("triangle", nodes),)) for name, nodes in faces.items()]
    side = mesh.names.index("symmetry")
    patches[side] = Patch("symmetry", (*patches[side].faces, Cells("quad", quads)))
    (tets,) = mesh.cells
    return Mesh(points, (tets, Cells("wedge", wedges)), tuple(patches))


def normals(mesh: Mesh, points: FloatArray, walls: tuple[str, ...]) -> FloatArray:
    """Return the mean (N, 3) of the unit normals at the corners of walls' faces, with unit length; 0 elsewhere."""
    faces, out = polygons_of(mesh.faces_of(walls)), np.zeros_like(points)
    nodes, sizes = faces.nodes, np.diff(faces.offsets)
    first, size = (np.repeat(values, sizes) for values in (faces.offsets[:-1], sizes))
    place = np.arange(len(nodes)) - first
    after, before = (points[nodes[first + (place + step) % size]] - points[nodes] for step in (1, -1))
    along = np.where(place[:, None] == 0, after, -after)
    across = np.cross(along, [0.0, 0.0, 1.0]) if are_lines(faces) else np.cross(after, before)
    np.add.at(out, nodes, unit(across))
    return unit(out)


def first_edges(plan: BoxPlan, points: FloatArray) -> tuple[float, float]:
    """Return the largest relative change of a first layer's height, and the mean change of its edges' angles (degrees).

    The angle is that between an edge that leaves a wall and the wall's normal there. Both are 0 without layers.
    """
    edges = next(layers(plan.touched, plan.walls), None)
    if edges is None:
        return 0.0, 0.0
    names = (*plan.boundary.moving, *plan.boundary.fixed)

    def of(at: FloatArray) -> tuple[FloatArray, FloatArray]:
        along = at[edges.ends] - at[edges.starts]
        length = np.linalg.norm(along, axis=1)
        cosine = np.abs(np.einsum("ij,ij->i", along, normals(plan.mesh, at, names)[edges.starts])) / length
        return length, np.degrees(np.arccos(np.minimum(cosine, 1.0)))

    (low, before), (high, after) = of(plan.mesh.points), of(points)
    return float(np.abs(high / low - 1.0).max()), float(np.abs(after - before).mean())


def dense(plan: BoxPlan, angle: float) -> FloatArray:
    """Interpolate by SciPy's TPS with all wall nodes as centres, and ours' zero sites; sliding nodes stay on planes."""
    sites, points, state = plan.sites, plan.mesh.points, plan.state(plan.mesh.points)
    move = plan.boundary.displacement(plan.job.amounts_at(angle))
    known = np.concatenate([sites.moving[sites.distinct], sites.fixed])
    values = np.vstack([move[sites.distinct], np.zeros((len(sites.fixed), 3))])
    step = -(-len(known) // DENSE)
    zero = np.vstack([one.points for one in sites.zero])
    centers = np.vstack([points[known][::step], zero])
    values = np.vstack([values[::step], np.zeros_like(zero)])
    _, own = np.unique(centers, axis=0, return_index=True)
    flat = 2 if plan.mesh.plane else 3
    found = RBFInterpolator(centers[own][:, :flat], values[own][:, :flat], kernel="thin_plate_spline", degree=1)
    out, rows = points.copy(), np.concatenate([state.free, sites.slid])
    new = np.zeros((len(rows), 3))
    new[:, :flat] = found(points[rows][:, :flat])
    out[state.free] += new[: len(state.free)]
    out[sites.slid] += state.slid(move, new[len(state.free) :])
    out[sites.moving] += move
    return out


def row(plan: BoxPlan, angle: float, name: str, found: Outcome, orthogonality: str = "") -> str:
    """Return a row of the table."""
    quality, inverted = plan.touched.scores(found.points)
    height, turn = first_edges(plan, found.points)
    figures = f"{quality.min():.3f} | {np.percentile(quality, 1.0):.3f} | {quality.mean():.3f} | {inverted.sum()}"
    cost = f"{found.seconds:.1f} | {f'{found.megabytes:.0f}' if 'steps' not in name else ''}"
    return f"| {angle:+g} | {name} | {figures} | {height:.1%} | {turn:.2f} | {orthogonality} | {cost} |"


def rows(example: Example, angle: float) -> Iterator[str]:
    """Yield what becomes of a mesh at one angle by ours, and by dense TPS."""
    mesh = example.mesh()
    found: dict[RepairMode, BoxDeflection] = {}

    def ours(mode: RepairMode) -> FloatArray:
        found[mode] = deflect(mesh, angle=angle, **example.settings, repair=mode).deflection.boxes[0]
        return found[mode].points

    without, repaired = measured(partial(ours, "off")), measured(partial(ours, "auto"))
    plan = found["off"].plan
    if angle == ANGLES[0]:
        yield row(plan, 0.0, "undeflected", Outcome(mesh.points, 0.0, 0.0))
    yield row(plan, angle, "dense TPS", measured(partial(dense, plan, angle)))
    yield row(plan, angle, "ours", without)
    yield row(plan, angle, "ours, repaired", repaired)


def snappy_rows(source: Path, scratch: Path, angle: float) -> Iterator[str]:
    """Yield what becomes of snappyHexMesh's mesh at one angle, by OpenFOAM too."""
    task = repair_peers.aircraft(source, scratch, angle)
    plan = task.ours("off").plan
    if angle == ANGLES[0]:
        orthogonality = repair_peers.judge(task, plan.mesh.points, scratch / "judged").orthogonality
        yield row(plan, 0.0, "undeflected", Outcome(plan.mesh.points, 0.0, 0.0), f"{orthogonality:.1f}")
    methods = {
        "Laplacian, 10 steps": lambda: task.given.moved(Motion(LAPLACIAN, 10), scratch / "moved")[0],
        "SBR stress, 10 steps": lambda: task.given.moved(Motion(SBR, 10), scratch / "moved")[0],
        "dense TPS": lambda: dense(plan, angle),
        "ours": lambda: task.ours("off").points,
        "ours, repaired": lambda: task.ours("auto").points,
    }
    for name, move in methods.items():
        found = measured(move)
        judged = repair_peers.judge(task, found.points, scratch / "judged")
        yield row(plan, angle, name, found, f"{judged.orthogonality:.1f}")


def page(folder: Path, angles: tuple[float, ...]) -> Iterator[str]:
    """Yield the lines of the page."""
    yield f"# Meshes with layers\n\nMade by `python -m benchmarks.layers FOLDER`. {machine()}.\n"
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        for example in examples(folder, scratch):
            yield "\n".join([f"## {example.name}, {example.mesh().point_count} nodes\n", *HEAD])
            for angle in angles:
                yield from rows(example, angle)
            yield ""
        snappy.make(scratch / "snappy", layers=3)
        yield "\n".join(["## snappyHexMesh, 3 layers, half the aircraft, its aileron blended\n", *HEAD])
        for angle in angles:
            yield from snappy_rows(scratch / "snappy", scratch, angle)


def main() -> None:
    """Print the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.layers", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--angles", type=float, nargs="+", default=ANGLES, metavar="DEGREES")
    given = parser.parse_args()
    for line in page(given.folder, tuple(given.angles)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
