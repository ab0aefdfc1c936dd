"""Selection of the cells that pictures of a box can show; nodes keep their indices."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray, union
from sdm_deflect.meshing.formats.shapes import turn_faces
from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.cells import Cells, Polyhedra, Volume, take_faces
from sdm_deflect.meshing.mesh.mesh import Mesh

# A bit for each side of a box.
EVERY_SIDE = 0b111111


def with_near_cells(mesh: Mesh, affected: Sequence[AffectedCells], boxes: Sequence[FloatArray]) -> list[AffectedCells]:
    """Return the affected cells in a mesh with only these and the cells near boxes (2, 3), given by two corners.

    A submesh is reduced to the affected cells: its other cells only serve for their centres, and may lack faces.
    """
    sides = [np.zeros(len(mesh.points), dtype=np.uint8) for _ in boxes] if not mesh.is_part else []
    for bits, (low, high) in zip(sides, boxes, strict=False):
        for axis, places in enumerate(mesh.points.T):
            bits |= (places > low[axis]).astype(np.uint8) << axis
            bits |= (places < high[axis]).astype(np.uint8) << (3 + axis)
    rows = [
        union(*(part.rows[i] for part in affected), *(_between(block, bits) for bits in sides))
        for i, block in enumerate(mesh.cells)
    ]
    whole = mesh.whole and replace(mesh.whole, rows=tuple(map(np.take, mesh.whole.rows, rows)))
    near = replace(mesh, cells=tuple(map(some_cells, mesh.cells, rows)), whole=whole)
    return [replace(part, mesh=near, rows=tuple(map(np.searchsorted, rows, part.rows))) for part in affected]


def _between(block: Volume, bits: np.ndarray) -> IntArray:
    """Return the rows of cells not wholly on one side of a box: their nodes have every bit (N,) among them."""
    if isinstance(block, Cells):
        return np.flatnonzero(np.bitwise_or.reduce([bits[column] for column in block.nodes.T]) == EVERY_SIDE)
    face = np.bitwise_or.reduceat(bits[block.faces.nodes], block.faces.offsets[:-1])
    cell = np.zeros(len(block), dtype=np.uint8)
    np.bitwise_or.at(cell, block.owner, face)
    np.bitwise_or.at(cell, block.neighbour, face[: len(block.neighbour)])
    return np.flatnonzero(cell == EVERY_SIDE)


def some_cells(block: Volume, rows: IntArray) -> Volume:
    """Return the cells of rising rows (R,); faces between these and other polyhedra become boundary faces."""
    if isinstance(block, Cells):
        return Cells(block.shape, block.nodes[rows])
    place = np.full(len(block), -1, dtype=np.intp)
    place[rows] = np.arange(len(rows))
    owner, neighbour = place[block.owner], np.full(len(block.owner), -1)
    neighbour[: len(block.neighbour)] = place[block.neighbour]
    inner, outer = np.flatnonzero((owner >= 0) & (neighbour >= 0)), np.flatnonzero((owner >= 0) != (neighbour >= 0))
    order = np.concatenate([inner, outer])
    faces = turn_faces(take_faces(block.faces, order), owner[order] < 0)
    return Polyhedra(faces, np.where(owner < 0, neighbour, owner)[order], neighbour[inner])
