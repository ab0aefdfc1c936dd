"""Determinants and edges of very many tetrahedra, compiled: the formulas of `quality`, to the same bits."""

import numpy as np

from sdm_deflect.deform.mesh import FloatArray, IntArray
from sdm_deflect.deform.rbf.compiled import compiled_exactly
from sdm_deflect.deform.rbf.threads import in_chunks

WEIGHT = 40
"""Work on one tetrahedron in kernel pairs, by which `in_chunks` shares it out."""


def measured(points: FloatArray, tets: IntArray, rows: IntArray | None) -> FloatArray:
    """Return determinants, and sums of the squared lengths of edges, (2, R) of tetrahedra (M, 4), all or some rows."""
    own = np.empty(0, dtype=np.intp) if rows is None else rows
    out = np.empty((2, len(tets) if rows is None else len(rows)))
    in_chunks(lambda start, stop: _measure(points, tets, own, out, (start, stop)), out.shape[1], WEIGHT)
    return out


@compiled_exactly
def _measure(
    points: FloatArray, tets: IntArray, rows: IntArray, out: FloatArray, part: tuple[int, int]
) -> None:  # pragma: no cover - machine code
    for i in range(part[0], part[1]):
        row = rows[i] if len(rows) else i
        o, p, q, r = tets[row, 0], tets[row, 1], tets[row, 2], tets[row, 3]
        ax, ay, az = points[p, 0] - points[o, 0], points[p, 1] - points[o, 1], points[p, 2] - points[o, 2]
        bx, by, bz = points[q, 0] - points[o, 0], points[q, 1] - points[o, 1], points[q, 2] - points[o, 2]
        cx, cy, cz = points[r, 0] - points[o, 0], points[r, 1] - points[o, 1], points[r, 2] - points[o, 2]
        out[0, i] = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        squares = ax * ax + ay * ay + az * az
        squares += bx * bx + by * by + bz * bz
        squares += cx * cx + cy * cy + cz * cz
        dx, dy, dz = bx - ax, by - ay, bz - az
        squares += dx * dx + dy * dy + dz * dz
        dx, dy, dz = cx - ax, cy - ay, cz - az
        squares += dx * dx + dy * dy + dz * dz
        dx, dy, dz = cx - bx, cy - by, cz - bz
        out[1, i] = squares + (dx * dx + dy * dy + dz * dz)
