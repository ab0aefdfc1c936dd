"""The paper's loop of section 4 written out, solved afresh for every set of centres, by LAPACK or by GMRES.

`deform.rbf.greedy` scales its sites and solves exactly. Neither can be asked of the paper's program, so this is what a
suspicion about GMRES, or about step (5), is tested with.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IndexArray
from sdm_deflect.base.threads import single_threaded_blas
from sdm_deflect.deform.rbf.data_sites import DataSites
from sdm_deflect.deform.rbf.greedy import Stop
from sdm_deflect.deform.rbf.interpolant import Solve, coefficient_matrix, direct
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline, kernel_sum
from sdm_deflect.deform.rbf.problem import Coefficients, Problem
from sdm_deflect.deform.rbf.rules import GreedyOptions

# Step (5): the sites that become centres, by residuals (N,), the rows of the centres so far, and the options.
Choice = Callable[[FloatArray, IndexArray, GreedyOptions], IndexArray]


@dataclass(frozen=True, slots=True)
class Gmres:
    """A solve by GMRES, without a preconditioner and for one right-hand side at a time.

    Attributes
    ----------
    rtol : it ends where the residual's norm is so many times that of the right-hand side...
    restart, most : ...or after so many iterations, restarted each so many; the solution is then taken as it is.
    """

    rtol: float = 1e-10
    restart: int = 200
    most: int = 10_000

    def __call__(self, matrix: FloatArray, right: FloatArray) -> FloatArray:
        """Return what GMRES has for right-hand sides (n, k), accurate or not."""
        from scipy.sparse.linalg import gmres  # takes a while to load

        restart = min(self.restart, self.most, len(matrix))
        stop = {"rtol": self.rtol, "restart": restart, "maxiter": max(1, self.most // restart)}
        return np.column_stack([gmres(matrix, b, **stop)[0] for b in right.T])


@dataclass(frozen=True, slots=True, eq=False)
class DirectBasis:
    """Interpolants on growing centres, each solved afresh: O(C**3) a time. The reference for `CholeskyBasis`."""

    problem: Problem
    chosen: IndexArray  # (C,) rows of the sites: the centres
    solve: Solve = direct

    @classmethod
    def of(cls, problem: Problem, initial: IndexArray, solve: Solve = direct) -> Self:
        """Start from the rows `initial` of the sites; `solve` may be a `Gmres`, as in the paper."""
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


@dataclass(frozen=True, slots=True)
class Ended:
    """Where an adaptation ended: centres, iterations, largest error (m) at a site, and why."""

    centers: int
    iterations: int
    max_error: float
    stop: Stop


def worst_free(residual: FloatArray, chosen: IndexArray, options: GreedyOptions) -> IndexArray:
    """Choose the sites of largest residual that are no centres yet."""
    free = residual.copy()
    free[chosen] = 0.0
    return worst(free, chosen, options)


def worst(residual: FloatArray, chosen: IndexArray, options: GreedyOptions) -> IndexArray:
    """Choose the sites of largest residual, as the paper writes it: some may be centres already."""
    block = np.argsort(-residual, kind="stable")[: min(options.n_add, options.max_centers - len(chosen))]
    return np.asarray(block[residual[block] > options.tol_add])


def adapted(
    sites: DataSites, first: IndexArray, options: GreedyOptions, solve: Solve, choice: Choice = worst_free
) -> Ended:
    """Adapt the centres of sites of one direction, in metres, by steps (1) to (6).

    Where only centres are off by more than the tolerance, because the solves are inexact, no free site is chosen and
    the loop ends as exhausted.
    """
    points, chosen, kernel, iteration = sites.points, np.array(first), ThinPlateSpline(), 0
    polynomials = np.column_stack([np.ones(len(points)), points])
    with single_threaded_blas():
        while True:
            matrix = coefficient_matrix(polynomials[chosen], kernel, points[chosen])
            solution = solve(matrix, np.vstack([np.zeros((4, 1)), sites.values[chosen]]))
            field = kernel_sum(kernel, points, points[chosen], solution[4:], solution[:4])
            residual = np.abs(field - sites.values)[:, 0]
            block = choice(residual, chosen, options)
            stop = _stop(float(residual.max()), len(chosen), iteration, options)
            stop = stop or (None if len(block) else Stop.EXHAUSTED)
            if stop is not None:
                return Ended(len(chosen), iteration, float(residual.max()), stop)
            chosen, iteration = np.append(chosen, block), iteration + 1


def _stop(largest: float, centers: int, iteration: int, options: GreedyOptions) -> Stop | None:
    """Step (6)."""
    if largest < options.tol_stop:
        return Stop.CONVERGED
    if centers >= options.max_centers:
        return Stop.MAX_CENTERS
    return Stop.MAX_ITERATIONS if iteration >= options.max_iterations else None
