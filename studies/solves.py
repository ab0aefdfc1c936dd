"""The paper's way to the interpolants of growing centres: each solved afresh, by LAPACK or by GMRES."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IndexArray
from sdm_deflect.deform.rbf.interpolant import Solve, SolveError, coefficient_matrix, direct
from sdm_deflect.deform.rbf.problem import Coefficients, Problem


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


def krylov(rtol: float = 1e-10, restart: int = 200, max_cycles: int = 50) -> Solve:
    """Return a solve by GMRES, as in the paper: no preconditioner, one right-hand side at a time.

    Parameters
    ----------
    rtol : Tolerance on the residual's norm relative to that of the right-hand side.
    restart, max_cycles : Iterations between restarts and number of restarts before it gives up with a `SolveError`.
    """
    if not 0.0 < rtol < 1.0:
        raise ValueError(f"rtol = {rtol} must lie between 0 and 1")
    from scipy.sparse.linalg import gmres  # takes a while to load

    def solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
        columns = []
        for column in right.T:
            x, info = gmres(matrix, column, rtol=rtol, restart=min(restart, len(matrix)), maxiter=max_cycles)
            if info != 0:
                raise SolveError(
                    f"GMRES did not reach rtol = {rtol} for {len(matrix)} unknowns in {max_cycles} cycles of "
                    f"{restart} iterations: allow more, or use the direct solve"
                )
            columns.append(x)
        return np.column_stack(columns)

    return solve
