"""Control derivatives: slopes of coefficients over the angle, and how far they hold."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from studies.flow.results import Increment, Results

# Degrees up to which increments give the slope.
SMALL = 8.0
# Largest distance from the line, by the increment, that is still called linear.
LINEAR = 0.05


@dataclass(frozen=True, slots=True)
class Slope:
    """A control derivative (per degree) from small angles, and the angles (degrees) between which the line holds."""

    rate: float
    low: float
    high: float

    @classmethod
    def of(cls, increments: Sequence[Increment]) -> "Slope | None":
        """Return the slope through zero of the increments at angles up to `SMALL`; None without angles of both kinds.

        It holds up to the last angle of each sign before the first at which an increment is off by more than 5 %.
        """
        angle = np.array([one.angle for one in increments])
        own = np.array([one.own for one in increments])
        small = np.abs(angle) <= SMALL
        if not small.any() or small.all():
            return None
        rate = float(angle[small] @ own[small] / (angle[small] @ angle[small]))
        holds = np.abs(own - rate * angle) <= LINEAR * np.abs(rate * angle)
        reach = []
        for sign in (-1.0, 1.0):
            side = np.argsort(np.abs(angle[angle * sign > 0.0]))
            sizes, good = np.abs(angle[angle * sign > 0.0])[side], holds[angle * sign > 0.0][side]
            count = len(good) if good.all() else int(np.argmin(good))
            reach.append(float(sizes[count - 1]) if count else 0.0)
        return cls(rate, -reach[0], reach[1])


def slopes_of(results: Results) -> dict[str, Slope]:
    """Return the slopes of all coefficients for which the angles give one."""
    names = dict.fromkeys(one.name for one in results.increments)
    return {name: slope for name in names if (slope := Slope.of(results.of(name)))}
