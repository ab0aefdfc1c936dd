"""Near a boundary the mesh follows the nearest boundary node, and turns with it: prism layers keep their heights.

The interpolant is smooth across a thin surface, but nothing makes it rigid beside one, and at boundary nodes that are
no centres it is off by up to the tolerance. So a point p near node x_j goes where x_j carries it,

    p + u(p) + psi (u_j + (R_j - 1)(p - x_j) - u(p)),

with u the interpolant, R_j the surface's local rotation, and a weight psi that fades out away from the boundary and
where another one that may move otherwise comes as near: in the middle of a gap the interpolant is alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from deform.duplicates import IndexArray
from deform.kernels import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Nearest:
    """For points near a boundary, the nearest boundary node and how far they follow it.

    Attributes
    ----------
    rows : (Q,) rows of the points that are near.
    node : (Q,) row of the nearest boundary node.
    offset : (Q, 3) from that node to the point.
    weight : (Q,) psi(r) = (1 - r)**4 (4 r + 1) of Wendland: 1 at the boundary, with no slope there.
    """

    rows: IndexArray = field(repr=False)
    node: IndexArray = field(repr=False)
    offset: FloatArray = field(repr=False)
    weight: FloatArray = field(repr=False)

    @classmethod
    def of(cls, points: FloatArray, boundary: FloatArray, parts: Sequence[IndexArray], reach: float) -> "Nearest":
        """Find the nearest of boundary nodes (K, 3) within `reach` of points (M, 3).

        `parts` are the rows of boundary nodes that may move differently, each row in one part.
        """
        first, second = np.full(len(points), np.inf), np.full(len(points), np.inf)
        node = np.zeros(len(points), dtype=np.intp)
        for part in parts:
            if len(part):
                distance, nearest = cKDTree(boundary[part]).query(points)
                closer = distance < first
                second = np.where(closer, first, np.minimum(second, distance))
                node[closer], first[closer] = part[nearest[closer]], distance[closer]
        limit = np.minimum(reach, second)
        rows = np.flatnonzero(first < limit)
        r = first[rows] / limit[rows]
        return cls(rows, node[rows], points[rows] - boundary[node[rows]], (1.0 - r) ** 4 * (4.0 * r + 1.0))

    def followed(self, displacement: FloatArray, boundary: FloatArray, turns: FloatArray) -> FloatArray:
        """Return the displacement (M, 3) of points that follow a boundary displaced by (K, 3), turned by R - 1."""
        out = np.array(displacement)
        carried = boundary[self.node] + np.einsum("qij,qj->qi", turns[self.node], self.offset)
        out[self.rows] += self.weight[:, None] * (carried - out[self.rows])
        return out
