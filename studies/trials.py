"""Adaptations with one thing changed."""

from dataclasses import dataclass

NOTHING, TOLERANCE, GMRES = "nothing changed", "tolerance", "GMRES"
"""Names of changes."""


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
