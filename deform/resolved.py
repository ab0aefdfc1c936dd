"""The paper's way: solve the whole system again in every iteration (section 4, step 2)."""

import numpy as np

from deform.duplicates import IndexArray
from deform.interpolant import Solve, coefficient_matrix, direct
from deform.problem import Coefficients, Problem


class Resolved:
    """Interpolants on growing centres, each solved afresh: O(C**3) a time. The reference for `Grown`.

    Parameters
    ----------
    problem, initial
        The sites, and the rows of those that are the first centres.
    solve
        LAPACK by default; `krylov()` for the paper's GMRES.
    """

    def __init__(self, problem: Problem, initial: IndexArray, solve: Solve = direct) -> None:
        self._problem = problem
        self._solve = solve
        self.chosen = np.array(initial, dtype=np.intp)

    def extend(self, block: IndexArray) -> None:
        """Take these rows of the sites as further centres."""
        self.chosen = np.append(self.chosen, block)

    def coefficients(self) -> Coefficients:
        """Solve eq. 5 for the chosen centres."""
        problem, chosen = self._problem, self.chosen
        q = problem.polynomials.shape[1]
        polynomials, points = problem.polynomials[chosen], problem.points[chosen]
        matrix = coefficient_matrix(polynomials, problem.scaled_kernel, points)
        right = np.vstack([np.zeros((q, problem.values.shape[1])), problem.values[chosen]])
        solution = self._solve(matrix, right)
        return Coefficients(solution[:q], solution[q:])

    def refined(self) -> Coefficients:
        """Return the final coefficients: a fresh solve needs no refinement."""
        return self.coefficients()
