"""A minimum by L-BFGS, whose first guess of the second derivative is that of each node by itself."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray

MEMORY = 12
"""Pairs of steps and changes of the gradient that are kept."""
ARMIJO, SHORTEST = 1e-4, 1e-6
Function = Callable[[FloatArray], tuple[float, FloatArray]]


class Minimum(NamedTuple):
    """Where the search ended, the value there, and the number of steps taken."""

    place: FloatArray
    value: float
    steps: int


def minimise(function: Function, place: FloatArray, blocks: FloatArray, steps: int, tolerance: float) -> Minimum:
    """Lower a function of (U, 3) unknowns.

    Parameters
    ----------
    function : Returns value and gradient (U, 3); the value may be infinite away from `place`.
    blocks : (U, 6) upper triangles of the second derivative by each node.
    steps : Largest number of steps.
    tolerance : The search ends when a step lowers the value by a smaller share.
    """
    solve = _inverses(blocks)
    pairs: list[tuple[FloatArray, FloatArray, float]] = []
    value, gradient = function(place)
    for count in range(steps):
        direction = -_approximate_inverse(gradient, pairs, solve)
        slope = float(np.vdot(gradient, direction))
        if not slope < 0.0:
            return Minimum(place, value, count)
        length = 1.0
        while True:
            trial = place + length * direction
            new, after = function(trial)
            if np.isfinite(new) and new <= value + ARMIJO * length * slope:
                break
            length *= 0.5
            if length < SHORTEST:
                return Minimum(place, value, count)
        step, change = trial - place, after - gradient
        curve = float(np.vdot(step, change))
        if curve > 0.0:
            pairs = [*pairs[1 - MEMORY :], (step, change, curve)]
        lowered = value - new
        place, value, gradient = trial, new, after
        if lowered < tolerance * abs(value):
            return Minimum(place, value, count + 1)
    return Minimum(place, value, steps)


def _approximate_inverse(
    gradient: FloatArray, pairs: list[tuple[FloatArray, FloatArray, float]], solve: FloatArray
) -> FloatArray:
    """Multiply a gradient (U, 3) by the inverse second derivative that the pairs tell (Nocedal 1980)."""
    out, shares = gradient.copy(), []
    for step, change, curve in reversed(pairs):
        shares.append(float(np.vdot(step, out)) / curve)
        out -= shares[-1] * change
    out = np.einsum("uij,uj->ui", solve, out)
    if pairs:
        _, change, curve = pairs[-1]
        out *= curve / float(np.vdot(change, np.einsum("uij,uj->ui", solve, change)))
    for (step, change, curve), share in zip(pairs, reversed(shares), strict=True):
        out += (share - float(np.vdot(change, out)) / curve) * step
    return np.asarray(out)


def _inverses(blocks: FloatArray) -> FloatArray:
    """Return the inverse (U, 3, 3) of symmetric matrices given by their upper triangles (U, 6).

    A node whose energy underflows beside that of a nearly flat cell is as stiff as the stiffest.
    """
    size = np.abs(blocks).max(axis=1, initial=0.0)
    scale = np.where(size > 0.0, size, 1.0)[:, None, None]  # determinants of very stiff blocks overflow
    matrices = blocks[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3) / scale
    flat = np.linalg.det(matrices) == 0.0
    matrices[flat], scale[flat] = np.eye(3), max(float(size.max(initial=0.0)), np.finfo(float).tiny)
    return np.asarray(np.linalg.inv(matrices) / scale)
