"""One adaptation problem in well-conditioned coordinates, and what is left of it without its polynomial.

Four unisolvent centres, the *anchors* a, take the linear polynomial out; one takes a constant, none no polynomial. With
L (N, 4) the values of the anchors' Lagrange polynomials at the sites, the reduced kernel

    K~(i, j) = K(i, j) - L_i . K(a, j) - K(i, a) . L_j + L_i . K(a, a) L_j

is positive definite on all other centres, because the kernel (times its sign) is conditionally so. The values
that it has to interpolate are those left over by the polynomial through the anchors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from scipy.linalg import qr
from scipy.spatial import cKDTree

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.points import IndexArray
from sdm_deflect.deform.rbf.fitting import Polynomial
from sdm_deflect.deform.rbf.interpolant import Interpolant, UnitBox
from sdm_deflect.deform.rbf.kernels import Kernel
from sdm_deflect.deform.rbf.sites import DataSites
from sdm_deflect.deform.rbf.sums import kernel_matrix, kernel_sum

NEIGHBOURS = 80  # sites around a new centre where the residual may grow


class Coefficients(NamedTuple):
    """Coefficients for the scaled coordinates of a `Problem`, one row of beta for each chosen site."""

    alpha: FloatArray  # (4, k) of 1 and the scaled coordinates
    beta: FloatArray  # (C, k)


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Data sites in the unit box, with the kernel and the polynomials that belong to it."""

    sites: DataSites
    kernel: Kernel  # in metres
    box: UnitBox
    points: FloatArray  # (N, 3) scaled
    polynomials: FloatArray  # (N, q)
    scaled_kernel: Kernel
    tree: cKDTree

    @classmethod
    def of(cls, sites: DataSites, kernel: Kernel, polynomial: Polynomial = "linear") -> Self:
        """Scale `sites`."""
        box = UnitBox.around(sites.points, polynomial)
        points = box.scaled(sites.points)
        scaled_kernel = kernel.rescaled(box.length).kernel
        return cls(sites, kernel, box, points, box.polynomials(points), scaled_kernel, cKDTree(points))

    @property
    def values(self) -> FloatArray:
        """Displacements (N, k) at the sites."""
        return self.sites.values

    def errors(
        self, chosen: IndexArray, trail: Sequence[Coefficients], rows: IndexArray | slice = slice(None)
    ) -> FloatArray:
        """Return interpolant minus value at rows of the sites, (T, R, k), for T interpolants in one pass.

        Each interpolant of `trail` has the first of the chosen sites as its centres, as many as it has coefficients.
        """
        alpha = np.hstack([coefficients.alpha for coefficients in trail])
        beta = np.zeros((len(chosen), alpha.shape[1]))
        k = self.values.shape[1]
        for t, coefficients in enumerate(trail):
            beta[: len(coefficients.beta), t * k : (t + 1) * k] = coefficients.beta
        s = kernel_sum(self.scaled_kernel, self.points[rows], self.points[chosen], beta, alpha)
        return s.reshape(len(s), len(trail), k).transpose(1, 0, 2) - self.values[rows]

    def neighbours(self, rows: IndexArray) -> IndexArray:
        """Return the rows of the sites nearest to each of the given ones, all in one."""
        count = min(NEIGHBOURS, len(self.points))
        return np.asarray(self.tree.query(self.points[rows], count)[1]).ravel()

    def interpolant(self, chosen: IndexArray, coefficients: Coefficients) -> Interpolant:
        """Return the interpolant in metres."""
        alpha, beta = self.box.in_metres(self.kernel, self.points[chosen], *coefficients)
        return Interpolant(self.kernel, self.sites.points[chosen], beta, alpha)


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

    def with_values(self, values: FloatArray) -> Self:
        """Return it for other values (N, k) at the sites."""
        problem, reduced = self.problem, values - self.lagrange @ values[self.anchors]
        sites = DataSites(problem.sites.points, values, problem.sites.components)
        return replace(self, problem=replace(problem, sites=sites), values=reduced)

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
        rows : The centres beside the anchors.
        gamma : (C, k) solution of K~ gamma = g on them.
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
    if not count:
        return np.empty(0, dtype=np.intp)
    _, r, pivots = qr(polynomials[initial].T, mode="economic", pivoting=True)
    diagonal = np.abs(np.diagonal(r))
    if len(diagonal) < count or diagonal[-1] < UNISOLVENT * diagonal[0]:
        raise ValueError(
            f"the {len(initial)} initial centres do not determine the linear polynomial: take at least {count} "
            "that do not lie in one plane"
        )
    return np.asarray(initial[pivots[:count]])
