"""Hexahedra and quads some of whose corners are one point, as the cells and faces that they are.

Structured grids have them at singular lines and points: round an axis, at a wing tip, at a sharp edge.
"""

from collections.abc import Iterable, Iterator
from itertools import permutations, product
from typing import TypeVar

import numpy as np

from sdm_deflect.deform.base.arrays import IntArray
from sdm_deflect.deform.mesh.cells import Cells, Polygons, Polyhedra

Block = TypeVar("Block", Cells | Polygons, Cells | Polyhedra)
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
EDGES = {
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "hexahedron": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
    ),
}  # fmt: skip
FORMS = (
    ("wedge", ((0, 1), (4, 5)), (0, 3, 2, 4, 7, 6)),
    ("pyramid", ((4, 5), (4, 6), (4, 7)), (0, 1, 2, 3, 4)),
    ("tetra", ((2, 3), (4, 5), (4, 6), (4, 7)), (0, 1, 2, 4)),
)
"""A shape, pairs of corners of a hexahedron that are one point in it, and those that are its corners in VTK's order."""


def _turns() -> IntArray:
    """The 24 orders of a hexahedron's corners that turning it brings about."""
    found = []
    for axes, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        turn = np.zeros((3, 3), dtype=np.intp)
        turn[range(3), axes] = signs
        if np.linalg.det(turn) > 0:
            moved = (2 * CORNERS - 1) @ turn
            found.append([int(np.argmin(np.abs(2 * CORNERS - 1 - corner).sum(axis=1))) for corner in moved])
    return np.array(found, dtype=np.intp)


TURNS = _turns()


def expanded(block: Cells) -> Iterator[Cells]:
    """Yield hexahedra or quads as blocks of the shapes that they are, those without a common point first.

    Hexahedra of seven distinct corners stay; quads of two or one are left out.
    """
    if block.shape not in ("hexahedron", "quad"):
        yield block
        return
    if not any(np.any(block.nodes[:, a] == block.nodes[:, b]) for a, b in EDGES[block.shape]):
        yield block
        return
    distinct = 1 + np.count_nonzero(np.diff(np.sort(block.nodes, axis=1), axis=1), axis=1)
    for own in _quads(block.nodes, distinct) if block.shape == "quad" else _hexahedra(block.nodes, distinct):
        if len(own):
            yield own


def simple(blocks: Iterable[Block]) -> Iterator[Block | Cells]:
    """Yield blocks of cells or faces, those with repeated corners as the shapes that they are."""
    for block in blocks:
        yield from expanded(block) if isinstance(block, Cells) else (block,)


def _quads(nodes: IntArray, distinct: IntArray) -> Iterator[Cells]:
    yield Cells("quad", nodes[distinct == 4])
    rows = nodes[distinct == 3]
    again = np.argmax(rows == np.roll(rows, 1, axis=1), axis=1)  # the corner that is the one before it
    yield Cells("triangle", rows[np.arange(len(rows))[:, None], (again[:, None] + np.arange(3)) % 4])


def _hexahedra(nodes: IntArray, distinct: IntArray) -> Iterator[Cells]:
    known = np.zeros(len(nodes), dtype=np.bool_)
    shapes = []
    for shape, one, corners in FORMS:
        found = np.full((len(nodes), len(corners)), -1)
        for turn in TURNS:
            turned = nodes[:, turn]
            fit = (distinct == len(corners)) & np.all([turned[:, a] == turned[:, b] for a, b in one], axis=0)
            found[fit] = turned[fit][:, list(corners)]
        own = found[:, 0] >= 0
        known |= own
        shapes.append(Cells(shape, found[own]))
    yield Cells("hexahedron", nodes[~known])
    yield from shapes
