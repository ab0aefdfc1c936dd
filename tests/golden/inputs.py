"""The meshes that the golden commands deflect: small, and the same bytes every time."""

from pathlib import Path

import numpy as np

from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform import paired
from tests.deform.blocks import block_with_body
from tests.golden.commands import WRITTEN
from tests.meshing.formats.fluent_files import written as fluent_written
from tests.meshing.formats.plot3d_files import BODY, whole_face, with_body
from tests.meshing.formats.plot3d_files import head as plot3d_head
from tests.meshing.formats.plot3d_files import written as plot3d_written
from tests.meshing.formats.wing import wing

TABLE = "x,y,z,dx,dy,dz\n-0.5,0,0,0.02,0,0.01\n0.5,0,0,0.01,0.02,0\n0,0.5,0,0,0,0.02\n0,0,0.5,0.01,0.01,0.01\n"
JOB = """\
fixed = ["wing_*"]
slide = { symmetry = "plane" }
[[surface]]
patches = ["flap_*"]
hinge = [[0.7, 0.3, 0.0], [0.7, 0.7, 0.0]]
motion = "blended"
angle = 6.0
"""
THREE = """\
box_each = true
[[surface]]
patches = ["body0"]
hinge = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
angle = 9.0
[[surface]]
patches = ["body1"]
hinge = [[10.0, 0.0, 0.0], [10.0, 1.0, 0.0]]
angle = -6.0
[[surface]]
patches = ["body2"]
hinge = [[20.0, 0.0, 0.0], [21.0, 0.0, 0.0]]
angle = 12.0
"""
# Names of both patches of a pair, by case.
PAIRS = {
    "cyclic": ("side0", "side1"),
    "empty": ("side0", "side1"),
    "sector": ("left", "right"),
    "wedge": ("front", "back"),
}


def write(folder: Path) -> None:
    """Write all meshes into an empty folder, and what else the commands read."""
    mesh = wing(cells=3).mesh
    for suffix in (*WRITTEN, "lb4.ugrid", "ugrid"):
        path = folder / ("wing" if suffix == "foam" else f"wing.{suffix}")
        FORMATS["openfoam" if suffix == "foam" else _name(suffix)].write(mesh, path)
    fluent_written(mesh, folder / "wing.cas.h5")
    FORMATS["su2"].write(block_with_body(9), folder / "body.su2")
    FORMATS["su2"].write(plane_with_hole(), folder / "flat.su2")
    blocks = with_body()
    plot3d_written(folder / "wing.p3d", blocks)
    rows = [f"body {whole_face(blocks[int(name[5:]) - 1], int(name[5:]), face)}" for name, face in BODY]
    (folder / "wing.nmf").write_text(plot3d_head(blocks) + "\n".join(rows) + "\n")
    (folder / "table.csv").write_text(TABLE)
    (folder / "job.toml").write_text(JOB)
    FORMATS["su2"].write(three_bodies(), folder / "three.su2")
    (folder / "three.toml").write_text(THREE)
    meshes = paired.airfoil(), paired.airfoil(1, 0.1), paired.sector(), paired.wedge()
    for (name, pair), mesh in zip(PAIRS.items(), meshes, strict=True):
        cyclic = name in ("cyclic", "sector")
        paired.written(mesh, folder / name, dict.fromkeys(pair, "cyclic" if cyclic else name), [pair] * cyclic)


def three_bodies() -> Mesh:
    """Return three blocks side by side, each with a body in its middle: ``body0`` to ``body2``."""
    block = block_with_body(7)
    points = np.vstack([block.points + np.array([10.0 * k, 0.0, 0.0]) for k in range(3)])
    starts = [k * len(block.points) for k in range(3)]
    cells = tuple(Cells(one.shape, np.vstack([one.nodes + start for start in starts])) for one in block.cells)
    patches = tuple(
        Patch(f"{patch.name}{k}", tuple(Cells(one.shape, one.nodes + start) for one in patch.faces))
        for k, start in enumerate(starts)
        for patch in block.patches
    )
    return Mesh(points, cells, patches)


def plane_with_hole(n: int = 9) -> Mesh:
    """Return n by n quads of a square of side 4 about the origin, without the nine in the middle."""
    at = np.linspace(-2.0, 2.0, n + 1)
    x, y = np.meshgrid(at, at, indexing="ij")
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    kept = np.ones((n, n), dtype=bool)
    kept[n // 2 - 1 : n // 2 + 2, n // 2 - 1 : n // 2 + 2] = False
    cells = quads[kept]
    lines = np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, row, times = np.unique(np.sort(lines, axis=1), axis=0, return_index=True, return_counts=True)
    edges = lines[row[times == 1]]
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    used, numbers = np.unique(cells, return_inverse=True)
    edges = np.searchsorted(used, edges)
    outer = np.abs(points[used][edges]).max(axis=2).min(axis=1) > 1.9
    patches = (Patch("body", (Cells("line", edges[~outer]),)), Patch("far", (Cells("line", edges[outer]),)))
    return Mesh(points[used], (Cells("quad", numbers.reshape(-1, 4)),), patches)


def _name(suffix: str) -> str:
    return next(name for name in FORMATS if f".{suffix.split('.')[-1]}" in FORMATS[name].suffixes)
