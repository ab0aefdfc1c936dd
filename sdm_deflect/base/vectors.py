"""Vectors of three numbers in compiled loops."""

import numpy as np

from .arrays import FloatArray
from .compiled import compiled_exactly

Vector = tuple[float, float, float]


@compiled_exactly
def row_of(values: FloatArray, i: int, first: int) -> Vector:  # pragma: no cover - machine code
    """Return three values of row `i` from column `first` on."""
    return values[i, first], values[i, first + 1], values[i, first + 2]


@compiled_exactly
def minus(a: Vector, b: Vector) -> Vector:  # pragma: no cover - machine code
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled_exactly
def plus(a: Vector, factor: float, b: Vector) -> Vector:  # pragma: no cover - machine code
    """Return a + factor * b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@compiled_exactly
def dot(a: Vector, b: Vector) -> float:  # pragma: no cover - machine code
    """Return the scalar product of a and b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled_exactly
def cross(a: Vector, b: Vector) -> Vector:  # pragma: no cover - machine code
    """Return the vector product of a and b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled_exactly
def norm(a: Vector) -> float:  # pragma: no cover - machine code
    """Return the length of a."""
    return float(np.sqrt(dot(a, a)))
