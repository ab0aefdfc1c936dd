"""Faces of an overlapping block that cut the box: their nodes stay in the plane of the face (section 5.2)."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray

from .modifier import Linearized, Modifier, ModifierAtStep, NodesOnShape


@dataclass(frozen=True, slots=True, eq=False)
class StayInFaces(Modifier):
    """Faces: for each its patch, its nodes, and the direction of its normal, 0, 1 or 2."""

    faces: tuple[tuple[str, IntArray, int], ...] = field(repr=False)

    def shapes(self) -> Sequence[NodesOnShape]:
        """Return each patch with its nodes, which stay in its plane."""
        return [NodesOnShape(patch, nodes, "plane", of_patch=True) for patch, nodes, _ in self.faces]

    def at(self, points: FloatArray, free: IntArray) -> "StayingInFaces":
        del points
        return StayingInFaces(tuple((c, np.isin(free, nodes, assume_unique=True)) for _, nodes, c in self.faces))


@dataclass(frozen=True, slots=True, eq=False)
class StayingInFaces(ModifierAtStep):
    """Rows of the free nodes (Q,) on each face."""

    faces: tuple[tuple[int, BoolArray], ...] = field(repr=False)

    def correct(self, u: FloatArray, known: FloatArray, last: bool) -> FloatArray:
        """Set displacements along the normals of the faces to zero."""
        del known
        for component, rows in self.faces if last else ():
            u[rows, component] = 0.0
        return u

    def linearized(self, u: FloatArray, known: FloatArray, last: bool) -> "FaceRates":
        del u, known
        return FaceRates(self.faces if last else ())


@dataclass(frozen=True, slots=True, eq=False)
class FaceRates(Linearized):
    """The derivative of nodes on faces: rates along the normals are zero."""

    faces: tuple[tuple[int, BoolArray], ...] = field(repr=False)

    def forward(self, rate: FloatArray, known: FloatArray) -> FloatArray:
        """Set rates along the normals to zero."""
        del known
        out = np.array(rate)
        for component, rows in self.faces:
            out[rows, component] = 0.0
        return out

    def reverse(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray | float]:
        """Set the gradient along the normals to zero."""
        return self.forward(gradient, gradient), 0.0
