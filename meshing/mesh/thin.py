"""Meshes one cell thick, of any thickness or opening angle, as plane meshes.

A motion is interpolated on the plane mesh: the nodes of the front, moved halfway to the back. Each node of the back
moves like its image.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray, distinct
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.ties import first_largest

from .axis import Axis
from .cells import Cells, Patch, Periodic
from .edges import edges_of, polygons_of, unit
from .images import THIN, Images, fit_motion, match_nodes, translation_between
from .mesh import Mesh

# A normal nearer to a coordinate axis counts as along it.
ALONG = 1e-6
# Bits kept of a distance from a wedge's axis; the last ones depend on the opening angle.
BITS = 40


@dataclass(frozen=True, slots=True, eq=False)
class MidPlane:
    """The plane halfway between the two sides.

    Attributes
    ----------
    component, station : the coordinate along its normal, 0, 1 or 2, and its value there.
    axis, outward : axis of a wedge, and unit vector (3,) in the plane at right angles to it; None for parallel sides.
    """

    component: int
    station: float
    axis: Axis | None = None
    outward: FloatArray | None = None

    @classmethod
    def of(cls, points: FloatArray, pair: Periodic) -> MidPlane | None:
        """Return the plane for two sides at points (N, 3); None if its normal is along no coordinate axis."""
        from scipy.spatial.transform import Rotation

        ends = points[pair.nodes]
        if np.array_equal(pair.rotation, np.eye(3)):
            normal, axis, outward = pair.shift, None, None
        else:
            point = np.linalg.lstsq(np.eye(3) - pair.rotation, pair.shift)[0]
            axis = Axis(np.asarray(point), Rotation.from_matrix(pair.rotation).as_rotvec())
            outward = _along(axis.radial(ends.reshape(-1, 3)).sum(axis=0))
            normal = axis.direction if outward is None else np.cross(axis.direction, outward)
        along = _along(normal)
        if along is None or (axis and outward is None):
            return None
        component = first_largest(np.abs(along))
        low, high = ends[..., component].min(), ends[..., component].max()
        return cls(component, float(axis.point[component] if axis else 0.5 * (low + high)), axis, outward)

    @classmethod
    def from_numbers(cls, numbers: FloatArray) -> MidPlane:
        """Return the plane described by `numbers`; ValueError if they describe none."""
        component, station, *rest = numbers.tolist()
        wedge = np.reshape(rest, (-1, 3))
        return cls([0.0, 1.0, 2.0].index(component), station, *((Axis(*wedge[:2]), wedge[2]) if len(wedge) else ()))

    @property
    def numbers(self) -> FloatArray:
        """The attributes as numbers for a file: 2, or 11 for a wedge."""
        wedge = [*self.axis.point, *self.axis.direction] if self.axis else []
        return np.array([self.component, self.station, *wedge, *([] if self.outward is None else self.outward)])

    def places(self, points: FloatArray) -> FloatArray:
        """Return points (N, 3) moved onto the plane, along its normal or around the axis."""
        out = np.array(points)
        if self.axis and self.outward is not None:
            radial = self.axis.radial(points)
            mantissa, exponent = np.frexp(np.linalg.norm(radial, axis=1, keepdims=True))
            out += np.ldexp(np.round(np.ldexp(mantissa, BITS)), exponent - BITS) * self.outward - radial
        out[:, self.component] = self.station
        return out

    def displacement(self, points: FloatArray, vectors: FloatArray) -> FloatArray:
        """Return the displacement of points (N, 3), given the displacement (N, 3) of their places on the plane."""
        if not self.axis or self.outward is None:
            return vectors
        radial, direction = unit(self.axis.radial(points)), self.axis.direction
        return np.asarray(np.outer(vectors @ direction, direction) + (vectors @ self.outward)[:, None] * radial)


def _along(vector: FloatArray) -> FloatArray | None:
    """Return the unit vector (3,) of the coordinate axis along a vector (3,); None if it is along none."""
    direction = vector / max(float(np.abs(vector).max()), np.finfo(float).tiny)
    axis = np.round(direction) + 0.0
    return axis if np.count_nonzero(axis) == 1 and np.abs(direction - axis).max() < ALONG else None


@dataclass(frozen=True, slots=True, eq=False)
class ThinMesh:
    """A mesh one cell thick and its plane mesh.

    Attributes
    ----------
    mesh : the plane mesh; nodes have the same indices, and those of the back are on no patch.
    points : (N, 3) nodes of the thin mesh.
    nodes : (K, 2) nodes of the front, and their images on the back.
    halfway : the plane between front and back.
    images : all nodes of the thin mesh that move like their images.
    """

    mesh: Mesh = field(repr=False)
    points: FloatArray = field(repr=False)
    nodes: IntArray = field(repr=False)
    halfway: MidPlane
    images: Images = field(repr=False)

    @classmethod
    def of(cls, mesh: Mesh, fixed: Sequence[str] = ()) -> ThinMesh | None:
        """Return the plane mesh; None if a side is fixed, or if the mesh has nodes that are not on its sides."""
        sides = (pair for pair in mesh.periodic if pair.thin and len(distinct(pair.nodes)) == mesh.point_count)
        pair = next(sides, None)
        if pair is None or {*pair.patches}.intersection(fixed):
            return None
        halfway, front = MidPlane.of(mesh.points, pair), np.empty(len(mesh.points), dtype=np.intp)
        front[pair.nodes[:, 1]] = front[pair.nodes[:, 0]] = pair.nodes[:, 0]
        patches = _outlines(mesh, pair, front)
        if halfway is None or patches is None:
            return None
        pairs = [
            replace(periodic, nodes=periodic.nodes[(front[periodic.nodes] == periodic.nodes).all(axis=1)])
            for periodic in mesh.periodic
        ]
        plane = replace(
            mesh,
            points=halfway.places(mesh.points),
            cells=(Cells("triangle", np.empty((0, 3), dtype=np.intp)),),
            patches=patches,
            periodic=tuple(pair for pair in pairs if not pair.thin),
            across=halfway.component,
        )
        return cls(plane, mesh.points, pair.nodes, halfway, Images.of(mesh, pair.patches))

    def slides(self, shapes: Mapping[str, str]) -> dict[str, str]:
        """Return the shapes of sliding patches in the plane mesh: sides have none, a wedge's cylinders are lines."""
        sides = [patch.name for patch in self.mesh.patches if patch.constraint in THIN]
        lines = {"cylinder": "plane"} if self.halfway.axis else {}
        kept = {name: shape for name, shape in shapes.items() if name not in sides or shape != "plane"}
        return {name: shape if name in sides else lines.get(shape, shape) for name, shape in kept.items()}

    def to_whole_mesh(self, places: FloatArray) -> FloatArray:
        """Return the moved nodes (N, 3), given those of the plane mesh (N, 3)."""
        moves = self.displacement(places - self.mesh.points)
        return np.where(moves, self.points + moves, self.points)  # keeps the sign of zeros

    def displacement(self, vectors: FloatArray) -> FloatArray:
        """Return the displacements or rates (N, 3) of both sides, given those of the plane mesh."""
        vectors[self.nodes[:, 1]] = vectors[self.nodes[:, 0]]
        return self.halfway.displacement(self.points, vectors)


def _outlines(mesh: Mesh, pair: Periodic, front: IntArray) -> tuple[Patch, ...] | None:
    """Return the patches as lines between front nodes; each node (N,) has its front node. The two sides have no lines.

    None if a face does not lead from front to back.
    """
    patches = []
    for patch in mesh.patches:
        if patch.constraint in THIN or patch.name in pair.patches:
            patches.append(Patch(patch.name, (), constraint="empty"))
            continue
        edges, face = edges_of(polygons_of(patch.faces))
        front_edges = (front[edges] == edges).all(axis=1)
        if (np.bincount(face[front_edges], minlength=len(patch)) != 1).any():
            return None
        lines = (Cells("line", edges[front_edges]),) if len(patch) else ()
        patches.append(Patch(patch.name, lines, front[patch.loose], patch.constraint))
    return tuple(patches)


def with_sides(mesh: Mesh, planes: Container[str]) -> Mesh:
    """Return the mesh with two of these plane patches as a pair, if it is one cell thick between them."""
    sides = [patch for patch in mesh.patches if patch.name in planes and 2 * len(patch.nodes) == mesh.point_count]
    if len(sides) != 2 or any(pair.thin for pair in mesh.periodic):
        return mesh
    try:
        shift = translation_between(*(mesh.points[side.nodes] for side in sides))
        names = sides[0].name, sides[1].name
        pair = fit_motion(mesh.points, "_".join(names), names, match_nodes(mesh.points, (sides[0], sides[1]), shift))
    except InputError:
        return mesh
    thin_pair = replace(pair, thin=True)
    thin_mesh = replace(mesh, periodic=(*mesh.periodic, thin_pair))
    return thin_mesh if ThinMesh.of(thin_mesh) else mesh
