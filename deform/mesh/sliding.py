"""Shapes on which boundary nodes slide: planes and cylinders, fitted and verified, and any surface as it is."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray, distinct
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.axis import Axis, Cylinder
from sdm_deflect.deform.mesh.edges import polygons_of
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.triangulated import Triangulated

RESIDUAL = 1e-5  # of the patch's size: files with six digits keep this
SNAP = 1e-6  # a normal nearer to a coordinate axis than this is the axis
SAMPLE = 2000  # nodes that a cylinder is fitted to; all are verified


class SlidingSurface(Protocol):
    """A shape on which nodes stay."""

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance (N,) of points (N, 3) from it."""
        ...

    def projected(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Return the displacement (N, 3) that is left when points may not leave it."""
        ...

    def rate(self, points: FloatArray, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the derivative (N, 3) of `projected`, given that of the displacement."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane through `point` (3,) with unit `normal` (3,); in a plane mesh it is a line, whose normal has no z."""

    point: FloatArray
    normal: FloatArray

    @classmethod
    def fitted(cls, points: FloatArray, line: bool = False) -> "Plane":
        """Return the least-squares plane of points (N, 3), or line; along coordinate axes where that is so."""
        center = points.mean(axis=0)
        if line:
            normal = np.append(np.linalg.svd((points - center)[:, :2], full_matrices=False)[2][1], 0.0)
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
        """Drop the normal component: in a plane along the axes that coordinate keeps its bits."""
        return self.rate(points, displacement, displacement)

    def rate(self, points: FloatArray, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Drop the normal component."""
        del points, displacement
        return np.asarray(rate - np.outer(rate @ self.normal, self.normal))


@dataclass(frozen=True, slots=True, eq=False)
class CylinderWall:
    """A circular cylinder; in a plane mesh it is a circle."""

    cylinder: Cylinder

    @classmethod
    def fitted(cls, points: FloatArray, circle: bool = False) -> "CylinderWall":
        """Return the least-squares cylinder of points (N, 3), started from each principal direction; or circle."""
        some = points[np.linspace(0, len(points) - 1, min(SAMPLE, len(points))).astype(int)]
        if circle:
            return cls(_fit_cylinder(some, np.array([0.0, 0.0, 1.0]), slopes=0))
        directions = np.linalg.svd(some - some.mean(axis=0), full_matrices=False)[2]
        fits = [_fit_cylinder(some, direction) for direction in directions]
        return cls(min(fits, key=lambda one: float(np.abs(one.distance(some)).max())))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance (N,), positive outside."""
        return self.cylinder.distance(points)

    def projected(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Move radially back: each node keeps its own distance from the axis, and its bits if it did not move."""
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
        """Return (N, 1) what brings radial vectors back to the length of the nodes' own."""
        own = np.linalg.norm(self.cylinder.axis.radial(points), axis=1, keepdims=True)
        return np.asarray(own / np.linalg.norm(radial, axis=1, keepdims=True))


FITTED: dict[str, Callable[[FloatArray, bool], SlidingSurface]] = {
    "plane": Plane.fitted,
    "cylinder": CylinderWall.fitted,
}
"""How a shape is fitted to the nodes of a patch; True: of a plane mesh."""
SURFACE = "surface"
"""The shape of a patch that is taken as it is."""
SHAPES = (*FITTED, SURFACE)
NAMES = f"{', '.join(FITTED)} or {SURFACE}"


def fitted(shape: str, points: FloatArray, patch: str, plane: bool = False) -> SlidingSurface:
    """Fit a shape to the nodes (N, 3) of a patch, perhaps of a plane mesh, and verify it.

    Raises InputError if the shape is unknown, or the patch is not of that shape.
    """
    if shape not in FITTED:
        raise InputError(f"slide = {patch}:{shape}: the shape must be {NAMES}")
    if len(points) < (2 if plane and shape == "plane" else 3):
        raise InputError(f"slide = {patch}:{shape}: {len(points)} nodes do not determine a {shape}")
    surface, size = FITTED[shape](points, plane), float(np.ptp(points, axis=0).max())
    off = float(np.abs(surface.distance(points)).max())
    if not off <= RESIDUAL * size:
        raise InputError(
            f"slide = {patch}:{shape}: the patch is no {shape}; of {len(points)} nodes one lies {off:.3g} off the "
            f"best one, {off / size:.1e} of its size (allowed {RESIDUAL:.0e}); any shape is a {SURFACE}"
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
        """Fit a shape to a patch, or take its faces; InputError if it has another shape, or no faces."""
        nodes = mesh.patch(name).nodes
        if shape != SURFACE:
            return cls(name, fitted(shape, mesh.points[nodes], name, mesh.plane), nodes)
        faces = polygons_of(mesh.patch(name).faces)
        if len(distinct(faces.nodes)) < len(nodes) or not len(faces):
            raise InputError(f"slide = {name}:{shape}: the patch needs faces that hold all of its {len(nodes)} nodes")
        return cls(name, Triangulated.of(mesh.points, faces), nodes)


def _fit_cylinder(points: FloatArray, direction: FloatArray, slopes: int = 2) -> Cylinder:
    """Fit axis and radius from a first direction; parameters are offsets across it, the radius and, if any, slopes."""
    from scipy.optimize import least_squares  # takes a tenth of a second to load

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
