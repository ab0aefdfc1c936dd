"""Other ways to the interpolants of growing centres: solved afresh, as the paper does, and kept for other values."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.points import IndexArray
from sdm_deflect.deform.rbf.factor import CholeskyBasis
from sdm_deflect.deform.rbf.interpolant import Solve, coefficient_matrix, direct
from sdm_deflect.deform.rbf.problem import Coefficients, Problem
from sdm_deflect.deform.rbf.sites import DataSites


@dataclass(frozen=True, slots=True, eq=False)
class DirectBasis:
    """Interpolants on growing centres, each solved afresh: O(C**3) a time. The reference for `CholeskyBasis`."""

    problem: Problem
    chosen: IndexArray  # (C,) rows of the sites: the centres
    solve: Solve = direct

    @classmethod
    def of(cls, problem: Problem, initial: IndexArray, solve: Solve = direct) -> Self:
        """Start from the rows `initial` of the sites; `solve` may be `krylov()`, as in the paper."""
        return cls(problem, np.array(initial, dtype=np.intp), solve)

    def extended(self, block: IndexArray) -> Self:
        """Return the basis with these rows of the sites as further centres."""
        return replace(self, chosen=np.append(self.chosen, block))

    def coefficients(self) -> Coefficients:
        """Solve eq. 5 for the chosen centres."""
        problem, chosen = self.problem, self.chosen
        q = problem.polynomials.shape[1]
        polynomials, points = problem.polynomials[chosen], problem.points[chosen]
        matrix = coefficient_matrix(polynomials, problem.scaled_kernel, points)
        right = np.vstack([np.zeros((q, problem.values.shape[1])), problem.values[chosen]])
        solution = self.solve(matrix, right)
        return Coefficients(problem.box.complete(solution[:q]), solution[q:])

    def refined(self) -> Coefficients:
        """Return the final coefficients: a fresh solve needs no refinement."""
        return self.coefficients()


def with_values(grown: CholeskyBasis, values: FloatArray) -> CholeskyBasis:
    """Return a basis on the same sites and centres for other values (N, k) at the sites.

    Costs one forward solve, C**2 for each column, instead of the factorisation's C**3.
    """
    kernel, problem = grown.kernel, grown.kernel.problem
    sites = DataSites(problem.sites.points, values, problem.sites.components)
    reduced = values - kernel.lagrange @ values[kernel.anchors]
    other = replace(kernel, problem=replace(problem, sites=sites), values=reduced)
    z = grown.factor.forward(reduced[grown.chosen[grown.beside]])
    return replace(grown, kernel=other, z=z)


@dataclass(frozen=True, slots=True, eq=False)
class RecordingBasis:
    """A basis that hands its final self to `keep`, so that the factor can serve again."""

    grown: CholeskyBasis
    keep: Callable[[CholeskyBasis], None]

    @property
    def chosen(self) -> IndexArray:
        """Rows (C,) of the sites: the centres."""
        return self.grown.chosen

    def extended(self, block: IndexArray) -> Self:
        """Return the basis with these rows of the sites as further centres."""
        return replace(self, grown=self.grown.extended(block))

    def coefficients(self) -> Coefficients:
        """Return the coefficients on the chosen centres."""
        return self.grown.coefficients()

    def refined(self) -> Coefficients:
        """Return the final coefficients, and keep the basis."""
        self.keep(self.grown)
        return self.grown.refined()
