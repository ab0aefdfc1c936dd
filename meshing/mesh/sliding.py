"""Shapes on which boundary nodes slide: planes and cylinders fitted to a patch, or its undeflected faces."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, distinct
from sdm_deflect.base.errors import InputError

from .axis import Axis, Cylinder
from .cells import Polygons
from .closest import Closest, Triangles
from .edges import are_lines, polygons_of, rim, sharp_edges, unit
from .mesh import Mesh

# Degrees between two faces, above which nodes on their edge stay on edges.
SHARP = 40.0
# Points nearer than this share of the surface's size are on it, or on a sharp edge.
ON = 1e-9
# Largest distance of a patch's nodes from a shape, as a share of the patch's size: files with six digits keep this.
RESIDUAL = 1e-5
# A normal nearer to a coordinate axis becomes the axis, so that coordinates along it keep their bits.
SNAP = 1e-6
# Largest number of nodes for fitting a cylinder; all nodes are checked.
SAMPLE = 2000
# Name of the shape that is the patch's own surface.
SURFACE = "surface"


@dataclass(frozen=True, slots=True, eq=False)
class TriangleSet:
    """Triangles, or segments, onto which points are projected.

    Attributes
    ----------
    nodes : (T, 3) rows of `vertices`; a segment has its second end twice.
    vertices : (V, 3) coordinates.
    search : search for the closest points.
    projectors : (V, 3, 3) projection at each vertex onto the tangent plane, or the tangent.
    """

    nodes: IntArray = field(repr=False)
    vertices: FloatArray = field(repr=False)
    search: Triangles = field(repr=False)
    projectors: FloatArray = field(repr=False)

    @classmethod
    def faces(cls, vertices: FloatArray, triangles: IntArray) -> "TriangleSet":
        """Return triangles (T, 3) as a set; a vertex's normal is the mean of its triangles' normals."""
        corners = vertices[triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        across = _dominant(unit(normals), np.linalg.norm(normals, axis=1), triangles, len(vertices))
        return cls(triangles, vertices, Triangles.of(corners), np.eye(3) - across[:, :, None] * across[:, None, :])

    @classmethod
    def curves(cls, vertices: FloatArray, edges: IntArray) -> "TriangleSet":
        """Return segments (E, 2) as a set; a vertex stays unless it has two segments without a sharp angle."""
        vectors = vertices[edges[:, 1]] - vertices[edges[:, 0]]
        along = _dominant(unit(vectors), np.ones(len(edges)), edges, len(vertices))
        projectors = along[:, :, None] * along[:, None, :]
        projectors[_ends(unit(vectors), edges, len(vertices))] = 0.0
        return cls(edges[:, [0, 1, 1]], vertices, Triangles.of(vertices[edges[:, [0, 1, 1]]]), projectors)

    def rate(self, targets: FloatArray, rate: FloatArray, near: float) -> FloatArray:
        """Return the derivative (N, 3) of the closest points to targets (N, 3) that move at a rate (N, 3).

        On triangles the normal component is dropped; on edges the component along them stays; on vertices nothing
        stays. Targets nearer than `near`, where the two sides may differ, keep the tangential component.
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
        """Return the vertex (N,) nearest to each closest point."""
        return np.asarray(self.nodes[hit.rows, np.argmax(hit.weights, axis=1)])


@dataclass(frozen=True, slots=True, eq=False)
class Triangulated:
    """Faces of a patch; points go to the closest point on them, or on their sharp edges and rim.

    Attributes
    ----------
    faces : the patch, cut into triangles; or its lines.
    ridges : edges with one face, or with faces that turn by more than `SHARP` degrees; empty for a closed smooth patch.
        Lines are ridges.
    near : distance below which a point counts as on the faces or ridges.
    """

    faces: TriangleSet = field(repr=False)
    ridges: TriangleSet | None = field(repr=False)
    near: float

    @classmethod
    def of(cls, points: FloatArray, faces: Polygons) -> "Triangulated":
        """Cut faces, at least one, into triangles; points (N, 3) are those of the whole mesh."""
        used, rows = np.unique(faces.nodes, return_inverse=True)
        polygons = Polygons(rows.reshape(-1), faces.offsets)
        vertices = np.ascontiguousarray(points[used])
        near = ON * float(np.ptp(vertices, axis=0).max())
        if are_lines(faces):
            curve = TriangleSet.curves(vertices, polygons.nodes.reshape(-1, 2))
            return cls(curve, curve, near)
        sharp = np.concatenate([rim(polygons), sharp_edges(vertices, polygons, SHARP)])
        ridges = TriangleSet.curves(vertices, sharp) if len(sharp) else None
        return cls(TriangleSet.faces(vertices, _triangulate(polygons)), ridges, near)

    def distance(self, points: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.norm(points - self.faces.search.closest(points).places, axis=1))

    def projected(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Go to the closest point; nodes that do not move keep their bits."""
        out = displacement.copy()
        moved = np.flatnonzero(np.any(displacement, axis=1))
        for pieces, rows, stay in self._bind(points, moved):
            out[rows] = pieces.search.closest(points[rows] + displacement[rows]).places - points[rows]
            out[rows[stay]] = 0.0
        return out

    def rate(self, points: FloatArray, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Differentiate the projection; points on the surface keep the tangential component."""
        out = np.zeros_like(rate)
        for pieces, rows, stay in self._bind(points, np.arange(len(points))):
            out[rows] = pieces.rate(points[rows] + displacement[rows], rate[rows], self.near)
            out[rows[stay]] = 0.0
        return out

    def _bind(self, points: FloatArray, rows: IntArray) -> list[tuple[TriangleSet, IntArray, BoolArray]]:
        """Yield the faces and then the ridges, each with the points (M,) bound to it and which of these stay."""
        if self.ridges is None:
            return [(self.faces, rows, np.zeros(len(rows), dtype=bool))]
        on = self.ridges.search.within(points[rows], self.near)
        stay = self.ridges.at_end(points[rows[on]])
        return [(self.faces, rows[~on], np.zeros(int((~on).sum()), dtype=bool)), (self.ridges, rows[on], stay)]


def _triangulate(faces: Polygons) -> IntArray:
    """Return triangles (T, 3); each face is cut from its node of lowest index, so that the cut is unique."""
    sizes, starts = np.diff(faces.offsets), faces.offsets[:-1]
    triangles = []
    for size in np.unique(sizes):
        nodes = faces.nodes[starts[sizes == size][:, None] + np.arange(size)]
        nodes = np.take_along_axis(nodes, (np.argmin(nodes, axis=1)[:, None] + np.arange(size)) % size, axis=1)
        triangles += [nodes[:, [0, k, k + 1]] for k in range(1, size - 1)]
    return np.concatenate(triangles)


def _dominant(directions: FloatArray, weights: FloatArray, nodes: IntArray, count: int) -> FloatArray:
    """Return the mean direction (V, 3), up to its sign, of the pieces with `nodes` (T, k) at each vertex."""
    moments = (weights[:, None, None] * directions[:, :, None] * directions[:, None, :]).reshape(-1, 9)
    flat = nodes.ravel()
    each = np.repeat(moments, nodes.shape[1], axis=0)
    total = np.stack([np.bincount(flat, each[:, k], count) for k in range(9)], axis=1)
    return np.asarray(np.linalg.eigh(total.reshape(-1, 3, 3))[1][:, :, 2])


def _ends(directions: FloatArray, edges: IntArray, count: int) -> BoolArray:
    """Return the vertices (V,) without exactly two segments (E, 2), or with an angle above `SHARP`."""
    both = np.concatenate([directions, -directions])
    out = np.stack([np.bincount(edges.T.ravel(), both[:, k], count) for k in range(3)], axis=1)
    bent = np.linalg.norm(out, axis=1) > 2.0 * np.sin(np.radians(SHARP / 2.0))
    return np.asarray((np.bincount(edges.ravel(), minlength=count) != 2) | bent)


class SlidingSurface(Protocol):
    """A shape on which nodes stay."""

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance (N,) of points (N, 3)."""
        ...

    def projected(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Return the displacement (N, 3) that keeps points on the shape."""
        ...

    def rate(self, points: FloatArray, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the derivative (N, 3) of `projected` for displacements that change at a rate (N, 3)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane through `point` (3,) with unit `normal` (3,); in a plane mesh a line, with its normal in that plane."""

    point: FloatArray
    normal: FloatArray

    @classmethod
    def fitted(cls, points: FloatArray, across: FloatArray | None = None) -> "Plane":
        """Return the least-squares plane of points (N, 3); a normal that is nearly along an axis is set to it.

        In a plane mesh with the normal `across` (3,) the plane is a line.
        """
        center = points.mean(axis=0)
        if across is not None:
            normal, within = np.zeros(3), across == 0.0
            normal[within] = np.linalg.svd((points - center)[:, within], full_matrices=False)[2][1]
        else:
            normal = np.linalg.svd(points - center, full_matrices=False)[2][2]
        axis = np.round(normal)
        if np.abs(normal - axis).max() < SNAP:
            normal = axis + 0.0
        return cls(center, normal)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance (N,)."""
        return np.asarray((points - self.point) @ self.normal)

    def projected(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Remove the normal component; coordinates along an axis keep their bits."""
        return self.rate(points, displacement, displacement)

    def rate(self, points: FloatArray, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Remove the normal component."""
        del points, displacement
        return np.asarray(rate - np.outer(rate @ self.normal, self.normal))


@dataclass(frozen=True, slots=True, eq=False)
class CylinderWall:
    """A circular cylinder; in a plane mesh a circle."""

    cylinder: Cylinder

    @classmethod
    def fitted(cls, points: FloatArray, across: FloatArray | None = None) -> "CylinderWall":
        """Return the least-squares cylinder of points (N, 3); the search starts from each principal direction.

        In a plane mesh with the normal `across` (3,) the cylinder is a circle.
        """
        some = points[np.linspace(0, len(points) - 1, min(SAMPLE, len(points))).astype(int)]
        if across is not None:
            return cls(_fit_cylinder(some, across, slopes=0))
        directions = np.linalg.svd(some - some.mean(axis=0), full_matrices=False)[2]
        fits = [_fit_cylinder(some, direction) for direction in directions]
        return cls(min(fits, key=lambda shape: float(np.abs(shape.distance(some)).max())))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance (N,), positive outside."""
        return self.cylinder.distance(points)

    def projected(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Move nodes back radially; each keeps its distance from the axis, and its bits if it does not move."""
        radial = self.cylinder.axis.radial(points + displacement)
        short = self._stretch(points, radial) - 1.0
        return np.asarray(displacement + np.where(np.any(displacement, axis=1, keepdims=True), short * radial, 0.0))

    def rate(self, points: FloatArray, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Differentiate the radial projection."""
        axis = self.cylinder.axis
        radial = axis.radial(points + displacement)
        outward = radial / np.linalg.norm(radial, axis=1, keepdims=True)
        along = np.outer(rate @ axis.direction, axis.direction)
        across = rate - along
        across -= np.sum(across * outward, axis=1, keepdims=True) * outward
        return np.asarray(along + self._stretch(points, radial) * across)

    def _stretch(self, points: FloatArray, radial: FloatArray) -> FloatArray:
        """Return the factors (N, 1) that give radial vectors the length of the nodes' radial vectors."""
        reach = np.linalg.norm(self.cylinder.axis.radial(points), axis=1, keepdims=True)
        return np.asarray(reach / np.linalg.norm(radial, axis=1, keepdims=True))


# Functions that fit a shape to the nodes of a patch, given the normal of a plane mesh.
FITTED: dict[str, Callable[[FloatArray, FloatArray | None], SlidingSurface]] = {
    "plane": Plane.fitted,
    "cylinder": CylinderWall.fitted,
}
SHAPES = (*FITTED, SURFACE)
NAMES = f"{', '.join(FITTED)} or {SURFACE}"


def fit_shape(shape: str, points: FloatArray, patch: str, across: FloatArray | None = None) -> SlidingSurface:
    """Fit a shape to the nodes (N, 3) of a patch, in a plane mesh with its normal (3,), and check it.

    Raises InputError if the shape is unknown, or the patch does not have it.
    """
    if shape not in FITTED:
        raise InputError(f"slide = {patch}:{shape}: the shape must be {NAMES}")
    if len(points) < (2 if across is not None and shape == "plane" else 3):
        raise InputError(f"slide = {patch}:{shape}: {len(points)} nodes do not determine a {shape}")
    surface, size = FITTED[shape](points, across), float(np.ptp(points, axis=0).max())
    off = float(np.abs(surface.distance(points)).max())
    if not off <= RESIDUAL * size:
        raise InputError(
            f"slide = {patch}:{shape}: the patch is no {shape}; of {len(points)} nodes one lies {off:.3g} off the "
            f"best one, {off / size:.1e} of its size (allowed {RESIDUAL:.0e}); parts that "
            f"lie apart are {patch}#1, {patch}#2, ...; any shape is a {SURFACE}"
        )
    return surface


@dataclass(frozen=True, slots=True, eq=False)
class SlidingPatch:
    """A sliding patch: its shape, and all its nodes (K,)."""

    patch: str
    surface: SlidingSurface
    nodes: IntArray = field(repr=False)

    @classmethod
    def of(cls, mesh: Mesh, name: str, shape: str) -> "SlidingPatch":
        """Fit a shape to a patch, or use its faces; InputError if the patch has another shape or no faces."""
        nodes = mesh.patch(name).nodes
        if shape != SURFACE:
            return cls(name, fit_shape(shape, mesh.points[nodes], name, mesh.normal), nodes)
        faces = polygons_of(mesh.patch(name).faces)
        if len(distinct(faces.nodes)) < len(nodes) or not len(faces):
            raise InputError(f"slide = {name}:{shape}: the patch needs faces that hold all of its {len(nodes)} nodes")
        return cls(name, Triangulated.of(mesh.points, faces), nodes)


def _fit_cylinder(points: FloatArray, direction: FloatArray, slopes: int = 2) -> Cylinder:
    """Return axis and radius fitted from a first direction; the unknowns are offsets, radius and perhaps slopes."""
    from scipy.optimize import least_squares  # loading takes 0.1 s

    center, size = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    u = np.linalg.svd(direction[None])[2][1]
    v = np.cross(direction, u)
    flat = np.column_stack([(points - center) @ u, (points - center) @ v]) / size
    x, y, c = np.linalg.lstsq(np.column_stack([2.0 * flat, np.ones(len(flat))]), np.sum(flat**2, axis=1))[0]

    def made(p: FloatArray) -> Cylinder:
        along = direction + p[3] * u + p[4] * v if slopes else direction
        return Cylinder(Axis(center + size * (p[0] * u + p[1] * v), along), size * max(abs(float(p[2])), 1e-12))

    first = np.array([x, y, np.sqrt(max(c + x * x + y * y, 1e-12)), *np.zeros(slopes)])
    return made(least_squares(lambda p: made(p).distance(points) / size, first, xtol=1e-15, ftol=1e-15, gtol=1e-15).x)
