"""The product's way: the Cholesky factor of the reduced kernel grows and is never computed again.

What is kept is the inverse T of the upper factor, K~ = (T T')^-1. A block of m further centres costs two
products with T and one Cholesky factorisation of size m, and the coefficients follow by an update. One factor
serves all columns. Mueller and Schaback (2009) and Pazouki and Schaback (2011) describe the basis behind it.
"""

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from deform.duplicates import IndexArray
from deform.interpolant import SolveError
from deform.kernels import FloatArray
from deform.problem import Coefficients, Problem
from deform.reduced import ReducedKernel

GROWTH = 1.5  # of the memory, when it is full


class Grown:
    """Interpolants on growing centres; memory C**2 plus the sites.

    Parameters
    ----------
    problem, initial
        The sites, and the rows of those that are the first centres: at least four that span a volume.
    """

    def __init__(self, problem: Problem, initial: IndexArray) -> None:
        self._problem = problem
        self._kernel = ReducedKernel.of(problem, initial)
        columns = problem.values.shape[1]
        self._inverse = np.zeros((0, 0))
        self._z, self._gamma = np.zeros((0, columns)), np.zeros((0, columns))
        self._rows = np.empty(0, dtype=np.intp)  # centres beside the anchors
        self.chosen = np.array(initial, dtype=np.intp)
        anchors = self._kernel.anchors
        beside = ~np.isin(self.chosen, anchors)
        self._anchor_places = np.array([np.flatnonzero(self.chosen == a)[0] for a in anchors])
        self._places = np.flatnonzero(beside)  # where in `chosen` the centres beside the anchors stand
        self._append(self.chosen[beside])

    def extend(self, block: IndexArray) -> None:
        """Take these rows of the sites as further centres."""
        self._places = np.append(self._places, np.arange(len(self.chosen), len(self.chosen) + len(block)))
        self.chosen = np.append(self.chosen, block)
        self._append(block)

    def coefficients(self) -> Coefficients:
        """Return the coefficients of the interpolant on the chosen centres."""
        alpha, at_anchors, others = self._kernel.completed(self._rows, self._gamma)
        beta = np.empty((len(self.chosen), others.shape[1]))
        beta[self._anchor_places] = at_anchors
        beta[self._places] = others
        return Coefficients(alpha, beta)

    def refined(self) -> Coefficients:
        """Return the coefficients after one step of iterative refinement on the residual at the centres."""
        errors = self._problem.errors(self.chosen, self.coefficients(), self.chosen)
        lagrange = self._kernel.lagrange[self._rows]
        missing = lagrange @ errors[self._anchor_places] - errors[self._places]
        t = self._factor()
        self._gamma = self._gamma + t @ (t.T @ missing)
        return self.coefficients()

    def _append(self, block: IndexArray) -> None:
        """Grow the factor by the rows `block` and update z = T' g and gamma = T z."""
        n, m = len(self._rows), len(block)
        t = self._factor()
        above = t.T @ self._kernel.matrix(self._rows, block)
        corner = _inverse_factor(self._kernel.matrix(block, block) - above.T @ above)
        self._reserve(n + m)
        self._inverse[:n, n : n + m] = -(t @ (above @ corner))
        self._inverse[n : n + m, n : n + m] = corner
        z = corner.T @ (self._kernel.values[block] - above.T @ self._z)
        self._rows = np.append(self._rows, block)
        self._z = np.vstack([self._z, z])
        self._gamma = np.vstack([self._gamma, np.zeros_like(z)]) + self._inverse[: n + m, n : n + m] @ z

    def _factor(self) -> FloatArray:
        n = len(self._rows)
        return self._inverse[:n, :n]

    def _reserve(self, size: int) -> None:
        """Make room for a factor of this size."""
        have = len(self._inverse)
        if size > have:
            larger = np.zeros((max(size, int(GROWTH * have)),) * 2)
            larger[:have, :have] = self._inverse
            self._inverse = larger


def _inverse_factor(matrix: FloatArray) -> FloatArray:
    """Return the inverse of the upper Cholesky factor of a matrix (m, m)."""
    if not len(matrix):
        return matrix
    upper, info = dpotrf(matrix, lower=0, clean=1)
    if info != 0:
        raise SolveError(
            f"one of {len(matrix)} further centres depends on the others to rounding error: do data sites lie "
            "closer together than the coordinates resolve?"
        )
    return np.asarray(dtrtri(upper, lower=0)[0])
