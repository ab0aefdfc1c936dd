"""Any surface as a shape to slide on: the undeformed faces of a patch, cut into triangles."""

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.mesh.cells import Polygons
from sdm_deflect.deform.mesh.closest import Closest, Triangles
from sdm_deflect.deform.mesh.edges import are_lines, rim, sharp_edges, unit

SHARP = 40.0  # degrees between two faces, above which nodes on their edge stay on edges
ON = 1e-9  # of the surface's size: points nearer to it, or to a sharp edge, are on it


@dataclass(frozen=True, slots=True, eq=False)
class TriangleSet:
    """Triangles, or segments, that points are put on.

    Attributes
    ----------
    nodes : (T, 3) rows of `vertices`; a segment has its second end twice.
    vertices : (V, 3).
    search : the closest points of them.
    projectors : (V, 3, 3) what is left at each vertex of a vector along the surface, or along the curve.
    """

    nodes: IntArray = field(repr=False)
    vertices: FloatArray = field(repr=False)
    search: Triangles = field(repr=False)
    projectors: FloatArray = field(repr=False)

    @classmethod
    def faces(cls, vertices: FloatArray, triangles: IntArray) -> "TriangleSet":
        """Take triangles (T, 3); the tangent plane of a vertex is normal to the mean of its triangles' normals."""
        corners = vertices[triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        across = _dominant(unit(normals), np.linalg.norm(normals, axis=1), triangles, len(vertices))
        return cls(triangles, vertices, Triangles.of(corners), np.eye(3) - across[:, :, None] * across[:, None, :])

    @classmethod
    def curves(cls, vertices: FloatArray, edges: IntArray) -> "TriangleSet":
        """Take segments (E, 2); a vertex from which other than two go on, or at a sharp angle, is an end: it stays."""
        vectors = vertices[edges[:, 1]] - vertices[edges[:, 0]]
        along = _dominant(unit(vectors), np.ones(len(edges)), edges, len(vertices))
        projectors = along[:, :, None] * along[:, None, :]
        projectors[_ends(unit(vectors), edges, len(vertices))] = 0.0
        return cls(edges[:, [0, 1, 1]], vertices, Triangles.of(vertices[edges[:, [0, 1, 1]]]), projectors)

    def rate(self, targets: FloatArray, rate: FloatArray, near: float) -> FloatArray:
        """Return the derivative (N, 3) of the closest points of targets (N, 3) that move at a rate (N, 3).

        Triangles drop the normal component, an edge keeps the one along it, a vertex nothing. Of targets nearer than
        `near`, for which this differs from one side to the other, the tangential component is kept.
        """
        hit = self.search.closest(targets)
        corners, off = self.search.corners[hit.rows], hit.weights == 0.0
        on = np.linalg.norm(targets - hit.places, axis=1) <= near
        normal = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
        out = rate - np.sum(rate * normal, axis=1, keepdims=True) * normal
        rows = np.flatnonzero((off.sum(axis=1) == 1) & ~(on & normal.any(axis=1)))
        first, second = np.where(off[rows, 0], 1, 0), np.where(off[rows, 2], 1, 2)
        edge = unit(corners[rows, second] - corners[rows, first])
        out[rows] = np.sum(rate[rows] * edge, axis=1, keepdims=True) * edge
        vertex = off.sum(axis=1) == 2
        out[vertex] = np.einsum("nij,nj->ni", self.projectors[self._vertices(hit)[vertex]], rate[vertex])
        out[vertex & ~on] = 0.0
        return np.asarray(out)

    def at_end(self, points: FloatArray) -> BoolArray:
        """Return which points (N, 3) of a curve are at a vertex that stays."""
        hit = self.search.closest(points)
        return np.asarray((hit.weights.max(axis=1) > 1.0 - ON) & ~self.projectors[self._vertices(hit)].any(axis=(1, 2)))

    def _vertices(self, hit: Closest) -> IntArray:
        """Return the nearest vertex (N,) of each closest point."""
        return np.asarray(self.nodes[hit.rows, np.argmax(hit.weights, axis=1)])


@dataclass(frozen=True, slots=True, eq=False)
class Triangulated:
    """Faces of a patch: points go to the closest point of them, those on its rim or a sharp edge to that of such edges.

    Attributes
    ----------
    faces : the patch, cut into triangles; or its lines.
    ridges : its edges of one face, or whose faces turn by more than `SHARP` degrees; none if it is closed and smooth.
        Lines are ridges.
    near : distance within which a point is on them.
    """

    faces: TriangleSet = field(repr=False)
    ridges: TriangleSet | None = field(repr=False)
    near: float

    @classmethod
    def of(cls, points: FloatArray, faces: Polygons) -> "Triangulated":
        """Take faces, one at least, on points (N, 3) of a whole mesh."""
        used, rows = np.unique(faces.nodes, return_inverse=True)
        own = Polygons(rows.reshape(-1), faces.offsets)
        vertices = np.ascontiguousarray(points[used])
        near = ON * float(np.ptp(vertices, axis=0).max())
        if are_lines(faces):
            curve = TriangleSet.curves(vertices, own.nodes.reshape(-1, 2))
            return cls(curve, curve, near)
        sharp = np.concatenate([rim(own), sharp_edges(vertices, own, SHARP)])
        ridges = TriangleSet.curves(vertices, sharp) if len(sharp) else None
        return cls(TriangleSet.faces(vertices, _cut(own)), ridges, near)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance (N,)."""
        return np.asarray(np.linalg.norm(points - self.faces.search.closest(points).places, axis=1))

    def projected(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Go to the closest point; nodes that do not move keep their bits."""
        out = displacement.copy()
        moved = np.flatnonzero(np.any(displacement, axis=1))
        for pieces, rows, stay in self._bound(points, moved):
            out[rows] = pieces.search.closest(points[rows] + displacement[rows]).places - points[rows]
            out[rows[stay]] = 0.0
        return out

    def rate(self, points: FloatArray, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Differentiate the projection; at points on the surface, where sides may differ, take the tangential part."""
        out = np.zeros_like(rate)
        for pieces, rows, stay in self._bound(points, np.arange(len(points))):
            out[rows] = pieces.rate(points[rows] + displacement[rows], rate[rows], self.near)
            out[rows[stay]] = 0.0
        return out

    def _bound(self, points: FloatArray, rows: IntArray) -> list[tuple[TriangleSet, IntArray, BoolArray]]:
        """Sort rows (M,) of points by the pieces that they are bound to, and say which of them stay."""
        if self.ridges is None:
            return [(self.faces, rows, np.zeros(len(rows), dtype=bool))]
        on = self.ridges.search.within(points[rows], self.near)
        stay = self.ridges.at_end(points[rows[on]])
        return [(self.faces, rows[~on], np.zeros(int((~on).sum()), dtype=bool)), (self.ridges, rows[on], stay)]


def _cut(faces: Polygons) -> IntArray:
    """Return triangles (T, 3): each face cut from its node of the smallest index, so that others who cut it agree."""
    sizes, starts = np.diff(faces.offsets), faces.offsets[:-1]
    found = []
    for size in np.unique(sizes):
        nodes = faces.nodes[starts[sizes == size][:, None] + np.arange(size)]
        nodes = np.take_along_axis(nodes, (np.argmin(nodes, axis=1)[:, None] + np.arange(size)) % size, axis=1)
        found += [nodes[:, [0, k, k + 1]] for k in range(1, size - 1)]
    return np.concatenate(found)


def _dominant(directions: FloatArray, weights: FloatArray, nodes: IntArray, count: int) -> FloatArray:
    """Return the mean direction (V, 3), up to its sign, of the pieces (T,) with nodes (T, k) at each vertex."""
    moments = (weights[:, None, None] * directions[:, :, None] * directions[:, None, :]).reshape(-1, 9)
    flat = nodes.ravel()
    each = np.repeat(moments, nodes.shape[1], axis=0)
    total = np.stack([np.bincount(flat, each[:, k], count) for k in range(9)], axis=1)
    return np.asarray(np.linalg.eigh(total.reshape(-1, 3, 3))[1][:, :, 2])


def _ends(directions: FloatArray, edges: IntArray, count: int) -> BoolArray:
    """Return the vertices (V,) from which other than two segments (E, 2) go on, or two at an angle above `SHARP`."""
    both = np.concatenate([directions, -directions])
    out = np.stack([np.bincount(edges.T.ravel(), both[:, k], count) for k in range(3)], axis=1)
    bent = np.linalg.norm(out, axis=1) > 2.0 * np.sin(np.radians(SHARP / 2.0))
    return np.asarray((np.bincount(edges.ravel(), minlength=count) != 2) | bent)
