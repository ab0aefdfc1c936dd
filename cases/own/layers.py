"""Prism layers: the height of the first cells over the walls, before and after."""

from dataclasses import dataclass

import numpy as np

from sdm_deflect.cases.own.edges import rows_of
from sdm_deflect.cases.own.quality import Touched
from sdm_deflect.cases.own.surface import BoolArray
from sdm_deflect.deform.mesh import Cells, Polyhedra
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray

BASES = {
    "wedge": (((0, 1, 2), (3, 4, 5)), ((3, 4, 5), (0, 1, 2))),
    "hexahedron": (
        ((0, 1, 2, 3), (4, 5, 6, 7)), ((4, 5, 6, 7), (0, 1, 2, 3)), ((0, 1, 5, 4), (3, 2, 6, 7)),
        ((3, 2, 6, 7), (0, 1, 5, 4)), ((0, 3, 7, 4), (1, 2, 6, 5)), ((1, 2, 6, 5), (0, 3, 7, 4)),
    ),
}  # fmt: skip
"""Faces that may lie on a wall, and the nodes opposite to them."""
BLOCK = 1 << 16
FLAT = 0.2  # height over the longest edge on the wall, below which a cell counts as one of a layer


@dataclass(frozen=True, slots=True)
class Layers:
    """Change of the first layer's height, which is the length of the edges that leave the wall.

    Attributes
    ----------
    edges : number of these edges, as often as cells have them.
    lowest : smallest height before.
    largest, p99 : largest relative change, and the one that 99 % of the edges keep.
    """

    edges: int
    lowest: float
    largest: float
    p99: float


def first_layer(touched: Touched, walls: IndexArray, points: FloatArray) -> Layers | None:
    """Compare heights over the walls' nodes before and with the nodes at `points` (N, 3); None without prisms."""
    wall = np.zeros(len(points), dtype=bool)
    wall[walls] = True
    before, after = [], []
    for block, rows in zip(touched.subject.cells, touched.rows, strict=True):
        if isinstance(block, Polyhedra) or block.shape not in BASES:
            continue
        for base, top in _first_cells(block, rows, wall):
            flat = _flat(touched.subject.points, base, top)
            before.append(_height(touched.subject.points, base[flat], top[flat]))
            after.append(_height(points, base[flat], top[flat]))
    if not sum(len(part) for part in before):
        return None
    low, change = np.concatenate(before), np.concatenate(after)
    change = np.abs(change / low - 1.0)
    return Layers(len(low), float(low.min()), float(change.max()), float(np.percentile(change, 99.0)))


def _first_cells(block: Cells, rows: IndexArray, wall: BoolArray) -> list[tuple[IndexArray, IndexArray]]:
    """Return nodes on the wall and nodes opposite, of cells with one face on the wall."""
    found = []
    for part in rows_of(len(rows), BLOCK):
        nodes = block.nodes[rows[part]]
        on = wall[nodes]
        for base, top in BASES[block.shape]:
            first = on[:, list(base)].all(axis=1) & ~on[:, list(top)].any(axis=1)
            if first.any():
                found.append((nodes[first][:, list(base)], nodes[first][:, list(top)]))
    return found


def _flat(points: FloatArray, base: IndexArray, top: IndexArray) -> BoolArray:
    """Return which cells (C,) are flat: others over a wall are no layer."""
    around = np.linalg.norm(points[base] - points[np.roll(base, 1, axis=1)], axis=2)
    height = np.linalg.norm(points[top] - points[base], axis=2)
    return np.asarray(height.max(axis=1) < FLAT * around.max(axis=1))


def _height(points: FloatArray, base: IndexArray, top: IndexArray) -> FloatArray:
    """Return the lengths of the edges that leave the wall."""
    return np.asarray(np.linalg.norm(points[top] - points[base], axis=2).ravel())
