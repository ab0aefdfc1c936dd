"""The section of tetrahedra by a plane across an axis."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from sdm_deflect.deform.mesh import FloatArray, IntArray

APART = np.array([[0, 1, 2, 3], [1, 0, 2, 3], [2, 0, 1, 3], [3, 0, 1, 2]])
"""Corners of a tetrahedron: the one that is alone on its side of the plane, then the others."""
PAIRED = np.array([[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 0, 2], [2, 3, 0, 1]])
"""Corners of a tetrahedron: two on one side of the plane, then the two on the other."""


@dataclass(frozen=True, slots=True)
class Plane:
    """All points whose coordinate `axis` (0, 1, 2) is `position` (m)."""

    axis: int
    position: float

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return how far points (..., 3) lie on the positive side, metres."""
        return np.asarray(points[..., self.axis] - self.position)


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Polygons in which a plane cuts tetrahedra.

    Attributes
    ----------
    points : (P, 3) m: three for each triangle, then four for each quadrilateral.
    triangles, quads : rows of the tetrahedra that give a triangle (A,) and a quadrilateral (B,); P = 3 A + 4 B.
    """

    points: FloatArray
    triangles: IntArray
    quads: IntArray

    @classmethod
    def of(cls, points: FloatArray, tets: IntArray, plane: Plane) -> Self:
        """Cut tetrahedra (M, 4) on points (N, 3); a node in the plane counts as on its positive side."""
        height = plane.beyond(points)
        above = (height >= 0.0)[tets]
        count = above.sum(axis=1)
        alone, both = np.flatnonzero((count == 1) | (count == 3)), np.flatnonzero(count == 2)
        minority = above[alone] == (count[alone] == 1)[:, None]
        a = np.take_along_axis(tets[alone], APART[np.argmax(minority, axis=1)], axis=1)
        first = np.argmax((above[both][:, PAIRED[:, :2]]).all(axis=2), axis=1)
        b = np.take_along_axis(tets[both], PAIRED[first], axis=1)
        corners = (
            np.stack([a[:, [0, 0, 0]], a[:, [1, 2, 3]]], axis=-1).reshape(-1, 2),
            np.stack([b[:, [0, 0, 1, 1]], b[:, [2, 3, 3, 2]]], axis=-1).reshape(-1, 2),
        )
        return cls(_crossings(points, height, np.vstack(corners)), alone, both)

    @property
    def cells(self) -> IntArray:
        """Rows (A + B,) of the tetrahedra, in the order of the polygons."""
        return np.concatenate([self.triangles, self.quads])


def _crossings(points: FloatArray, height: FloatArray, edges: IntArray) -> FloatArray:
    """Return where edges (E, 2) cross the plane above which their nodes are so high."""
    start, end = edges.T
    share = height[start] / (height[start] - height[end])
    return np.asarray(points[start] + share[:, None] * (points[end] - points[start]))
