"""Do cells keep a positive volume, and what shape have they? Corner Jacobians of every cell type.

At each corner of a cell, the determinant of its three edges is the volume they span. A cell is inverted if one of
them is not positive (a tetrahedron has one for all corners). The scaled Jacobian divides by the edges' lengths: 1 for
the ideal cell.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.cases.own.edges import rows_of
from sdm_deflect.deform.mesh import Cells
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray

BLOCK = 1 << 13  # cells at a time: temporaries stay in the processor's cache
CORNERS = {
    "tetra": ((0, 1, 2, 3), (1, 0, 3, 2), (2, 3, 0, 1), (3, 2, 1, 0)),
    "pyramid": ((0, 1, 3, 4), (1, 2, 0, 4), (2, 3, 1, 4), (3, 0, 2, 4)),
    "wedge": ((0, 2, 1, 3), (1, 0, 2, 4), (2, 1, 0, 5), (3, 4, 5, 0), (4, 5, 3, 1), (5, 3, 4, 2)),
    "hexahedron": (
        (0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7), (4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3),
    ),
}  # fmt: skip
"""A corner and the three others at its edges, right-handed, in VTK's order of nodes."""
IDEAL = {"tetra": np.sqrt(2.0), "pyramid": np.sqrt(2.0), "wedge": 2.0 / np.sqrt(3.0), "hexahedron": 1.0}
"""Reciprocal of the ideal cell's product of unit edges at a corner."""


def smallest_jacobian(points: FloatArray, cells: Cells, rows: IndexArray | None = None) -> FloatArray:
    """Return the smallest corner Jacobian (R,) of cells, or of some rows of them; volume units."""
    corners: Sequence[tuple[int, ...]] = CORNERS[cells.shape][: 1 if cells.shape == "tetra" else None]
    return _least(points, cells, rows, corners, _plain)


def scaled_jacobian(points: FloatArray, cells: Cells, rows: IndexArray | None = None) -> FloatArray:
    """Return the smallest scaled Jacobian (R,) of cells: between -1 and 1 but for rounding, 1 is ideal."""
    return np.asarray(IDEAL[cells.shape] * _least(points, cells, rows, CORNERS[cells.shape], _scaled))


def touching(cells: Cells, moved: NDArray[np.bool_]) -> IndexArray:
    """Return the rows of cells with a node in the mask `moved` (N,); block by block, in little memory."""
    parts = [
        rows.start + np.flatnonzero(moved[cells.nodes[rows]].any(axis=1)) for rows in rows_of(len(cells), BLOCK)
    ]
    return np.concatenate([np.empty(0, dtype=np.intp), *parts])


def _least(
    points: FloatArray,
    cells: Cells,
    rows: IndexArray | None,
    corners: Sequence[tuple[int, ...]],
    measure: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
) -> FloatArray:
    """Return the smallest measure of three edges over the corners of each cell."""
    count = len(cells) if rows is None else len(rows)
    out = np.empty(count)
    for part in rows_of(count, BLOCK):
        nodes = cells.nodes[part if rows is None else rows[part]]
        p = np.ascontiguousarray(points[nodes].transpose(1, 2, 0))  # (k, 3, R): coordinates stand one after another
        values = (measure(p[b] - p[a], p[c] - p[a], p[d] - p[a]) for a, b, c, d in corners)
        least = next(values)
        for value in values:
            np.minimum(least, value, out=least)
        out[part] = least
    return out


def _plain(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return the determinants (R,) of edges (3, R)."""
    return np.asarray(
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


def _scaled(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    squares = np.ones(a.shape[1])
    for edge in (a, b, c):
        squares *= edge[0] * edge[0] + edge[1] * edge[1] + edge[2] * edge[2]
    return np.asarray(_plain(a, b, c) / np.sqrt(np.maximum(squares, np.finfo(float).tiny)))
