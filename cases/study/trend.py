"""A trend that the paper reads off a table, as a test that any table, the paper's own included, passes or fails."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from sdm_deflect.cases.study.paper import Row, Table

HARDLY = 1.25
"""Times that differ by less than this factor differ hardly: in the paper's table 1 it is at most 1.21."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Whether a trend holds in some rows, and the numbers that say so."""

    holds: bool
    evidence: str

    @property
    def verdict(self) -> str:
        """In words."""
        return "holds" if self.holds else "does not hold"


Rows = Sequence[Row]
Test = Callable[[Rows, Table], Finding | None]
"""Judges the rows that one loop gave; None if they do not suffice."""


@dataclass(frozen=True, slots=True)
class Trend:
    """What the paper says, and the test of it.

    Attributes
    ----------
    of_time : True if it is about time: then every loop is judged, else only the centres that the paper's rule gives.
    """

    statement: str
    test: Test
    of_time: bool = False


def among(rows: Iterable[Row], columns: str) -> list[Row]:
    """Return the rows of one direction (or of all, "xyz")."""
    return [row for row in rows if row.setting.columns == columns]


def columns_of(rows: Iterable[Row]) -> list[str]:
    """Return the directions that occur, in order."""
    return list(dict.fromkeys(row.setting.columns for row in rows))


def title(columns: str) -> str:
    """Return how the paper calls it: MV or f_x."""
    return "MV" if columns == "xyz" else f"f_{columns}"


def listed(values: Iterable[float]) -> str:
    """Join numbers with few digits."""
    return ", ".join(f"{value:.3g}" if isinstance(value, float) else str(value) for value in values)


def rising(values: Sequence[float]) -> tuple[int, int]:
    """Return how many steps of a sequence rise, and how many there are."""
    return sum(b > a for a, b in pairwise(values)), max(len(values) - 1, 0)


def spread(values: Sequence[float]) -> float:
    """Return the largest value over the smallest."""
    return max(values) / min(values)


def ascending(values: Sequence[float]) -> bool:
    """Return True if every value is larger than the one before."""
    return all(a < b for a, b in pairwise(values))
