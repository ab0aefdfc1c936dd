"""Polyhedra that are tetrahedra, pyramids, prisms and hexahedra, given their names back."""

from __future__ import annotations

import numpy as np

from sdm_deflect.deform.mesh import CORNERS, Cells, Mesh, Polygons, Polyhedra
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.polygons import taken
from sdm_deflect.meshing.formats.polyhedral import faces_by_cell
from sdm_deflect.meshing.mesh import IntArray

SIDES = {"tetra": (4, 0), "pyramid": (4, 1), "wedge": (2, 3), "hexahedron": (0, 6)}
"""Numbers of triangles and quadrilaterals of each shape."""


def standard_cells(mesh: Mesh) -> tuple[Cells, ...]:
    """Return the cells of a mesh, with a block of each shape in place of each block of polyhedra.

    The order within a shape is that of the polyhedra.

    Raises
    ------
    MeshFileError
        If some polyhedra are of no such shape.
    """
    cells: list[Cells] = []
    for block in mesh.cells:
        cells += _shapes(block) if isinstance(block, Polyhedra) else [block]
    return tuple(cells)


def _shapes(block: Polyhedra) -> list[Cells]:
    faces, cell = faces_by_cell(block)
    sizes = np.diff(faces.offsets)
    count = {k: np.bincount(cell[sizes == k], minlength=len(block)) for k in (3, 4)}
    every = np.bincount(cell, minlength=len(block))
    found, known = [], 0
    for shape, (triangles, quads) in SIDES.items():
        own = (count[3] == triangles) & (count[4] == quads) & (every == triangles + quads)
        if own.any():
            rows = np.flatnonzero(own[cell])
            nodes = _nodes(shape, taken(faces, rows), int(own.sum()))
            found.append(Cells(shape, nodes))
            known += len(nodes)
    if known < len(block):
        raise MeshFileError(
            f"{len(block) - known} of {len(block)} polyhedra are no tetrahedra, pyramids, prisms or hexahedra, "
            "and the format holds no others"
        )
    return found


def _nodes(shape: str, faces: Polygons, count: int) -> IntArray:
    """Nodes (M, k) in VTK's order of cells of one shape, from all their faces, but for cells not of it."""
    start = faces.nodes.reshape(count, -1)
    after = np.arange(len(faces.nodes)) + 1
    after[faces.offsets[1:] - 1] = faces.offsets[:-1]
    end = faces.nodes[after].reshape(count, -1)
    base = _base(faces, count, 3 if shape in ("tetra", "wedge") else 4)
    opposite = _apex(start, base) if shape in ("tetra", "pyramid") else _opposite(start, end, base)
    if shape != "wedge":  # VTK's wedge has its first face outwards, all others inwards
        turn = [0, *range(base.shape[1] - 1, 0, -1)]
        base, opposite = base[:, turn], opposite[:, turn] if shape == "hexahedron" else opposite
    nodes = np.hstack([base, opposite])
    ordered = np.sort(nodes, axis=1)
    distinct = (np.diff(ordered, axis=1) > 0).all(axis=1)
    same = np.isin(_pairs(start), _pairs(ordered)).reshape(start.shape).all(axis=1)
    chosen: IntArray = nodes[distinct & same & (nodes.shape[1] == CORNERS[shape])]
    return chosen


def _pairs(nodes: IntArray) -> IntArray:
    """One number for each cell and node of it."""
    pairs: IntArray = np.arange(len(nodes))[:, None] * (int(nodes.max()) + 1) + nodes
    return pairs


def _base(faces: Polygons, count: int, corners: int) -> IntArray:
    """Nodes (M, corners) of the first face of each cell with so many corners, normal out of the cell."""
    fits = (np.diff(faces.offsets) == corners).reshape(count, -1)
    first = np.arange(count) * fits.shape[1] + np.argmax(fits, axis=1)
    nodes: IntArray = faces.nodes[faces.offsets[first][:, None] + np.arange(corners)]
    return nodes


def _apex(nodes: IntArray, base: IntArray) -> IntArray:
    """The node (M, 1) that is not on the base."""
    outside = (nodes[:, :, None] != base[:, None, :]).all(axis=2)
    apex: IntArray = np.take_along_axis(nodes, np.argmax(outside, axis=1)[:, None], axis=1)
    return apex


def _opposite(start: IntArray, end: IntArray, base: IntArray) -> IntArray:
    """The node (M, k) that an edge joins to each node of the base, and that is not on the base.

    The edges that begin at a node go to its two neighbours on the base and to that node.
    """
    ahead, behind = np.roll(base, -1, axis=1), np.roll(base, 1, axis=1)
    columns = [np.where(start == base[:, [i]], end, 0).sum(axis=1) for i in range(base.shape[1])]
    opposite: IntArray = np.stack(columns, axis=1) - ahead - behind
    return opposite
