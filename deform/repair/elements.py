"""Cells of every shape as tetrahedra at their corners, each with the shape that it should have."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.mesh import BoolArray, Cells, FloatArray, IntArray, Polyhedra, Volume
from sdm_deflect.deform.quality import CORNERS

REGULAR = np.array([[1.0, 0.5, 0.5], [0.0, np.sqrt(3.0) / 2.0, np.sqrt(3.0) / 6.0], [0.0, 0.0, np.sqrt(2.0 / 3.0)]])
"""Edges (columns) of the regular tetrahedron of edge 1."""
BITS = 10
"""Of each coordinate along the curve: a thousand places."""
FLAT = 1e-3
"""A corner whose determinant is a smaller share of the product of its edges' lengths has no shape to keep."""


@dataclass(frozen=True, slots=True, eq=False)
class Elements:
    """Tetrahedra at the corners of some cells, and which of their nodes are unknown.

    Attributes
    ----------
    used : (M,) indices in the mesh of all their nodes, the unknown ones first.
    unknown : number U of unknown nodes.
    nodes : (E, 4) rows of `used`.
    inverse : (E, 9) inverse of the matrix of the target's edges, row by row.
    cells : (E,) to which of the cells each belongs.
    starts, corners : (U + 1,), (K,) the elements at each unknown node: 4 times the element plus its corner.
    """

    used: IntArray = field(repr=False)
    unknown: int
    nodes: IntArray = field(repr=False)
    inverse: FloatArray = field(repr=False)
    cells: IntArray = field(repr=False)
    starts: IntArray = field(repr=False)
    corners: IntArray = field(repr=False)

    @classmethod
    def of(cls, tetrahedra: Tetrahedra, unknown: IntArray, points: FloatArray) -> Elements:
        """Take the tetrahedra that have one of the `unknown` nodes (U,), with their targets.

        Nodes and elements are ordered along a curve that fills space: neighbours stay together in memory.

        Parameters
        ----------
        points : (N, 3) the mesh before its deflection.
        """
        mark = np.zeros(len(points), dtype=np.bool_)
        mark[unknown] = True
        own = np.flatnonzero(mark[tetrahedra.nodes].any(axis=1))
        nodes = tetrahedra.nodes[own]
        mark[nodes] = True
        mark[unknown] = False
        used = np.concatenate([_along_curve(points, unknown), _along_curve(points, np.flatnonzero(mark))])
        place = np.empty(len(points), dtype=np.intp)
        place[used] = np.arange(len(used))
        rows = place[nodes]
        order = np.argsort(rows.min(axis=1), kind="stable")
        rows, own = rows[order], own[order]
        flat = rows.ravel()
        order = np.argsort(flat, kind="stable")
        starts = np.searchsorted(flat[order], np.arange(len(unknown) + 1))
        return cls(
            used, len(unknown), rows, tetrahedra.inverse(points, own), tetrahedra.cells[own],
            starts, order[: starts[-1]],
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Tetrahedra:
    """The corner tetrahedra of cells.

    Attributes
    ----------
    nodes : (E, 4) node indices in the mesh, right-handed.
    cells : (E,) row, among all cells given, of the one that each belongs to.
    regular : (E,) which of them shall become regular; a corner of any other cell shall have its own shape again.
    """

    nodes: IntArray = field(repr=False)
    cells: IntArray = field(repr=False)
    regular: BoolArray = field(repr=False)

    @classmethod
    def of(cls, points: FloatArray, parts: Iterable[tuple[Volume, IntArray, float]]) -> Tetrahedra:
        """Cut rows of blocks of cells into the tetrahedra at their corners; corners without a shape are left out.

        Parameters
        ----------
        points : (N, 3) the mesh before its deflection.
        parts : Blocks, their rows, and their orientation (-1: nodes are counted left-handed).
        """
        nodes, cells, regular, count = [], [], [], 0
        for block, rows, orientation in parts:
            corners = corners_of(block, rows)
            own = np.repeat(np.arange(count, count + len(rows)), corners.shape[1])
            four = corners.reshape(-1, 4) if orientation > 0 else corners.reshape(-1, 4)[:, [0, 2, 1, 3]]
            simple = isinstance(block, Cells) and block.shape == "tetra"
            if not simple:
                edges = _edges(points, four)
                keep = np.linalg.det(edges) > FLAT * np.prod(np.linalg.norm(edges, axis=1), axis=1)
                four, own = four[keep], own[keep]
            nodes.append(four)
            cells.append(own)
            regular.append(np.full(len(four), simple))
            count += len(rows)
        return cls(np.concatenate(nodes), np.concatenate(cells), np.concatenate(regular))

    def inverse(self, points: FloatArray, rows: IntArray) -> FloatArray:
        """Return the inverses (R, 9) of the matrices of the edges (columns) that some rows should have.

        A regular target has the volume that the tetrahedron has at `points` (N, 3), the mesh before its deflection.
        """
        edges, regular = _edges(points, self.nodes[rows]), self.regular[rows]
        out = np.empty_like(edges)
        size = np.cbrt(np.abs(np.linalg.det(edges[regular])) / np.linalg.det(REGULAR))
        out[regular] = np.linalg.inv(REGULAR) / np.where(size > 0.0, size, 1.0)[:, None, None]
        out[~regular] = np.linalg.inv(edges[~regular])
        return out.reshape(-1, 9)


def corners_of(block: Volume, rows: IntArray) -> IntArray:
    """Return the nodes (R, c, 4) of the tetrahedra at the c corners of each of R cells."""
    if isinstance(block, Polyhedra):
        raise NotImplementedError
    return np.asarray(block.nodes[rows][:, np.array(CORNERS[block.shape])])


def _along_curve(points: FloatArray, nodes: IntArray) -> IntArray:
    """Order nodes (K,) by the Morton code of their places."""
    own = points[nodes]
    low = own.min(axis=0, initial=np.inf)
    size = float((own - low).max(initial=0.0)) or 1.0
    cells = ((own - low) / size * ((1 << BITS) - 1)).astype(np.int64)
    code = np.zeros(len(nodes), dtype=np.int64)
    for bit in range(BITS):
        for axis in range(3):
            code |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.asarray(nodes[np.argsort(code, kind="stable")])


def _edges(points: FloatArray, nodes: IntArray) -> FloatArray:
    """Return the edges (E, 3, 3) of tetrahedra (E, 4) from their first nodes, as columns."""
    return np.asarray(np.moveaxis(points[nodes[:, 1:]] - points[nodes[:, :1]], 1, 2))
