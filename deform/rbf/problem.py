"""One adaptation problem in well-conditioned coordinates, and its reduced kernel.

Four centres that are not coplanar, the *anchors* a, take the linear polynomial out of the problem; a constant needs one
anchor. L (N, 4) holds the values of the anchors' Lagrange polynomials at the sites. The reduced kernel

    K~(i, j) = K(i, j) - L_i . K(a, j) - K(i, a) . L_j + L_i . K(a, a) L_j

is positive definite on all other centres, because the kernel (times its sign) is conditionally so. Its values are what
the polynomial through the anchors leaves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, Self

import numpy as np
from scipy.linalg import qr
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import FloatArray, IndexArray

from .data_sites import DataSites
from .fitting import Polynomial
from .interpolant import Interpolant, UnitBox
from .kernels import Kernel, kernel_matrix, kernel_sum

# Number of sites around a new centre at which the residual may grow.
NEIGHBOURS = 80
# Smallest ratio of pivots for four points that count as not coplanar.
UNISOLVENT = 1e-7


class Coefficients(NamedTuple):
    """Coefficients for the scaled coordinates of a `Problem`; one row of beta for each centre."""

    alpha: FloatArray  # (4, k) of 1 and the scaled coordinates
    beta: FloatArray  # (C, k)


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Data sites in the unit box, with kernel and polynomials."""

    sites: DataSites
    kernel: Kernel  # in metres
    box: UnitBox
    points: FloatArray  # (N, 3) scaled
    polynomials: FloatArray  # (N, q)
    scaled_kernel: Kernel
    tree: cKDTree

    @classmethod
    def of(cls, sites: DataSites, kernel: Kernel, polynomial: Polynomial = "linear") -> Self:
        """Scale the sites to the unit box."""
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
        """Return interpolant less value at rows of the sites, (T, R, k), for T interpolants in one pass.

        The centres of each interpolant are the first of the `chosen` sites, as many as it has coefficients.
        """
        alpha = np.hstack([coefficients.alpha for coefficients in trail])
        beta = np.zeros((len(chosen), alpha.shape[1]))
        k = self.values.shape[1]
        for t, coefficients in enumerate(trail):
            beta[: len(coefficients.beta), t * k : (t + 1) * k] = coefficients.beta
        s = kernel_sum(self.scaled_kernel, self.points[rows], self.points[chosen], beta, alpha)
        return s.reshape(len(s), len(trail), k).transpose(1, 0, 2) - self.values[rows]

    def neighbours(self, rows: IndexArray) -> IndexArray:
        """Return the rows of the sites nearest to any of the given ones."""
        count = min(NEIGHBOURS, len(self.points))
        return np.asarray(self.tree.query(self.points[rows], count)[1]).ravel()

    def interpolant(self, chosen: IndexArray, coefficients: Coefficients) -> Interpolant:
        """Return the interpolant in metres."""
        alpha, beta = self.box.in_metres(self.kernel, self.points[chosen], *coefficients)
        return Interpolant(self.kernel, self.sites.points[chosen], beta, alpha)


@dataclass(frozen=True, slots=True, eq=False)
class ReducedKernel:
    """The reduced kernel K~ and its values g."""

    problem: Problem
    anchors: IndexArray  # (q,) rows of the sites
    left: FloatArray  # (N, 2 q): K~ = K - left right'
    right: FloatArray  # (N, 2 q)
    recovery: FloatArray  # (4, q): the polynomial, given values at the anchors
    values: FloatArray  # (N, k)

    @classmethod
    def of(cls, problem: Problem, initial: IndexArray) -> Self:
        """Choose the anchors among the initial centres by a pivoted QR factorisation of their polynomials."""
        anchors = _unisolvent(problem.polynomials, np.asarray(initial))
        inverse = np.linalg.inv(problem.polynomials[anchors])
        lagrange = problem.polynomials @ inverse
        kernel = problem.scaled_kernel
        k = kernel.sign * kernel_matrix(kernel, problem.points, problem.points[anchors])
        left, right = np.hstack([lagrange, k]), np.hstack([k - lagrange @ k[anchors], lagrange])
        values = problem.values - lagrange @ problem.values[anchors]
        return cls(problem, anchors, left, right, problem.box.complete(np.asarray(inverse, dtype=np.float64)), values)

    def with_values(self, values: FloatArray) -> Self:
        """Return the same kernel for other values (N, k) at the sites."""
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

    def complete(self, rows: IndexArray, gamma: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the polynomial (4, k), and the coefficients of the anchors (q, k) and of `rows` (C, k).

        Parameters
        ----------
        rows : The centres other than the anchors.
        gamma : (C, k) solution of K~ gamma = g at these.
        """
        sign, q = self.problem.scaled_kernel.sign, len(self.anchors)
        sums = self.left[rows].T @ gamma
        at_anchors = -sums[:q]
        phi = sums[q:] + self.left[self.anchors, q:].T @ at_anchors
        alpha = self.recovery @ (self.problem.values[self.anchors] - phi)
        return np.asarray(alpha), sign * at_anchors, sign * gamma

    def reverse(
        self, rows: IndexArray, alpha: FloatArray, at_anchors: FloatArray, others: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the gradients by the values at the anchors (q, k) and by gamma (C, k), the reverse of `complete`.

        `alpha`, `at_anchors` and `others` are the gradients by what `complete` returns.
        """
        sign, q = self.problem.scaled_kernel.sign, len(self.anchors)
        values = self.recovery.T @ alpha
        sums = self.left[self.anchors, q:] @ values - sign * at_anchors
        gamma = sign * others + self.lagrange[rows] @ sums - self.left[rows, q:] @ values
        return np.asarray(values), np.asarray(gamma)


def _unisolvent(polynomials: FloatArray, initial: IndexArray) -> IndexArray:
    """Return the initial centres that determine a polynomial best."""
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


class Basis(Protocol):
    """Interpolants on growing centres, as the greedy loop sees them."""

    @property
    def chosen(self) -> IndexArray:
        """Rows (C,) of the sites that are centres."""
        ...

    def extended(self, block: IndexArray) -> Self:
        """Return the basis with the sites of a block as further centres."""
        ...

    def coefficients(self) -> Coefficients:
        """Return the coefficients on the chosen centres."""
        ...

    def refined(self) -> Coefficients:
        """Return the final coefficients, as accurate as possible."""
        ...
