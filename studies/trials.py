"""Adaptations with one thing changed, as the page of the paper quotes them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import exp, inf, log

from studies.trends import title

CASES = {"table1": "aileron", "table3": "Chimera block", "table4": "tail"}
NOTHING, TOLERANCE, GMRES = "nothing changed", "tolerance", "GMRES"
"""Names of changes."""
STUCK = "{}, stuck at {:.2g} mm"
ENDED = {"MAX_CENTERS": "{} left {:.2g} mm", "EXHAUSTED": STUCK, "MAX_ITERATIONS": STUCK, "ROUNDING": STUCK}
"""How a cell says that an adaptation did not reach the tolerance."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One adaptation of a row of the paper with one thing changed.

    Attributes
    ----------
    change, value : what was changed, and to what.
    table, columns, angle : the row of the paper.
    factor : by which the tolerance was divided.
    theirs : centres in the paper.
    stop : name of the reason why it ended.
    """

    change: str
    value: str
    table: str
    columns: str
    angle: float
    factor: float
    theirs: int
    centers: int
    iterations: int
    max_error: float
    stop: str


Trials = Sequence[Trial]


def of(trials: Trials, change: str, table: str | None = None) -> list[Trial]:
    """Return the trials of a change, and of a table."""
    return [one for one in trials if one.change == change and table in (None, one.table)]


def row_name(one: Trial) -> str:
    """Return how a row of the paper is called."""
    return f"{CASES[one.table]} {one.angle:+g}°, {title(one.columns)}"


def cell(one: Trial) -> str:
    """Return the centres, and what is left where the tolerance was not reached."""
    return ENDED.get(one.stop, "{}").format(one.centers, 1e3 * one.max_error)


def factors(trials: Trials) -> dict[tuple[str, float, str], float]:
    """Return by row (table, angle, direction) the factor with which it has the paper's centres; inf beyond."""
    found = {}
    for key in dict.fromkeys((one.table, one.angle, one.columns) for one in of(trials, TOLERANCE)):
        own = [one for one in of(trials, TOLERANCE) if (one.table, one.angle, one.columns) == key]
        found[key] = _crossing(own)
    return found


def _crossing(own: list[Trial]) -> float:
    for a, b in pairwise(own):
        if a.centers < a.theirs <= b.centers and b.stop == "CONVERGED":
            share = log(a.theirs / a.centers) / log(b.centers / a.centers)
            return a.factor * exp(share * log(b.factor / a.factor))
    return inf
