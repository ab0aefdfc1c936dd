"""How a mesh file rounds coordinates."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError

DOUBLE = np.dtype(np.float64)


@dataclass(frozen=True, slots=True)
class Precision:
    """How the file that is to be written keeps coordinates.

    Attributes
    ----------
    real : type of its numbers; of a file that has several types, the one with the fewest bits.
    every : whether all coordinates are rounded: those of a file that is a copy of the one that was read keep their
        bits where they do not change.
    advice : where coordinates of more bits could be written.
    """

    real: np.dtype[Any] = DOUBLE
    every: bool = False
    advice: str = ""

    @property
    def is_double(self) -> bool:
        """True if the file keeps every bit."""
        return self.real.itemsize >= DOUBLE.itemsize

    def rounded(self, points: FloatArray, before: FloatArray) -> FloatArray:
        """Return points (N, 3) as the file holds them; `before` (N, 3) are those of the undeflected mesh.

        Raises InputError for coordinates that are too large for its numbers.
        """
        if self.is_double:
            return points
        with np.errstate(over="ignore"):
            stored = points.astype(self.real).astype(np.float64)
        if not np.isfinite(stored).all():
            raise InputError(f"coordinates up to {np.abs(points).max():.3g} are too large for {self}")
        return stored if self.every else np.where(points == before, before, stored)

    def resolution(self, points: FloatArray) -> float:
        """Return how far rounding moves any of some points (N, 3) at most, in any direction; 0 in double precision."""
        return 0.0 if self.is_double else float(np.finfo(self.real).eps * np.abs(points).max(initial=0.0))

    def __str__(self) -> str:
        return f"coordinates of {8 * self.real.itemsize} bits, which the file keeps; {self.advice}"


EVERY_BIT = Precision()
"""That of a file in double precision."""
