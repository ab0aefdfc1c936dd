"""Motions: the displacement of a surface's nodes for any amount.

The amount is one number: degrees of a rotation, or the share of a table of displacements. A motion on a surface becomes
a law, which holds all that does not depend on the amount.
"""

from dataclasses import dataclass, field
from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from sdm_deflect.base.arrays import BoolArray, FloatArray
from sdm_deflect.base.errors import InputError, shortened
from sdm_deflect.deform.options import LARGEST_ANGLE
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import bounded

from .surface import Surface

# Unit of a track's parameter.
TRACK_UNIT = "of the track"
# Largest number of functions of one amount.
MOST_FUNCTIONS = 6


class Functions:
    """Functions f_1 to f_k of one amount, all zero at 0."""

    __slots__ = ()
    separate: ClassVar[bool] = False
    """Whether each reading has its own centres and its own repair; else the repair at an end fades (`fading`)."""

    @property
    def count(self) -> int:
        """Number k of functions, and of amounts at which the displacement is read to find their fields."""
        raise NotImplementedError

    @property
    def finer(self) -> "Functions | None":
        """The next larger set of functions, or None."""
        return None

    def values(self, amount: float) -> FloatArray:
        """Return the values (k,)."""
        raise NotImplementedError

    def rates(self, amount: float) -> FloatArray:
        """Return the derivatives (k,) per unit of the amount."""
        raise NotImplementedError

    def check(self) -> None:
        """Raise ValueError for an impossible number of functions or scale."""
        if not 1 <= self.count <= MOST_FUNCTIONS:
            raise ValueError(f"{self.count} functions of an amount")

    @property
    def stops(self) -> tuple[float, ...]:
        """Amounts that the box must contain besides evenly spaced ones."""
        return ()

    def positions(self, points: FloatArray, amount: float) -> FloatArray:
        """Return where an amount brings points (N, 3) of the hinge."""
        del amount
        return points

    def within(self, low: float, high: float) -> "Functions":
        """Return the functions for a range of amounts."""
        del low, high
        return self

    def reads(self, low: float, high: float) -> tuple[float, ...]:
        """Return the k amounts at which the fields are read: evenly from end to end of a range, without 0."""
        amounts = np.linspace(low, high, self.count + 1)
        inner = 0.0 not in (low, high) and len(amounts) > 2
        dropped = 1 + np.argmin(np.abs(amounts[1:-1])) if inner else np.argmin(np.abs(amounts))
        return tuple(np.delete(amounts, dropped).tolist())

    def fading(self, end: float, other: float) -> FloatArray:
        """Return weights (k,) by which the functions are 1 at an end of the range, and 0 at the other.

        Only the first two are used. If the other end is 0, they are 0 at the opposite amount.
        """
        count = min(2, self.count)
        out = np.zeros(self.count)
        out[:count] = np.linalg.inv([self.values(amount)[:count] for amount in (end, other or -end)[:count]])[:, 0]
        return out


@dataclass(frozen=True, slots=True)
class Turn(Functions):
    """sin a and 1 - cos a of an angle a in degrees (Rodrigues' formula); further ones are those of 2 a and 3 a.

    Cells that follow a blended surface nearby, or slide on a cylinder, need more than two.
    """

    count: int = 2

    def check(self) -> None:
        Functions.check(self)
        if self.count % 2:
            raise ValueError(f"{self.count} functions of an angle")

    @property
    def finer(self) -> "Turn | None":
        """Two more functions, up to six."""
        return Turn(self.count + 2) if self.count < MOST_FUNCTIONS else None

    def values(self, amount: float) -> FloatArray:
        """Return the sines, and 1 less the cosines without cancellation."""
        angles = np.radians(amount) * np.arange(1, self.count // 2 + 1)
        return np.column_stack([np.sin(angles), 2.0 * np.sin(0.5 * angles) ** 2]).ravel()

    def rates(self, amount: float) -> FloatArray:
        """Return k cos k a and k sin k a per degree."""
        factors = np.arange(1, self.count // 2 + 1)
        angles, speeds = np.radians(amount) * factors, np.radians(1.0) * factors
        return np.column_stack([speeds * np.cos(angles), speeds * np.sin(angles)]).ravel()


@dataclass(frozen=True, slots=True)
class Powers(Functions):
    """The powers 1 to `count` of the amount over `scale`."""

    count: int
    scale: float = 1.0

    def check(self) -> None:
        Functions.check(self)
        if not self.scale > 0.0:
            raise ValueError(f"scale {self.scale:g}")

    @property
    def finer(self) -> "Powers | None":
        """Two more functions, up to six."""
        return Powers(self.count + 2, self.scale) if self.count + 2 <= MOST_FUNCTIONS else None

    def values(self, amount: float) -> FloatArray:
        """Return the powers."""
        return np.asarray((amount / self.scale) ** np.arange(1, self.count + 1))

    def rates(self, amount: float) -> FloatArray:
        """Return k x^(k - 1) over the scale."""
        power = np.arange(self.count)
        return np.asarray((power + 1.0) * (amount / self.scale) ** power / self.scale)


@dataclass(frozen=True, slots=True)
class Fixed(Functions):
    """Functions of a plan for one amount: 1 and 1, for a displacement and its rounding error."""

    amount: float
    count: int = 2

    def check(self) -> None:
        if self.count != 2:
            raise ValueError(f"{self.count} functions of one amount")

    def values(self, amount: float) -> FloatArray:
        """Return ones; InputError at any other amount."""
        if amount != self.amount:
            raise InputError(f"{amount:g}: the plan is of {self.amount:g} alone; make one with a range")
        return np.ones(2)

    def rates(self, amount: float) -> FloatArray:
        """Raise InputError: there is no derivative."""
        raise InputError(f"{amount:g}: a plan of one amount has no derivative; make one with a range")


class MotionLaw(Protocol):
    """A motion on one surface of K nodes."""

    @property
    def exact(self) -> BoolArray:
        """Which nodes (K,) keep the surface's shape; others connect it to what stays."""
        ...

    def displacement(self, amount: float) -> FloatArray:
        """Return the displacement (K, 3)."""
        ...

    @property
    def functions(self) -> Functions:
        """Functions of the amount; the displacement is a sum of fixed fields times these."""
        ...

    def frozen_at(self, amount: float) -> "MotionLaw":
        """Return the law with its choices frozen at an amount, so that it is smooth around it."""
        ...


class Motion(Protocol):
    """A prescribed motion of a surface's nodes."""

    @property
    def unit(self) -> str:
        """Unit of the amount."""
        ...

    @property
    def axis(self) -> Axis | None:
        """The hinge, if there is one."""
        ...

    def law(self, surface: Surface) -> MotionLaw:
        """Return the motion of a surface's nodes as a function of the amount."""
        ...


class Hinged:
    """A motion with a `hinge`; its amount is an angle unless it says otherwise."""

    __slots__ = ()
    hinge: Axis
    unit: ClassVar[str] = "deg"

    @property
    def axis(self) -> Axis:
        """The hinge of the undeflected mesh."""
        return self.hinge


class Smooth:
    """A law that makes no choices."""

    __slots__ = ()

    def frozen_at(self, amount: float) -> Self:
        """Return the law itself."""
        del amount
        return self


@dataclass(frozen=True, slots=True, eq=False)
class Rotation:
    """Rigid rotation about a hinge, right-handed from the first hinge point to the second.

    Seen from the first point towards the second, a positive angle turns clockwise. `about` takes two points; or one
    point x, y, about which a plane mesh turns counter-clockwise.

    Attributes
    ----------
    axis : the hinge.
    """

    axis: Axis
    unit: ClassVar[str] = "deg"

    def __post_init__(self) -> None:
        if not isinstance(self.axis, Axis):
            raise InputError(f"axis = {shortened(self.axis)} is no Axis; Rotation.about(first, second) makes one")

    @classmethod
    def about(cls, first: ArrayLike, second: ArrayLike | None = None) -> "Rotation":
        """Take the hinge through two points (3,) in the mesh's unit, or along z through one point (2,).

        Raises InputError if the points coincide or are not finite.
        """
        if second is None:
            a = bounded(first, "hinge")
            if a.shape != (2,):
                raise InputError(f"hinge = {shortened(first)}: must be two points of three numbers, or one of two")
            return cls(Axis(np.append(a, 0.0), np.array([0.0, 0.0, 1.0])))
        a, b = (bounded(point, "hinge") for point in (first, second))
        if a.shape != (3,) or b.shape != (3,):
            given = f"{shortened(first)}, {shortened(second)}"
            raise InputError(f"hinge = {given}: must be two points of three numbers, or one of two")
        if np.linalg.norm(b - a) <= 1e-12 * max(np.abs([a, b]).max(), 1e-300):
            raise InputError(f"the hinge has no length: both its points are at {', '.join(f'{x:g}' for x in a)}")
        return cls(Axis.through(a, b))

    def law(self, surface: Surface) -> "RotationLaw":
        """Return the rotation of the nodes of a surface."""
        return RotationLaw(self.axis, surface.points)


@dataclass(frozen=True, slots=True)
class SoughtHinge:
    """Stands for a rotation until the mesh is known.

    Attributes
    ----------
    device : wing, two stations and a share of the chord, at which the hinge of a device is; None for a missing hinge.
    vertical : component that is up, for an amount that was given as down or up; None for an angle.
    """

    device: tuple[str, float, float, float] | None = None
    vertical: int | None = None
    unit: ClassVar[str] = "deg"
    axis: ClassVar[None] = None

    def law(self, surface: Surface) -> "RotationLaw":
        """Raise InputError: the hinge is missing; name candidates."""
        from .hinges import candidates, ends_text

        lines = map(ends_text, candidates(surface.mesh, surface.patches))
        raise InputError(
            "the hinge is missing: give two points of it, in a plane mesh one; from the mesh it may be "
            f"{' or '.join(lines) or 'none: no other patch goes on smoothly from ' + surface.label}"
        )


@dataclass(frozen=True, slots=True, eq=False)
class RotationLaw(Smooth):
    """Rigid rotation of points (K, 3)."""

    axis: Axis
    points: FloatArray = field(repr=False)

    @property
    def exact(self) -> BoolArray:
        """All nodes (K,)."""
        return np.ones(len(self.points), dtype=bool)

    def displacement(self, amount: float) -> FloatArray:
        """Return (R - 1)(p - a) by Rodrigues' formula."""
        return self.axis.displacement(self.points, amount)

    @property
    def functions(self) -> Functions:
        """Sine of the angle, and 1 less its cosine."""
        return Turn()


@dataclass(frozen=True, slots=True)
class Moving:
    """Patches that move together, their motion and its amount.

    Attributes
    ----------
    patches : names or wildcards.
    motion : the motion.
    amount : degrees, or the share of a table.
    range : amounts that the box and a plan must contain; None for 0 to the amount.
    aft : whether the surface must lie aft of its hinge along x, because "down" is said of a trailing edge.
    """

    patches: tuple[str, ...]
    motion: Motion
    amount: float
    range: tuple[float, float] | None = None
    aft: bool = False

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
        low, high = self.ends
        most = LARGEST_ANGLE if self.motion.unit == "deg" else np.inf
        if not -most <= low <= 0.0 <= high <= most or not low <= self.amount <= high or (self.range and low == high):
            raise InputError(
                f"range = {low:g}:{high:g} of {', '.join(self.patches)} must hold 0 and {self.amount:g}; of a hinge it "
                f"is at most {LARGEST_ANGLE:g} deg either way"
            )

    @property
    def ends(self) -> tuple[float, float]:
        """Ends of the range; without a range 0 and the amount."""
        return self.range or (min(0.0, self.amount), max(0.0, self.amount))
