"""The reduced kernel: the interpolation problem without its polynomial.

Four unisolvent centres, the *anchors* a, take the linear polynomial out. With L (N, 4) the values of the
anchors' Lagrange polynomials at the sites, the reduced kernel

    K~(i, j) = K(i, j) - L_i . K(a, j) - K(i, a) . L_j + L_i . K(a, a) L_j

is positive definite on all other centres, because the kernel (times its sign) is conditionally so. The values
that it has to interpolate are those left over by the polynomial through the anchors.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.linalg import qr

from sdm_deflect.deform.duplicates import IndexArray
from sdm_deflect.deform.kernels import FloatArray
from sdm_deflect.deform.problem import Problem
from sdm_deflect.deform.sums import kernel_matrix

UNISOLVENT = 1e-7  # smallest pivot, relative to the largest, of four points that span a volume


@dataclass(frozen=True, slots=True, eq=False)
class ReducedKernel:
    """K~ and the values g that belong to it."""

    problem: Problem
    anchors: IndexArray  # (q,) rows of the sites
    left: FloatArray  # (N, 2 q): K~ = K - left right'
    right: FloatArray  # (N, 2 q)
    recovery: FloatArray  # (4, q): the polynomial through values at the anchors
    values: FloatArray  # (N, k)

    @classmethod
    def of(cls, problem: Problem, initial: IndexArray) -> Self:
        """Pick the anchors among the initial centres by a pivoted QR factorisation of their polynomials."""
        anchors = _unisolvent(problem.polynomials, np.asarray(initial))
        inverse = np.linalg.inv(problem.polynomials[anchors])
        lagrange = problem.polynomials @ inverse
        kernel = problem.scaled_kernel
        k = kernel.sign * kernel_matrix(kernel, problem.points, problem.points[anchors])
        left, right = np.hstack([lagrange, k]), np.hstack([k - lagrange @ k[anchors], lagrange])
        values = problem.values - lagrange @ problem.values[anchors]
        return cls(problem, anchors, left, right, problem.box.complete(np.asarray(inverse, dtype=np.float64)), values)

    @property
    def lagrange(self) -> FloatArray:
        """Lagrange polynomials of the anchors at the sites, (N, q)."""
        return self.left[:, : len(self.anchors)]

    def matrix(self, i: IndexArray, j: IndexArray) -> FloatArray:
        """Return K~ between the sites of rows i and j, (len(i), len(j))."""
        kernel, points = self.problem.scaled_kernel, self.problem.points
        k = kernel.sign * kernel_matrix(kernel, points[i], points[j])
        k -= self.left[i] @ self.right[j].T
        return np.asarray(k)

    def completed(self, rows: IndexArray, gamma: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return polynomial (4, k), kernel coefficients of the anchors (q, k) and of `rows` (C, k).

        Parameters
        ----------
        rows
            The centres beside the anchors.
        gamma
            (C, k) solution of K~ gamma = g on them.
        """
        sign, q = self.problem.scaled_kernel.sign, len(self.anchors)
        sums = self.left[rows].T @ gamma
        at_anchors = -sums[:q]
        phi = sums[q:] + self.left[self.anchors, q:].T @ at_anchors
        alpha = self.recovery @ (self.problem.values[self.anchors] - phi)
        return np.asarray(alpha), sign * at_anchors, sign * gamma


def _unisolvent(polynomials: FloatArray, initial: IndexArray) -> IndexArray:
    """Return those of the initial centres that determine a polynomial best."""
    count = polynomials.shape[1]
    _, r, pivots = qr(polynomials[initial].T, mode="economic", pivoting=True)
    diagonal = np.abs(np.diagonal(r))
    if len(diagonal) < count or diagonal[-1] < UNISOLVENT * diagonal[0]:
        raise ValueError(
            f"the {len(initial)} initial centres do not determine the linear polynomial: take at least {count} "
            "that do not lie in one plane"
        )
    return np.asarray(initial[pivots[:count]])
