"""Near a boundary the mesh follows the nearest boundary node, and turns with it: prism layers keep their heights.

The interpolant is smooth across a thin surface, but nothing makes it rigid beside one, and at boundary nodes that are
no centres it is off by up to the tolerance. Two things mend that. Some mesh nodes beside a moving surface, the
*layer sites*, become data sites that go where their node x_j carries them, x_j + u_j + R_j (p - x_j), R_j being the
surface's local rotation: the field then turns with the surface. And every node p close to a boundary is moved to

    p + u(p) + psi (u_j + (R_j - 1)(p - x_j) - u(p)),

with u the interpolant and a weight psi that fades out away from the boundary, and where another one that may move
otherwise comes as near: in the middle of a gap the interpolant is alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.base.arrays import FloatArray, IntArray

NEAR, FAR = 0.1, 0.5  # edges of the surface: layer sites are as far from it, so only meshes with layers have any
ALONE = 0.5  # of the distance to another part of the boundary: layer sites are nearer to their own
MOST = 30_000  # layer sites


class Nearby(NamedTuple):
    """For each of M points the nearest boundary node, its distance, and that of the next part of the boundary."""

    node: IntArray
    first: FloatArray
    second: FloatArray

    @classmethod
    def of(cls, points: FloatArray, boundary: FloatArray, parts: Sequence[IntArray]) -> "Nearby":
        """Look among boundary nodes (K, 3); `parts` are rows of those that may move differently, each in one part."""
        first, second = np.full(len(points), np.inf), np.full(len(points), np.inf)
        node = np.zeros(len(points), dtype=np.intp)
        for part in parts:
            if len(part):
                distance, nearest = cKDTree(boundary[part]).query(points)
                closer = distance < first
                second = np.where(closer, first, np.minimum(second, distance))
                node[closer], first[closer] = part[nearest[closer]], distance[closer]
        return cls(node, first, second)


@dataclass(frozen=True, slots=True, eq=False)
class RigidFollow:
    """Points that boundary nodes carry along.

    Attributes
    ----------
    rows : (Q,) rows of the points.
    node : (Q,) row of the boundary node that carries each.
    offset : (Q, 3) from that node to the point.
    """

    rows: IntArray = field(repr=False)
    node: IntArray = field(repr=False)
    offset: FloatArray = field(repr=False)

    @classmethod
    def of(cls, points: FloatArray, boundary: FloatArray, rows: IntArray, nearby: Nearby) -> "RigidFollow":
        """Let the nearest boundary nodes carry some rows of the points."""
        node = nearby.node[rows]
        return cls(rows, node, points[rows] - boundary[node])

    def displaced(self, boundary: FloatArray, turns: FloatArray) -> FloatArray:
        """Return the displacements (Q, 3) for those (K, 3) of the boundary, turned by R - 1 (K, 3, 3)."""
        return np.asarray(boundary[self.node] + np.einsum("qij,qj->qi", turns[self.node], self.offset))


def layer_sites(nearby: Nearby, moving: int, edge: float) -> IntArray:
    """Return rows of the points that become data sites: the farthest allowed one for each of the first nodes.

    Parameters
    ----------
    nearby : Of the points.
    moving : The first so many boundary nodes have layer sites.
    edge : Median edge of the surface.
    """
    first = nearby.first
    good = (nearby.node < moving) & (first > NEAR * edge) & (first < FAR * edge) & (first < ALONE * nearby.second)
    rows = np.flatnonzero(good)
    rows = rows[np.lexsort((-first[rows], nearby.node[rows]))]
    _, own = np.unique(nearby.node[rows], return_index=True)
    return rows[own][:: max(1, -(-len(own) // MOST))]


@dataclass(frozen=True, slots=True, eq=False)
class NearWall:
    """Points near a boundary, and how far they follow it.

    Attributes
    ----------
    follow : those points.
    weight : (Q,) psi(r) = (1 - r)**4 (4 r + 1) of Wendland: 1 at the boundary, with no slope there.
    """

    follow: RigidFollow
    weight: FloatArray = field(repr=False)

    @classmethod
    def of(cls, points: FloatArray, boundary: FloatArray, nearby: Nearby, reach: float) -> "NearWall":
        """Take the points within `reach` of boundary nodes (K, 3), and nearer to them than to another part."""
        limit = np.minimum(reach, nearby.second)
        rows = np.flatnonzero(nearby.first < limit)
        r = nearby.first[rows] / limit[rows]
        return cls(RigidFollow.of(points, boundary, rows, nearby), (1.0 - r) ** 4 * (4.0 * r + 1.0))

    def following(self, displacement: FloatArray, boundary: FloatArray, turns: FloatArray) -> FloatArray:
        """Return the displacement (M, 3) of points that follow a boundary displaced by (K, 3), turned by R - 1."""
        out, rows = np.array(displacement), self.follow.rows
        out[rows] += self.weight[:, None] * (self.follow.displaced(boundary, turns) - out[rows])
        return out
