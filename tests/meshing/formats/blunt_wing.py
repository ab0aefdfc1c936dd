"""A half wing with a blunt trailing edge and a flat tip under layers of hexahedra, as a mesher of layers makes them.

``python -m tests.meshing.formats.blunt_wing`` writes the mesh of ``sdm example --layers`` again.
"""

from __future__ import annotations

import lzma
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh

# The mesh of ``sdm example --layers``.
EXAMPLE = Path(__file__).parents[3] / "cases" / "layers.su2.xz"
# Significant digits of the example's coordinates: a thousandth of its first layer.
DIGITS = 7
# Span, in chords.
SPAN = 1.0
# Height of the trailing edge, in chords.
BASE = 0.012


def blunt_wing(
    flap: tuple[float, float] = (0.3, 0.7), hinge: float = 0.7, first: float = 2e-4, layers: int = 18,
    growth: float = 1.5, around: int = 12, along: int = 9,
) -> Mesh:  # fmt: skip
    """Return a wing of chord 1 whose flap spans y = flap[0] to flap[1] behind x = hinge.

    Each node of the wall is the foot of one column, along the mean of the normals there. So columns lean by 45 degrees
    and more at the edges of the base and of the tip. The mesh ends where its last layer does.

    Parameters
    ----------
    first, layers, growth : Height of the first layer, number of layers, and ratio of the heights of two layers.
    around : Cells along each of the upper and the lower surface, one third of them behind the hinge.
    along : Cells along the span.
    """
    section, span = _section(hinge, around), _span(flap, along)
    wall = np.stack([np.column_stack([section[:, 0], np.full(len(section), y), section[:, 1]]) for y in span])
    points = wall.reshape(-1, 3)
    faces, triangle = _faces(len(section), len(span))
    normal = _normals(points, faces, triangle)
    root = points[:, 1] == 0.0
    normal[root, 1] = 0.0
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    heights = first * np.concatenate([[0.0], np.cumsum(growth ** np.arange(layers))])
    grid = np.concatenate([points + height * normal for height in heights])
    size = len(points)
    levels = size * np.arange(layers)[:, None, None]
    bricks, prisms = (np.concatenate([own + levels, own + levels + size], axis=2) for own in (faces, triangle[:, ::-1]))
    cells = (Cells("hexahedron", bricks.reshape(-1, 8)), Cells("wedge", prisms.reshape(-1, 6)))
    edge = np.flatnonzero(root)
    sides = np.column_stack([np.roll(edge, -1), edge])
    symmetry = np.concatenate([np.column_stack([sides, sides[:, ::-1] + size]) + size * k for k in range(layers)])
    return Mesh(grid, cells, _patches(points, faces, triangle, symmetry, size * layers, flap, hinge))


def _section(hinge: float, around: int) -> FloatArray:
    """Points (2 N + 1, 2) from the upper trailing edge over the nose to the lower one."""
    behind = np.linspace(1.0, hinge, around // 3 + 1)
    ahead = hinge * (1.0 - np.cos(np.linspace(np.pi / 2.0, 0.0, around - around // 3 + 1)))[1:]
    x = np.concatenate([behind, ahead])
    powers = np.stack([np.sqrt(x), x, x**2, x**3, x**4])
    z = 0.6 * np.array([0.2969, -0.1260, -0.3516, 0.2843, -0.1036]) @ powers + 0.5 * BASE * x
    return np.concatenate([np.column_stack([x, z]), np.column_stack([x, -z])[-2::-1]])


def _span(flap: tuple[float, float], along: int) -> FloatArray:
    stops = np.unique([0.0, *flap, SPAN])
    pieces = [np.linspace(a, b, max(2, round(along * (b - a) / SPAN)) + 1)[:-1] for a, b in pairwise(stops)]
    return np.concatenate([*pieces, [SPAN]])


def _faces(section: int, stations: int) -> tuple[IntArray, IntArray]:
    """Quadrilaterals (F, 4) of the wall with the tip, and the triangle (1, 3) at the tip's nose; normals outwards."""
    grid = np.arange(section * stations).reshape(stations, section)
    ahead = np.roll(grid, -1, axis=1)
    sides = np.stack([grid[:-1], grid[1:], ahead[1:], ahead[:-1]], axis=-1).reshape(-1, 4)
    tip, nose = grid[-1], section // 2
    upper, lower = tip[: nose + 1], tip[: nose - 1 : -1]
    cap = np.column_stack([upper[:-2], lower[:-2], lower[1:-1], upper[1:-1]])
    return np.concatenate([sides, cap]), np.array([[upper[-2], lower[-2], lower[-1]]])


def _normals(points: FloatArray, faces: IntArray, triangle: IntArray) -> FloatArray:
    """Sums (N, 3) of the unit normals of the faces at each node."""
    out = np.zeros_like(points)
    for own in (faces, triangle):
        across = np.cross(points[own[:, 2]] - points[own[:, 0]], points[own[:, -1]] - points[own[:, 1]])
        np.add.at(out, own, (across / np.linalg.norm(across, axis=1)[:, None])[:, None, :])
    return out


def _patches(
    points: FloatArray, faces: IntArray, triangle: IntArray, symmetry: IntArray, last: int, flap: tuple[float, float],
    hinge: float,
) -> tuple[Patch, ...]:  # fmt: skip
    """Patches ``wing``, ``flap``, ``symmetry`` and ``far_field``; `last` is the first node of the last layer.

    A flap up to the tip has its part of the tip.
    """
    x, y, _ = points[faces].mean(axis=1).T
    moves = (x > hinge) & (flap[0] < y) & ((y < flap[1]) | (flap[1] == SPAN))
    tip = Cells("triangle", triangle[:, ::-1])
    return (
        Patch("wing", (Cells("quad", faces[~moves][:, ::-1]), tip)),
        Patch("flap", (Cells("quad", faces[moves][:, ::-1]),)),
        Patch("symmetry", (Cells("quad", symmetry),)),
        Patch("far_field", (Cells("quad", faces + last), Cells("triangle", triangle + last))),
    )


def packed() -> bytes:
    """Return the bytes of the example."""
    mesh = blunt_wing(around=15, along=11, layers=16)
    rounded = [[float(f"{value:.{DIGITS}g}") for value in point] for point in mesh.points]
    with TemporaryDirectory() as folder:
        path = Path(folder, "layers.su2")
        FORMATS["su2"].write(mesh.with_points(np.array(rounded)), path)
        return lzma.compress(path.read_bytes(), preset=9 | lzma.PRESET_EXTREME)


if __name__ == "__main__":
    EXAMPLE.write_bytes(packed())
