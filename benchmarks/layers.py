"""What becomes of layers: ``python -m benchmarks.layers --keep KEPT``.

The meshes are made. ``--public FOLDER`` holds two more, ``30p30n_L1_coarse.su2.gz`` and ``717_wl_L2.cgns``: the coarse
mesh of SU2's case "30P30N", and that of CGNS's case "717". Each mesh is deflected with and without repair. The points
are kept in KEPT, and the page is KEPT/layers.md. A deflection whose points are kept is not made again.

It needs ``cgnsconvert`` and snappyHexMesh (``apt-get install --no-install-recommends cgns-convert openfoam``).
"""

import argparse
import gzip
import runpy
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.c_grid import c_grid
from benchmarks.measure import FloatArray, processor_seconds
from sdm_deflect.cases.api import deflect, read
from sdm_deflect.deform.checks import FEW, GROWTH, LAYER_CHANGE, MOST_CHANGE, MOST_TILT
from sdm_deflect.deform.volume.plan import BoxPlan
from sdm_deflect.geometry.datum import hinge_line
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.edges import area_vectors, polygons_of, unit
from sdm_deflect.meshing.mesh.layers import LayerChange, LayerColumns
from sdm_deflect.meshing.mesh.mesh import Mesh
from studies.machine import machine
from tests.cases import snappy
from tests.meshing.formats.blunt_wing import blunt_wing
from tests.meshing.formats.wing import wing

BLENDED: dict[str, Any] = {"surfaces": "flap", "motion": "blended", "fixed": "wing"}
# Layers in the table, from the wall.
LAYERS = (1, 2, 5, 8, 10)
ROOT = Path(__file__).parents[1]
HEAD = (
    "| angle | repair | least | 1 % | inverted | " + " | ".join(f"layer {k}" for k in LAYERS)
    + " | columns changed | `layer_height` | s |",
    "| ---: | --- | ---: | ---: | ---: |" + " --- |" * len(LAYERS) + " ---: | --- | ---: |",
)  # fmt: skip
ABOUT = """Made by `python -m benchmarks.layers --keep KEPT --public FOLDER`. {machine}.

A flap is turned by an angle, with and without the repair. Least and 1 % are of all cells in the box: scaled Jacobian,
or mean ratio of tetrahedra. For layers 1, 2, 5, 8 and 10 over the moved walls stand the largest tilt of a cell against
its wall face, in degrees, and the least and the largest height, as shares of the height before. "Columns changed" are
those where the height of one of the first five layers changed by more than {change:.0%}. Up to {most:.0%} they are
usable, if none tilts by more than {tilt:g} degrees and the first layer grows by more than {growth:.0%} in {few:.1%} of
them at most. Seconds are the processor's.
"""


@dataclass(frozen=True, slots=True)
class Example:
    """A mesh: its key and title, how it is made, the settings that deflect it, and the angles."""

    key: str
    title: str
    mesh: Callable[[], Mesh]
    settings: dict[str, Any]
    angles: tuple[float, ...]


def public(folder: Path, kept: Path) -> Iterator[Example]:
    """Yield the public meshes of a folder."""
    plain = kept / "30p30n.su2"
    if not plain.exists():
        plain.write_bytes(gzip.decompress((folder / "30p30n_L1_coarse.su2.gz").read_bytes()))
    for key, hinge in (("slot", (0.4, -0.01)), ("slot2", (0.41, -0.005))):
        settings: dict[str, Any] = {"surfaces": "flap", "hinge": [hinge], "fixed": "wall", "select": {"flap": "wall#3"}}
        angles = (-30.0, -25.0, -20.0, 10.0, 20.0, 30.0)
        yield Example(key, f"30P30N, flap about {hinge}", partial(read, plain), settings, angles)
    file = kept / "717.cgns"
    if not file.exists():
        subprocess.run(["cgnsconvert", "-h", folder / "717_wl_L2.cgns", file], check=True)
    rear = "wall side:5.5,0,4.3,4.1,0,-1.1 box:-inf,-inf,4.3,inf,inf,8.4"
    settings = {**BLENDED, "select": {"flap": rear}, "fixed": "wall", "strip": 0.05}
    settings["hinge"] = [[5.5, -0.15, 4.3], [6.6, -0.15, 8.4]]
    yield Example("717", "717 wing, the rear of its inner half", partial(read, file), settings, (-30.0, 20.0, 30.0))


def examples(kept: Path) -> Iterator[Example]:
    """Yield the meshes that are made; those that take long are kept as files."""
    tip = partial(blunt_wing, flap=(0.7, 1.0), hinge=0.75, first=6e-7, layers=50, growth=1.28, around=60, along=24)
    settings = {**BLENDED, "hinge": [[0.75, 0.7, 0.0], [0.75, 1.0, 0.0]]}
    yield Example(
        "tip", "Wing tip of hexahedra, first layer 6e-7, flap up to the tip", tip, settings, (-20.0, 12.0, 25.0)
    )
    for chord, flap, first, strip in (
        (0.7, (0.3, 0.7), 1e-5, 0.1), (0.7, (0.3, 0.7), 1e-6, 0.1), (0.95, (0.4, 0.6), 6e-8, 0.04),
    ):  # fmt: skip
        ends = [[chord, y, 0.0] for y in flap]
        settings = {**BLENDED, "hinge": ends, "slide": {"symmetry": "plane", "end": "plane"}, "strip": strip}
        pieces = (np.linspace(a, b, 14)[:-1] for a, b in ((0.0, flap[0]), flap, (flap[1], 1.0)))
        span = np.append(np.concatenate(list(pieces)), 1.0)
        title = f"C-grid, first layer {first:g}, flap behind {chord:g} of the chord"
        yield Example(f"c-grid-{first:g}", title, partial(c_grid, chord, flap, first, span), settings, (-20.0, 20.0))
    guide = {**BLENDED, "hinge": [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]], "slide": {"symmetry": "plane"}}
    yield Example("half", "The guide's half wing", partial(_half_wing, kept), guide, (15.0, 30.0))
    title = "The guide's half wing with 20 layers from 1e-6"
    yield Example("layered", title, partial(layered, kept), guide, (-20.0, 20.0, 30.0))
    coarse = wing(first_height=1e-6, layers=20)
    settings = {**BLENDED, "surfaces": "flap_*", "fixed": "wing_*", "hinge": coarse.hinge, "strip": 0.1}
    title = "Coarse half wing of hexahedra, prisms and tetrahedra, blended strip two cells wide"
    yield Example("coarse", title, lambda: coarse.mesh, settings, (-20.0, 10.0, 30.0))
    settings = {**BLENDED, "hinge": [[0.7, 0.3, 0.0], [0.7, 0.7, 0.0]], "slide": {"symmetry": "plane"}}
    four = (-20.0, -5.0, 5.0, 20.0)
    yield Example("blunt", "Wing with a blunt trailing edge, first layer 2e-4", blunt_wing, settings, four)
    fine = partial(blunt_wing, first=1e-6, layers=40, growth=1.35, around=36, along=30)
    yield Example("blunt-fine", "The same, finer, first layer 1e-6", fine, settings, four)
    if not (kept / "snappy").exists():
        snappy.make(kept / "snappy", layers=3)
    fixed = [f"{name}_left" for name in ("wing", "strake", "tail", "ventral")] + ["fuselage*", "canopy", "inlet", "fin"]
    settings = {"surfaces": snappy.SURFACE, "motion": "blended", "hinge": hinge_line(Fighter(), snappy.SURFACE)}
    settings["fixed"] = fixed
    title = "snappyHexMesh, 3 layers, half the aircraft, its aileron blended"
    yield Example("snappy", title, partial(read, kept / "snappy"), settings, (-20.0, 20.0, 30.0))
    if not (kept / "fighter.su2").exists():
        subprocess.run([sys.executable, "-m", "sdm_deflect", "example", "--fighter", kept], check=True)
    given = tomllib.loads((kept / "fighter.toml").read_text(encoding="utf-8"))
    settings = {"surfaces": given["surface"], "fixed": given["fixed"], "box_each": given["box_each"]}
    yield Example(
        "fighter", "The fighter of tetrahedra, all surfaces", partial(read, kept / "fighter.su2"), settings, (0.0,)
    )


def _half_wing(folder: Path) -> Mesh:
    if not (folder / "naca.su2").exists():
        runpy.run_path(str(ROOT / "docs/examples/naca_wing.py"))["build"](folder)
    return read(folder / "naca.su2")


def layered(folder: Path, first: float = 1e-6, count: int = 20, growth: float = 1.3) -> Mesh:
    """Return the guide's half wing, its wall pushed outwards over layers of prisms that grow by a factor."""
    mesh, walls = _half_wing(folder), ("wing", "flap")
    wall, old = mesh.on(*walls), mesh.points
    faces, normal = polygons_of(mesh.faces_of(walls)), np.zeros_like(old)
    np.add.at(normal, faces.nodes, np.repeat(unit(area_vectors(old, faces)), np.diff(faces.offsets), axis=0))
    normal = -unit(normal)[wall]
    normal[old[wall, 1] == old[mesh.patch("symmetry").nodes, 1].min(), 1] = 0.0
    heights = first * (growth ** np.arange(count + 1) - 1.0) / (growth - 1.0)
    new = old.copy()
    new[wall] += heights[-1] * normal
    points = np.vstack([new, *(old[wall] + height * normal for height in heights[:-1])])
    column = np.empty((count + 1, len(old)), dtype=np.intp)
    column[:], row = np.arange(len(old)), np.arange(len(wall))
    column[:-1, wall] = len(old) + len(wall) * np.arange(count)[:, None] + row
    faces_of = {name: mesh.patch(name).faces[0].nodes for name in mesh.names}
    triangles = np.concatenate([faces_of[name] for name in walls])
    wedges = np.concatenate([np.hstack([column[k][triangles], column[k + 1][triangles]]) for k in range(count)])
    edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    root = edges[np.isin(edges, mesh.patch("symmetry").nodes).all(axis=1)]
    quads = np.concatenate([np.column_stack([column[k][root], column[k + 1][root[:, ::-1]]]) for k in range(count)])
    faces_of |= {name: column[0][faces_of[name]] for name in walls}
    patches = [Patch(name, (Cells("triangle", nodes),)) for name, nodes in faces_of.items()]
    side = mesh.names.index("symmetry")
    patches[side] = Patch("symmetry", (*patches[side].faces, Cells("quad", quads)))
    (tets,) = mesh.cells
    return Mesh(points, (tets, Cells("wedge", wedges)), tuple(patches))


def rows(example: Example, kept: Path) -> Iterator[str]:
    """Yield the rows of a mesh; deflect it where no points are kept."""
    mesh = example.mesh()
    yield "\n".join([f"## {example.title}\n", f"{mesh.point_count:,} nodes.\n", *HEAD])
    for angle in example.angles:
        settings = {**example.settings, "angle": angle} if angle else example.settings
        plain = deflect(mesh, **settings, repair="off")
        plans = plain.deflection.plan.boxes
        for mode in ("off", "auto"):
            name = f"{example.key}_{angle:+g}_{mode}.npz"
            if not (kept / name).exists():
                begin = processor_seconds()
                points = np.asarray(deflect(mesh, **settings, repair=mode).points)
                np.savez_compressed(kept / name, points=points, seconds=processor_seconds() - begin)
            with np.load(kept / name) as found:
                measured = row(plans, found["points"], float(found["seconds"]))
            yield f"| {angle:+g} | {mode} | {measured} |"
    yield ""


def row(plans: tuple[BoxPlan, ...], points: FloatArray, seconds: float) -> str:
    """Return the figures of a mesh at points (N, 3)."""
    scores = [plan.affected.scores(points) for plan in plans]
    quality = np.concatenate([one.quality for one in scores])
    inverted = sum(int(plan.affected.newly_inverted(points).sum()) for plan in plans)
    plan = plans[0]
    columns = LayerColumns.of(plan.affected, plan.walls, kept=max(LAYERS))

    def change(start: int, stop: int) -> LayerChange:
        some = replace(columns, cells=columns.cells[start:stop])
        return LayerChange.of(some, plan.mesh.points, points, plan.moved_walls, plan.mesh.normal)

    cells = []
    for k in LAYERS:
        one = change(k - 1, k)
        some = len(one.least) > 0
        cells.append(f"{one.tilts.max():.0f}°, {one.least.min():.2f}..{one.most.max():.2f}" if some else "")
    first, five = change(0, 5), change(0, 5).changes
    many, most = int(np.count_nonzero(five > LAYER_CHANGE)), float(five.max(initial=0.0))
    thicker = np.count_nonzero(first.growth > GROWTH) > max(1.0, FEW * len(five))
    failed = most > MOST_CHANGE or thicker or first.tilts.max(initial=0.0) > MOST_TILT
    verdict = "FAILED" if failed else "usable" if most > LAYER_CHANGE else "passed"
    verdict = f"{verdict}, {most:.3f}" if len(five) else "no layers"
    figures = f"{quality.min():.3f} | {np.percentile(quality, 1.0):.3f} | {inverted}"
    return f"{figures} | {' | '.join(cells)} | {many} of {len(five)} | {verdict} | {seconds:.1f}"


def main() -> None:
    """Deflect what is not kept, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.layers", description=__doc__)
    parser.add_argument("--keep", type=Path, required=True, metavar="KEPT")
    parser.add_argument("--public", type=Path, metavar="FOLDER")
    parser.add_argument("--only", nargs="*", metavar="KEY")
    given = parser.parse_args()
    given.keep.mkdir(parents=True, exist_ok=True)
    about = ABOUT.format(
        machine=machine(), change=LAYER_CHANGE, few=FEW, most=MOST_CHANGE, tilt=MOST_TILT, growth=GROWTH
    )
    lines = ["# Meshes with layers\n", about]
    for example in (*(public(given.public, given.keep) if given.public else ()), *examples(given.keep)):
        if not given.only or example.key in given.only:
            for line in rows(example, given.keep):
                print(line, flush=True)
                lines.append(line)
    (given.keep / "layers.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
