"""The angles at which a run can be shown, and those at which its centres still suffice."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from sdm_deflect.cases.view.live import Live
from sdm_deflect.deform.errors import InputError

STEP = 0.5
"""Angles are found to this many degrees."""


@dataclass(frozen=True, slots=True)
class Span:
    """The ends (deg) of a range of angles that holds zero, and what prevents a step beyond each."""

    low: float
    high: float
    below: str = ""
    above: str = ""

    def __contains__(self, angle: float) -> bool:
        return self.low <= angle <= self.high


@dataclass(frozen=True, slots=True)
class Spans:
    """Where the surfaces can move, and where the mesh is verified: residual below tolerance, no cell inverted."""

    possible: Span
    verified: Span

    @classmethod
    def of(cls, live: Live) -> Self:
        """Find where the surfaces can move by bisection, and where the mesh is verified by steps from zero."""
        steps = int(live.largest / STEP)
        low, high = (_last(steps, sign, lambda angle: not _obstacle(live, angle)) for sign in (-1.0, 1.0))
        possible = Span(low, high, _obstacle(live, low - STEP), _obstacle(live, high + STEP))
        return cls(possible, Span(_verified(live, low, -STEP), _verified(live, high, STEP)))


def _verified(live: Live, end: float, step: float) -> float:
    """Return the last angle before the first on the way from zero to `end` that is not verified."""
    angle = 0.0
    while abs(angle + step) <= abs(end) and live.at(angle + step).verified:
        angle += step
    return angle


def _obstacle(live: Live, angle: float) -> str:
    """Say why no surface motion exists at an angle; empty if one does."""
    if abs(angle) > live.largest:
        return f"no surface turns by more than {live.largest:g} deg"
    try:
        live.check(angle)
    except InputError as error:
        return str(error)
    return ""


def _last(steps: int, sign: float, good: Callable[[float], bool]) -> float:
    """Return the last of the multiples of STEP, up to so many, that is good."""
    low, bad = 0, steps + 1
    while bad - low > 1:
        middle = (low + bad) // 2
        low, bad = (middle, bad) if good(sign * middle * STEP) else (low, middle)
    return sign * low * STEP
