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

from deform.duplicates import IndexArray
from deform.kernels import FloatArray
from deform.problem import Problem
from deform.sums import kernel_matrix

UNISOLVENT = 1e-7  # smallest pivot, relative to the largest, of four points that span a volume


@dataclass(frozen=True, slots=True, eq=False)
class ReducedKernel:
    """K~ and the values g that belong to it."""

    problem: Problem
    anchors: IndexArray  # (q,) rows of the sites
    lagrange: FloatArray  # (N, q)
    anchor_kernel: FloatArray  # (N, q) sign * phi between sites and anchors
    corrected: FloatArray  # (N, q) anchor_kernel - lagrange K(a, a)
    values: FloatArray  # (N, k)

    @classmethod
    def of(cls, problem: Problem, initial: IndexArray) -> Self:
        """Pick the anchors among the initial centres by a pivoted QR factorisation of their polynomials."""
        count = problem.polynomials.shape[1]
        _, r, pivots = qr(problem.polynomials[initial].T, mode="economic", pivoting=True)
        diagonal = np.abs(np.diagonal(r))
        if len(diagonal) < count or diagonal[-1] < UNISOLVENT * diagonal[0]:
            raise ValueError(
                f"the {len(initial)} initial centres do not determine the linear polynomial: take at least {count} "
                "that do not lie in one plane"
            )
        anchors = np.asarray(initial)[pivots[:count]]
        lagrange = problem.polynomials @ np.linalg.inv(problem.polynomials[anchors])
        kernel = problem.scaled_kernel
        k = kernel.sign * kernel_matrix(kernel, problem.points, problem.points[anchors])
        values = problem.values - lagrange @ problem.values[anchors]
        return cls(problem, anchors, lagrange, k, k - lagrange @ k[anchors], values)

    def matrix(self, i: IndexArray, j: IndexArray) -> FloatArray:
        """Return K~ between the sites of rows i and j, (len(i), len(j))."""
        kernel, points = self.problem.scaled_kernel, self.problem.points
        k = kernel.sign * kernel_matrix(kernel, points[i], points[j])
        k -= self.lagrange[i] @ self.corrected[j].T
        k -= self.anchor_kernel[i] @ self.lagrange[j].T
        return np.asarray(k)

    def completed(self, rows: IndexArray, gamma: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return polynomial (q, k), kernel coefficients of the anchors (q, k) and of `rows` (C, k).

        Parameters
        ----------
        rows
            The centres beside the anchors.
        gamma
            (C, k) solution of K~ gamma = g on them.
        """
        sign = self.problem.scaled_kernel.sign
        at_anchors = -(self.lagrange[rows].T @ gamma)
        phi = self.anchor_kernel[rows].T @ gamma + self.anchor_kernel[self.anchors].T @ at_anchors
        basis = self.problem.polynomials[self.anchors]
        alpha = np.linalg.solve(basis, self.problem.values[self.anchors] - phi)
        return np.asarray(alpha), sign * at_anchors, sign * gamma
