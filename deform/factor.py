"""The product's way: the Cholesky factor of the reduced kernel grows with the centres.

One factor serves all columns. A block of m further centres costs one forward solve for m columns and one backward
solve for each column of values: C**2 where solving afresh costs C**3. Mueller and Schaback (2009) and Pazouki and
Schaback (2011) describe the Newton basis behind it.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sdm_deflect.deform.duplicates import IndexArray
from sdm_deflect.deform.interpolant import SolveError
from sdm_deflect.deform.kernels import FloatArray
from sdm_deflect.deform.panels import Factor, NotPositiveDefiniteError
from sdm_deflect.deform.problem import Coefficients, Problem
from sdm_deflect.deform.reduced import ReducedKernel


@dataclass(frozen=True, slots=True, eq=False)
class Grown:
    """Interpolants on growing centres; memory C**2 plus the sites.

    One may go back to an earlier basis and extend it otherwise; see `Factor`.
    """

    kernel: ReducedKernel
    chosen: IndexArray  # (C,) rows of the sites: the centres
    anchor_places: IndexArray  # where in `chosen` the anchors stand
    beside: IndexArray  # where in `chosen` the other centres stand
    factor: Factor  # of the reduced kernel there
    z: FloatArray  # (n, k) solution of R' z = values there

    @classmethod
    def of(cls, problem: Problem, initial: IndexArray) -> Self:
        """Start from the rows `initial` of the sites: at least four that span a volume."""
        kernel = ReducedKernel.of(problem, initial)
        places = np.array([np.flatnonzero(initial == anchor)[0] for anchor in kernel.anchors])
        beside = np.setdiff1d(np.arange(len(initial)), places)
        none = np.empty(0, dtype=np.intp)
        empty = cls(kernel, none, places, none, Factor(), np.empty((0, problem.values.shape[1])))
        return empty._grown(np.array(initial, dtype=np.intp), beside)

    def extended(self, block: IndexArray) -> Self:
        """Return the basis with these rows of the sites as further centres."""
        return self._grown(np.append(self.chosen, block), len(self.chosen) + np.arange(len(block)))

    def coefficients(self) -> Coefficients:
        """Return the coefficients of the interpolant on the chosen centres."""
        return self._completed(self.factor.backward(self.z))

    def refined(self) -> Coefficients:
        """Return the coefficients after one step of iterative refinement on the residual at the centres."""
        first = self.coefficients()
        errors = self.kernel.problem.errors(self.chosen, [first], self.chosen)[0]
        rows = self.chosen[self.beside]
        missing = self.kernel.lagrange[rows] @ errors[self.anchor_places] - errors[self.beside]
        correction = self.factor.backward(self.factor.forward(missing))
        return self._completed(self.factor.backward(self.z) + correction)

    def _grown(self, chosen: IndexArray, new: IndexArray) -> Self:
        """Extend the factor by the centres that stand at the places `new` of `chosen`."""
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

    def _completed(self, gamma: FloatArray) -> Coefficients:
        """Add the coefficients of the anchors and of the polynomial."""
        alpha, at_anchors, others = self.kernel.completed(self.chosen[self.beside], gamma)
        beta = np.empty((len(self.chosen), others.shape[1]))
        beta[self.anchor_places] = at_anchors
        beta[self.beside] = others
        return Coefficients(alpha, beta)
