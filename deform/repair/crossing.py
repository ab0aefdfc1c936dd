"""Curves on which two surfaces meet: nodes on an edge of the boundary slide along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sdm_deflect.deform.mesh import FloatArray
from sdm_deflect.deform.volume.sliding import CylinderWall, Plane, SlidingSurface

STEEP = 0.1
"""Sine of the angle at which two planes meet, above which their line is known well enough."""


@dataclass(frozen=True, slots=True, eq=False)
class Crossing:
    """The line of two planes, or the ellipse of a plane and a cylinder; each node keeps its distances from both.

    A place on it is known by how far it is from the node along the tangent there.
    """

    plane: Plane
    other: Plane | CylinderWall

    @classmethod
    def of(cls, first: SlidingSurface | None, second: SlidingSurface | None) -> Crossing | None:
        """Return where two shapes meet; None if nodes had better stay there."""
        if isinstance(second, Plane) and not isinstance(first, Plane):
            first, second = second, first
        if isinstance(first, Plane) and isinstance(second, Plane):
            steep = np.linalg.norm(np.cross(first.normal, second.normal)) > STEEP
            return cls(first, second) if steep else None
        return cls(first, second) if isinstance(first, Plane) and isinstance(second, CylinderWall) else None

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance (N,) from the farther of the two."""
        return np.maximum(np.abs(self.plane.distance(points)), np.abs(self.other.distance(points)))

    def projected(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Go as far along the tangent as the displacement does, and from there, within the plane, to the curve."""
        tangent = self._tangent(points)
        out = np.sum(displacement * tangent, axis=1, keepdims=True) * tangent
        if isinstance(self.other, CylinderWall):
            inward = np.cross(self.plane.normal, tangent)
            axis = self.other.cylinder.axis
            own, radial, across = axis.radial(points), axis.radial(points + out), axis.radial(inward + axis.point)
            a, b = np.sum(across**2, axis=1), np.sum(across * radial, axis=1)
            c = np.where(out.any(axis=1), np.sum(radial**2, axis=1) - np.sum(own**2, axis=1), 0.0)
            root = np.sqrt(np.maximum(b * b - a * c, 0.0))
            out -= (c / (b + np.copysign(root, b)))[:, None] * inward
        return np.asarray(out)

    def rate(self, points: FloatArray, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Go on along the curve as fast as the displacement along the tangent of the node."""
        tangent, here = self._tangent(points), self._here(points, displacement)
        return np.asarray(np.sum(rate * tangent, axis=1, keepdims=True) * here)

    def pulled(self, points: FloatArray, displacement: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return the gradient (N, 3) by the displacement, given that by the place."""
        tangent, here = self._tangent(points), self._here(points, displacement)
        return np.asarray(np.sum(gradient * here, axis=1, keepdims=True) * tangent)

    def _here(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Return the tangents (N, 3) at the places, of length 1 along the nodes' own."""
        tangent = self._tangent(points)
        here = self._tangent(points + self.projected(points, displacement))
        return np.asarray(here / np.sum(here * tangent, axis=1, keepdims=True))

    def _tangent(self, points: FloatArray) -> FloatArray:
        """Return the unit tangents (N, 3)."""
        if isinstance(self.other, Plane):
            along = np.broadcast_to(np.cross(self.plane.normal, self.other.normal), points.shape)
        else:
            along = np.cross(self.plane.normal, self.other.cylinder.axis.radial(points))
        return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))
