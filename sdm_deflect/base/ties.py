"""Lengths that are equal in exact arithmetic: their order decides, and not the last bit.

Zero sites form a regular lattice, so many distances between them are equal. Rounding makes one of them the largest, and
which one depends on the processor, on the libraries, and on the last bit of the mesh.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Relative difference below which two lengths are equal. Rounding changes a distance by some 1e-14 of the box, which may
# be a hundred thousand times as long; distances that differ on purpose differ by far more.
EQUAL = 1e-9


def first_largest(values: NDArray[np.float64]) -> int:
    """Return the row of the largest of values (N,) >= 0; of equal ones the first."""
    return int(np.argmax(~clearly_less(values, values.max())))


def clearly_less(a: Any, b: Any) -> Any:
    """Return whether a length a, or each of several, is less than a length b and not equal to it."""
    return a < (1.0 - EQUAL) * b


def whole(ratio: float) -> int:
    """Return the whole number nearest to a ratio of lengths; of two equally near ones the larger."""
    return int(np.floor(ratio * (1.0 + EQUAL) + 0.5))
