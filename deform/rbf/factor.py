"""A Cholesky factor of the reduced kernel that grows with the centres; what is computed is never computed again.

The matrix is R' R with R upper triangular, in panels of some hundred columns. Triangular solves are then matrix
products except for the panels' small corners. One factor serves all columns of values. A block of m centres costs one
forward solve with m columns and one backward solve for each column of values: C**2 operations instead of C**3. The
Newton basis behind it is described by Mueller and Schaback (2009) and Pazouki and Schaback (2011).
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from sdm_deflect.base.arrays import FloatArray, IndexArray

from .interpolant import SolveError
from .kernels import kernel_sum
from .problem import Coefficients, Problem, ReducedKernel

# Number of columns of a panel; a larger block has its own panel.
WIDTH = 256


class NotPositiveDefiniteError(ArithmeticError):
    """A row of the matrix is linearly dependent on the rows before, to rounding error."""


class Panel(NamedTuple):
    """Columns start to start + used of R; the arrays have room for more."""

    start: int
    used: int
    above: FloatArray  # (WIDTH, start): transpose of R's rows above the corner
    corner: FloatArray  # (WIDTH, WIDTH): inverse of R's triangle on the diagonal

    @property
    def stop(self) -> int:
        """End of the used columns."""
        return self.start + self.used

    def rows(self) -> tuple[FloatArray, FloatArray]:
        """Return the used parts of `above` and `corner`."""
        return self.above[: self.used], self.corner[: self.used, : self.used]


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """The factor R (n, n).

    A factor and its extensions share memory, and each sees its own part. After going back to an earlier factor and
    extending it again, its former extensions are invalid.
    """

    panels: tuple[Panel, ...] = ()

    def __len__(self) -> int:
        return self.panels[-1].stop if self.panels else 0

    def forward(self, right: FloatArray) -> FloatArray:
        """Solve R' x = right for right (n, m)."""
        x = np.empty_like(right)
        for panel in self.panels:
            above, corner = panel.rows()
            rest = right[panel.start : panel.stop] - above @ x[: panel.start]
            x[panel.start : panel.stop] = corner.T @ rest
        return x

    def backward(self, right: FloatArray) -> FloatArray:
        """Solve R x = right for right (n, k)."""
        x = np.array(right)
        for panel in reversed(self.panels):
            above, corner = panel.rows()
            x[panel.start : panel.stop] = corner @ x[panel.start : panel.stop]
            x[: panel.start] -= above.T @ x[panel.start : panel.stop]
        return x

    def extended(self, above: FloatArray, corner: FloatArray) -> tuple["Factor", FloatArray]:
        """Return the factor with m more columns, and the inverse (m, m) of its new triangle.

        Parameters
        ----------
        above : (n, m) solution of R' x = new columns of the matrix, in its first n rows.
        corner : (m, m) the matrix in the new rows and columns.

        Raises NotPositiveDefiniteError if the extended matrix is not positive definite, to rounding error.
        """
        upper, info = dpotrf(corner - above.T @ above, lower=0, clean=1)
        if info != 0:
            raise NotPositiveDefiniteError(f"row {len(self) + info - 1}")
        inverse, _ = dtrtri(upper, lower=0)
        m = len(corner)
        if self.panels and self.panels[-1].used + m <= len(self.panels[-1].corner):
            return Factor((*self.panels[:-1], _append(self.panels[-1], above, inverse))), inverse
        width = max(WIDTH, m)
        panel = Panel(len(self), m, np.zeros((width, len(self))), np.zeros((width, width)))
        panel.above[:m], panel.corner[:m, :m] = above.T, inverse
        return Factor((*self.panels, panel)), inverse


def _append(panel: Panel, above: FloatArray, inverse: FloatArray) -> Panel:
    """Put m columns into a panel that has room for them."""
    start, used, m = panel.start, panel.used, len(inverse)
    new = slice(used, used + m)
    panel.above[new] = above[:start].T
    panel.corner[new, :used] = 0.0
    panel.corner[:used, new] = -(panel.corner[:used, :used] @ above[start:]) @ inverse
    panel.corner[new, new] = inverse
    return panel._replace(used=used + m)


@dataclass(frozen=True, slots=True, eq=False)
class CholeskyBasis:
    """Interpolants on growing centres. Memory: C**2 numbers and the sites.

    Going back to an earlier basis is allowed, as described in `Factor`.
    """

    kernel: ReducedKernel
    chosen: IndexArray  # (C,) rows of the sites that are centres
    anchor_places: IndexArray  # places of the anchors in `chosen`
    beside: IndexArray  # places of the other centres in `chosen`
    factor: Factor  # of the reduced kernel at `beside`
    z: FloatArray  # (n, k) solution of R' z = values at `beside`

    @classmethod
    def of(cls, problem: Problem, initial: IndexArray) -> Self:
        """Start from the rows `initial` of the sites, at least four that are not coplanar."""
        kernel = ReducedKernel.of(problem, initial)
        places = np.array([np.flatnonzero(initial == anchor)[0] for anchor in kernel.anchors], dtype=np.intp)
        beside = np.setdiff1d(np.arange(len(initial)), places)
        none = np.empty(0, dtype=np.intp)
        empty = cls(kernel, none, places, none, Factor(), np.empty((0, problem.values.shape[1])))
        return empty._grow(np.array(initial, dtype=np.intp), beside)

    def extended(self, block: IndexArray) -> Self:
        """Return the basis with the sites of a block as further centres."""
        return self._grow(np.append(self.chosen, block), len(self.chosen) + np.arange(len(block)))

    def coefficients(self) -> Coefficients:
        """Return the coefficients of the interpolant on the chosen centres."""
        return self._complete(self.factor.backward(self.z))

    def refined(self) -> Coefficients:
        """Return the coefficients after one step of iterative refinement on the residual at the centres."""
        first = self.coefficients()
        errors = self.kernel.problem.errors(self.chosen, [first], self.chosen)[0]
        rows = self.chosen[self.beside]
        missing = self.kernel.lagrange[rows] @ errors[self.anchor_places] - errors[self.beside]
        correction = self.factor.backward(self.factor.forward(missing))
        return self._complete(self.factor.backward(self.z) + correction)

    def with_values(self, values: FloatArray) -> Self:
        """Return the basis on the same centres for other values (N, k) at the sites.

        This costs one forward solve, C**2 operations for each column instead of C**3.
        """
        kernel = self.kernel.with_values(values)
        return replace(self, kernel=kernel, z=self.factor.forward(kernel.values[self.chosen[self.beside]]))

    def reverse(self, weights: Coefficients) -> FloatArray:
        """Return the gradient (C, k) by the values at the centres, given that by the coefficients.

        The reduced kernel is symmetric, so one factor serves both ways; one step of iterative refinement follows.
        """
        kernel, rows = self.kernel, self.chosen[self.beside]
        sign, lagrange = kernel.problem.scaled_kernel.sign, kernel.lagrange[rows]
        at_anchors, others = kernel.reverse(
            rows, weights.alpha, weights.beta[self.anchor_places], weights.beta[self.beside]
        )
        gamma = self.factor.backward(self.factor.forward(others))
        left, right = kernel.left[rows], kernel.right[rows]
        points, none = kernel.problem.points[rows], np.zeros((4, gamma.shape[1]))
        product = sign * kernel_sum(kernel.problem.scaled_kernel, points, points, gamma, none) - left @ (
            right.T @ gamma
        )
        gamma += self.factor.backward(self.factor.forward(others - product))
        out = np.empty_like(weights.beta)
        out[self.beside], out[self.anchor_places] = gamma, at_anchors - lagrange.T @ gamma
        return out

    def condition(self) -> float:
        """Return the condition number of the reduced kernel in the 1-norm; the norm of its inverse is estimated.

        Method of Higham and Tisseur (2000) with one vector: always the same bits, seldom wrong by more than a factor of
        3.
        """
        from scipy.sparse.linalg import LinearOperator, onenormest  # loading takes a while

        rows = self.chosen[self.beside]
        if not len(rows):
            return 1.0
        cuts = [rows[start : start + WIDTH] for start in range(0, len(rows), WIDTH)]
        norm = max(float(np.abs(self.kernel.matrix(rows, cut)).sum(axis=0).max()) for cut in cuts)

        def solve(right: FloatArray) -> FloatArray:
            return self.factor.backward(self.factor.forward(right.reshape(len(rows), -1))).reshape(right.shape)

        shape = len(rows), len(rows)
        inverse = LinearOperator(shape, matvec=solve, rmatvec=solve, matmat=solve, rmatmat=solve, dtype=np.float64)
        return norm * float(onenormest(inverse, t=1))

    def _grow(self, chosen: IndexArray, new: IndexArray) -> Self:
        """Extend the factor by the centres at the places `new` of `chosen`."""
        rows, further = self.chosen[self.beside], chosen[new]
        columns = self.kernel.matrix(np.append(rows, further), further)
        above = self.factor.forward(columns[: len(rows)])
        try:
            factor, inverse = self.factor.extended(above, columns[len(rows) :])
        except NotPositiveDefiniteError:
            raise SolveError(
                f"one of {len(new)} further centres depends on the others to rounding error: do data sites lie "
                "closer together than the coordinates resolve?"
            ) from None
        z = inverse.T @ (self.kernel.values[further] - above.T @ self.z)
        beside, z = np.append(self.beside, new), np.vstack([self.z, z])
        return replace(self, chosen=chosen, beside=beside, factor=factor, z=z)

    def _complete(self, gamma: FloatArray) -> Coefficients:
        """Add the coefficients of the anchors and of the polynomial."""
        alpha, at_anchors, others = self.kernel.complete(self.chosen[self.beside], gamma)
        beta = np.empty((len(self.chosen), others.shape[1]))
        beta[self.anchor_places] = at_anchors
        beta[self.beside] = others
        return Coefficients(alpha, beta)
