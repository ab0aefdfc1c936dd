"""The precision of coordinates in a mesh file."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError

DOUBLE = np.dtype(np.float64)


@dataclass(frozen=True, slots=True)
class Precision:
    """The precision of the file to be written.

    Attributes
    ----------
    real : type of its numbers; of several the one with the fewest bits.
    every : whether all coordinates are rounded; a copy of the source file keeps unchanged coordinates.
    advice : how to write coordinates with more bits.
    """

    real: np.dtype[Any] = DOUBLE
    every: bool = False
    advice: str = ""

    @property
    def is_double(self) -> bool:
        """True if the file keeps every bit."""
        return self.real.itemsize >= DOUBLE.itemsize

    def rounded(self, points: FloatArray, before: FloatArray) -> FloatArray:
        """Return points (N, 3) rounded for the file; `before` (N, 3) are the undeflected ones.

        Raises InputError for coordinates too large for the file's numbers.
        """
        if self.is_double:
            return points
        with np.errstate(over="ignore"):
            stored = points.astype(self.real).astype(np.float64)
        if not np.isfinite(stored).all():
            raise InputError(f"coordinates up to {np.abs(points).max():.3g} are too large for {self}")
        return stored if self.every else np.where(points == before, before, stored)

    def resolution(self, points: FloatArray) -> float:
        """Return the largest change of a coordinate of points (N, 3) by rounding; 0 in double precision."""
        return 0.0 if self.is_double else float(np.finfo(self.real).eps * np.abs(points).max(initial=0.0))

    def __str__(self) -> str:
        return f"coordinates of {8 * self.real.itemsize} bits, which the file keeps; {self.advice}"


# Precision of a file with double-precision numbers.
EVERY_BIT = Precision()


def fewest_bits(kinds: Iterable[np.dtype[Any]]) -> np.dtype[Any]:
    """Return the real type with the fewest bits, in the machine's byte order; double if `kinds` is empty."""
    return min((*(kind.newbyteorder("=") for kind in kinds), DOUBLE), key=lambda kind: kind.itemsize)
