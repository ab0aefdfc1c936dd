"""How a surface moves: values that give the displacement of its nodes, and its derivative, for any angle.

A motion has one number, its amount: degrees of a rotation, or the share of a table of displacements.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own.surface import Surface
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.surface.axis import Axis

LARGEST_ANGLE = 90.0
"""Degrees: beyond, a surface has passed its parent."""


class Motion(Protocol):
    """The prescribed motion of a surface's nodes."""

    @property
    def unit(self) -> str:
        """Unit of the amount."""
        ...

    @property
    def axis(self) -> Axis | None:
        """The hinge, if there is one."""
        ...

    def displacement(self, surface: Surface, amount: float) -> FloatArray:
        """Return how far each node (K, 3) moves."""
        ...

    def rate(self, surface: Surface, amount: float) -> FloatArray:
        """Return the derivative (K, 3) of the displacement with respect to the amount."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Rotation:
    """Rigid rotation about a hinge, right-handed from its first point to its second.

    Looking from the first point to the second, a positive angle turns clockwise.
    """

    axis: Axis

    @classmethod
    def about(cls, first: FloatArray, second: FloatArray) -> "Rotation":
        """Take the hinge through two points (3,); InputError if they coincide."""
        a, b = (np.asarray(point, dtype=np.float64) for point in (first, second))
        if a.shape != (3,) or b.shape != (3,) or not np.isfinite([a, b]).all():
            raise InputError(f"the hinge {first} {second} must be two points of three numbers")
        if np.linalg.norm(b - a) <= 1e-12 * max(np.abs([a, b]).max(), 1e-300):
            raise InputError(f"the hinge has no length: both its points are at {', '.join(f'{x:g}' for x in a)}")
        return cls(Axis.through(a, b))

    @property
    def unit(self) -> str:
        """Unit of the amount."""
        return "deg"

    def displacement(self, surface: Surface, amount: float) -> FloatArray:
        """Return (R - 1)(p - a) by Rodrigues' formula."""
        return self.axis.displacement(surface.points, amount)

    def rate(self, surface: Surface, amount: float) -> FloatArray:
        """Return direction x (rotated p - a) in length units per degree."""
        arm = self.axis.rotated(surface.points, amount) - self.axis.point
        return np.asarray(np.radians(1.0) * np.cross(self.axis.direction, arm))


@dataclass(frozen=True, slots=True)
class Moving:
    """Patches that move together, and how far.

    Attributes
    ----------
    patches : names or wildcards.
    motion : how.
    amount : degrees, or the share of a table.
    """

    patches: tuple[str, ...]
    motion: Motion
    amount: float

    def __post_init__(self) -> None:
        if not self.patches:
            raise InputError("no surface to move: name one")
        if not abs(self.amount) < np.inf:
            raise InputError(f"angle = {self.amount} of {', '.join(self.patches)} is not a number")
        if self.motion.unit == "deg" and abs(self.amount) > LARGEST_ANGLE:
            raise InputError(
                f"angle = {self.amount:g} deg of {', '.join(self.patches)} is out of range: "
                f"at most {LARGEST_ANGLE:g} deg either way"
            )
