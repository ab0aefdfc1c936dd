"""Curves on which two surfaces meet: nodes on an edge of the boundary slide along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.mesh.sliding import CylinderWall, Plane, SlidingSurface

STEEP = 0.1
"""Sine of the angle at which two planes meet, above which their line is known well enough."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Curves through nodes (K,) at rest; a place is known by how far it is from the node along the tangent there.

    Attributes
    ----------
    tangent : (K, 3) unit vectors.
    inward : (K, 3) unit vectors, in the planes of the ellipses, on which these are reached from their tangents; 0 of
        lines.
    radial, along, across : (K, 3) the parts of nodes, tangents and inward vectors that are normal to a cylinder's axis.
    """

    tangent: FloatArray = field(repr=False)
    inward: FloatArray = field(repr=False)
    radial: FloatArray = field(repr=False)
    along: FloatArray = field(repr=False)
    across: FloatArray = field(repr=False)

    @classmethod
    def joined(cls, some: Sequence[Tracks]) -> Tracks:
        """Return one for all the nodes of some others."""
        none = np.empty((0, 3))
        return cls(*(np.concatenate([none, *(getattr(one, name) for one in some)]) for name in cls.__slots__))

    def projected(self, way: FloatArray) -> FloatArray:
        """Return the ways (K, 3) to the places on the curves that are as far along the tangents as ways (K, 3)."""
        far = np.einsum("ij,ij->i", way, self.tangent)
        return np.asarray(far[:, None] * self.tangent + self._aside(far)[:, None] * self.inward)

    def slope(self, way: FloatArray) -> FloatArray:
        """Return the derivatives (K, 3) of the places by how far they are along the tangents."""
        far = np.einsum("ij,ij->i", way, self.tangent)
        radial = self.radial + far[:, None] * self.along + self._aside(far)[:, None] * self.across
        inward = np.einsum("ij,ij->i", radial, self.across)
        aside = -np.einsum("ij,ij->i", radial, self.along) / np.where(inward == 0.0, 1.0, inward)
        return np.asarray(self.tangent + aside[:, None] * self.inward)

    def _aside(self, far: FloatArray) -> FloatArray:
        """Return how far (K,) the curves are from the tangents: the smaller root of a a^2 + 2 b a + c = 0."""
        beside = far[:, None] * self.along
        radial = self.radial + beside
        a, b = (np.einsum("ij,ij->i", one, self.across) for one in (self.across, radial))
        c = np.einsum("ij,ij->i", self.radial + radial, beside)
        sum_of_both = b + np.copysign(np.sqrt(np.maximum(b * b - a * c, 0.0)), b)
        return np.asarray(-c / np.where(sum_of_both == 0.0, np.inf, sum_of_both))


@dataclass(frozen=True, slots=True, eq=False)
class Crossing:
    """The line of two planes, or the ellipse of a plane and a cylinder; each node keeps its distances from both."""

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

    def tracks(self, points: FloatArray) -> Tracks:
        """Return the curves through points (K, 3)."""
        if isinstance(self.other, Plane):
            along = np.cross(self.plane.normal, self.other.normal)
            tangent = np.tile(along / np.linalg.norm(along), (len(points), 1))
            nothing = np.zeros_like(points)
            return Tracks(tangent, nothing, nothing, nothing, nothing)
        axis = self.other.cylinder.axis
        radial = axis.radial(points)
        tangent = np.cross(self.plane.normal, radial)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        inward = np.cross(self.plane.normal, tangent)
        return Tracks(tangent, inward, radial, *(axis.radial(one + axis.point) for one in (tangent, inward)))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance (N,) from the farther of the two."""
        return np.maximum(np.abs(self.plane.distance(points)), np.abs(self.other.distance(points)))

    def projected(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Go as far along the tangent as the displacement does, and from there, within the plane, to the curve."""
        return self.tracks(points).projected(displacement)

    def rate(self, points: FloatArray, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Go on along the curve as fast as the displacement along the tangent of the node."""
        tracks = self.tracks(points)
        along = np.einsum("ij,ij->i", rate, tracks.tangent)
        return np.asarray(along[:, None] * tracks.slope(displacement))
