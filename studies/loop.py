"""The paper's loop of section 4 written out, in any unit of length and with solves that stop early.

`deform.rbf.greedy` scales its sites and solves exactly. Neither can be asked of the paper's program, so this is what a
suspicion about units, or about GMRES, is tested with.
"""

from dataclasses import dataclass

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IndexArray
from sdm_deflect.deform.base.threads import single_threaded_blas
from sdm_deflect.deform.rbf.greedy import GreedyOptions, Stop
from sdm_deflect.deform.rbf.interpolant import Solve, coefficient_matrix
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline, kernel_sum
from sdm_deflect.deform.rbf.problem import DataSites

RESTART, MOST = 300, 900
"""Iterations of GMRES between restarts, and in all, after which its solution is taken as it is."""

COLUMNS = {"linear": 4, "constant": 1, "none": 0}
"""Terms of a polynomial."""


@dataclass(frozen=True, slots=True)
class Gmres:
    """A solve by GMRES that ends where the residual's norm is `rtol` times that of the right-hand side, or earlier."""

    rtol: float
    most: int = MOST  # iterations

    def __call__(self, matrix: FloatArray, right: FloatArray) -> FloatArray:
        """Return what GMRES has for right-hand sides (n, k), accurate or not."""
        from scipy.sparse.linalg import gmres  # takes a while to load

        restart = min(RESTART, self.most, len(matrix))
        stop = {"rtol": self.rtol, "restart": restart, "maxiter": max(1, self.most // restart)}
        return np.column_stack([gmres(matrix, b, **stop)[0] for b in right.T])


@dataclass(frozen=True, slots=True)
class Ended:
    """Where an adaptation ended: centres, iterations, largest error (m) at a site, and why."""

    centers: int
    iterations: int
    max_error: float
    stop: Stop


def adapted(sites: DataSites, first: IndexArray, options: GreedyOptions, solve: Solve, unit: float = 1.0) -> Ended:
    """Adapt the centres of sites of one direction; lengths, but not displacements, are solved for in `unit` of a metre.

    Steps (1) to (6). A site that is a centre already is not taken twice: where nothing but centres is off by more than
    the tolerance, because the solves are inexact, the loop ends as exhausted.
    """
    points, chosen, kernel = sites.points / unit, np.array(first), ThinPlateSpline()
    polynomials = np.column_stack([np.ones(len(points)), points])[:, : COLUMNS[options.polynomial]]
    q = polynomials.shape[1]
    iteration = 0
    with single_threaded_blas():
        while True:
            matrix = coefficient_matrix(polynomials[chosen], kernel, points[chosen])
            solution = solve(matrix, np.vstack([np.zeros((q, 1)), sites.values[chosen]]))
            alpha = np.vstack([solution[:q], np.zeros((4 - q, 1))])
            field = kernel_sum(kernel, points, points[chosen], solution[q:], alpha)
            residual = np.abs(field - sites.values)[:, 0]
            block = _worst(residual, chosen, options)
            stop = _stop(float(residual.max()), len(chosen), iteration, options)
            stop = stop or (None if len(block) else Stop.EXHAUSTED)
            if stop is not None:
                return Ended(len(chosen), iteration, float(residual.max()), stop)
            chosen, iteration = np.append(chosen, block), iteration + 1


def _worst(residual: FloatArray, chosen: IndexArray, options: GreedyOptions) -> IndexArray:
    """Step (5): the sites of largest residual that are no centres yet."""
    free = residual.copy()
    free[chosen] = 0.0
    block = np.argsort(-free, kind="stable")[: min(options.n_add, options.max_centers - len(chosen))]
    return np.asarray(block[free[block] > options.tol_add])


def _stop(largest: float, centers: int, iteration: int, options: GreedyOptions) -> Stop | None:
    """Step (6)."""
    if largest < options.tol_stop:
        return Stop.CONVERGED
    if centers >= options.max_centers:
        return Stop.MAX_CENTERS
    return Stop.MAX_ITERATIONS if iteration >= options.max_iterations else None
