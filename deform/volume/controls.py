"""Surfaces with ranges of their amounts, and amounts as users give them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError, nearest, short_list, shortened
from sdm_deflect.deform.surface.motions import Fixed, Functions

from .job import Amounts

# Largest number of rows of a track at which a plan is measured: one takes about as long as a deflection's checks.
MOST_ROWS = 60
# Amounts: of the only surface; by name, 0 where left out; or of all surfaces in order.
Wanted = float | Mapping[str, float] | Sequence[float]


@dataclass(frozen=True, slots=True)
class ControlRange:
    """A moving surface and the range of its amount.

    Attributes
    ----------
    name, patches, unit : name and patches of the surface, unit of the amount.
    low, high : ends of the range, which contains 0.
    functions : functions of the amount that the fields are multiplied by.
    """

    name: str
    patches: tuple[str, ...]
    unit: str
    low: float
    high: float
    functions: Functions

    @property
    def reads(self) -> tuple[float, ...]:
        """Amounts at which the fields are read: as many as functions, with the ends of the range."""
        return self.functions.reads(self.low, self.high)

    def share(self, end: float) -> FloatArray:
        """Return the weights (k,) by which a repair at an end of the range fades towards the other."""
        return self.functions.fading(end, self.low + self.high - end)

    def samples(self, count: int) -> tuple[float, ...]:
        """Return `count` evenly spaced amounts, with 0 in place of the one nearest to it."""
        amounts = np.linspace(self.low, self.high, count)
        amounts[np.argmin(np.abs(amounts))] = 0.0
        return tuple(amounts.tolist())

    def measured(self, count: int) -> tuple[float, ...]:
        """Return the amounts at which a plan is measured: `count` samples, and the rows of a track, evenly thinned."""
        rows = [stop for stop in self.functions.stops if self.low <= stop <= self.high]
        chosen = np.linspace(0, len(rows) - 1, min(len(rows), MOST_ROWS)).round().astype(int).tolist()
        return tuple(sorted({*self.samples(count), *(rows[i] for i in chosen)}))

    def check(self, amount: float) -> None:
        """Raise InputError for an amount outside the range."""
        if not self.low <= amount <= self.high:
            raise InputError(f"{self.name} = {amount:g} {self.unit} is outside its range {self.low:g}:{self.high:g}")


def by_surface(controls: Sequence[ControlRange], values: Wanted) -> Amounts:
    """Return values in the order of the surfaces; InputError for a wrong name or number of them, or no numbers."""
    given = values if isinstance(values, Mapping) else dict(enumerate(np.atleast_1d(np.asarray(values, dtype=object))))
    out, names = [0.0] * len(controls), [control.name for control in controls]
    if not isinstance(values, Mapping) and len(given) != len(controls):
        raise InputError(f"amounts = {shortened(values)}: the plan has {len(controls)} surfaces: {', '.join(names)}")
    for name, value in given.items():
        rows = [i for i, control in enumerate(controls) if name in (i, control.name)]
        rows = rows or [i for i, control in enumerate(controls) if name in control.patches]
        if not rows or isinstance(name, bool):
            raise InputError(f"{name!r} is no surface of the plan; {nearest(str(name), names)}")
        if len(rows) > 1:
            raise InputError(f"{name!r} belongs to several surfaces; say {' or '.join(names[row] for row in rows)}")
        if isinstance(value, bool) or not isinstance(value, Real):
            raise InputError(f"{names[rows[0]]} = {shortened(value)} must be a number")
        out[rows[0]] = float(value)
    return tuple(out)


def in_order(controls: Sequence[ControlRange], amounts: Wanted) -> Amounts:
    """Return amounts in the order of the surfaces.

    Raises InputError as `by_surface`; for an amount outside its range; or, of a plan of one amount, for another pose.
    """
    out = by_surface(controls, amounts)
    for control, amount in zip(controls, out, strict=True):
        control.check(amount)
    wanted = [control.functions.amount for control in controls if isinstance(control.functions, Fixed)]
    if len(wanted) == len(out) and any(out) and out != tuple(wanted):
        pose, asked = (short_list(f"{value:g}" for value in values) for values in (wanted, out))
        raise InputError(f"{asked}: the plan is of {pose} alone; make one with a range")
    return out
