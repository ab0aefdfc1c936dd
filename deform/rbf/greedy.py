"""The greedy choice of centres (paper section 4): the loop, its history, and why it stopped."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from time import perf_counter

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IndexArray, first_coincident
from sdm_deflect.base.threads import Progress, silent, single_threaded_blas

from .data_sites import DataSites
from .factor import CholeskyBasis
from .interpolant import Interpolant
from .kernels import Kernel
from .problem import Basis, Problem
from .rules import GreedyOptions, Rule, Separated, row_norms

# The default rule.
SEPARATED = Separated()


class Stop(Enum):
    """Why the loop stopped."""

    CONVERGED = "largest error below the tolerance"
    MAX_CENTERS = "limit on the number of centres reached: raise max_centers or accept the error"
    MAX_ITERATIONS = "limit on the number of iterations reached: raise max_iterations or n_add"
    ROUNDING = "largest error below the tolerance in the adaptation, but not when computed afresh: raise the tolerance"
    EXHAUSTED = "no remaining site is off by more than tol_add: lower it to go on"


@dataclass(frozen=True, slots=True)
class Iteration:
    """One row of the history."""

    iteration: int
    n_centers: int
    max_residual: float  # m, over all sites and columns
    seconds: float  # since the start of the loop


@dataclass(frozen=True, slots=True, eq=False)
class Recorder:
    """Records one row of the history for each interpolant that was evaluated at all sites."""

    options: GreedyOptions
    progress: Progress
    start: float
    steps: list[Iteration] = field(default_factory=list)

    def record(self, n_centers: int, errors: FloatArray) -> None:
        """Append a row for an interpolant with errors (N, k)."""
        largest = float(np.abs(errors).max())
        self.steps.append(Iteration(len(self.steps), n_centers, largest, perf_counter() - self.start))
        if self.progress is not silent:
            self.progress(f"{n_centers} centres, error {largest:.2e} m", self._fraction())

    def _fraction(self) -> float:
        """Estimate the fraction done from the fall of the residual and the number of centres."""
        tol, last = self.options.tol_stop, self.steps[-1]
        first = max(self.steps[0].max_residual, tol)
        fallen = np.log(first / max(last.max_residual, tol)) / np.log(first / tol) if first > tol else 1.0
        return float(max(fallen, last.n_centers / self.options.max_centers))

    def stop(self, block: IndexArray) -> Stop | None:
        """Return why to stop now (step 6), or None to continue with `block`."""
        last, options = self.steps[-1], self.options
        if last.max_residual < options.tol_stop:
            return Stop.CONVERGED
        if last.n_centers >= options.max_centers:
            return Stop.MAX_CENTERS
        if last.iteration >= options.max_iterations:
            return Stop.MAX_ITERATIONS
        return None if len(block) else Stop.EXHAUSTED


@dataclass(frozen=True, slots=True, eq=False)
class Adaptation:
    """A fitted interpolant, and how its centres were chosen."""

    interpolant: Interpolant
    components: tuple[int, ...]
    chosen: IndexArray  # (C,) rows of the data sites that are centres
    history: tuple[Iteration, ...]
    stop: Stop
    max_error: float  # m, largest error of the final interpolant at any site in any column
    basis: Basis | None = field(default=None, repr=False)  # interpolates other values on these centres

    @classmethod
    def on(cls, basis: CholeskyBasis, stop: Stop) -> "Adaptation":
        """Return the fit on the centres of a basis, without a history; its error is not measured."""
        problem = basis.kernel.problem
        interpolant = problem.interpolant(basis.chosen, basis.refined())
        return cls(interpolant, problem.sites.components, basis.chosen, (), stop, np.nan, basis)


def fuse(fits: Sequence[Adaptation]) -> Interpolant:
    """Return one interpolant with columns x, y, z on the union of all centres; 0 for directions without a fit.

    The logarithm, the costly part of a pair, is then computed once for all directions that share a centre.
    """
    if not fits:
        raise ValueError("no adaptation to evaluate")
    kernel = fits[0].interpolant.kernel
    if any(f.interpolant.kernel != kernel for f in fits):
        raise ValueError("the adaptations have different kernels")
    components = [c for f in fits for c in f.components]
    if len(set(components)) != len(components):
        raise ValueError(f"two adaptations hold one direction: {components}")
    centers = np.vstack([f.interpolant.centers for f in fits])
    first = first_coincident(centers)
    keep = np.flatnonzero(first == np.arange(len(first)))
    place = np.searchsorted(keep, first)
    alpha, beta = np.zeros((4, 3)), np.zeros((len(keep), 3))
    start = 0
    for f in fits:
        rows = place[start : start + len(f.interpolant.centers)]
        columns = list(f.components)
        beta[rows[:, None], columns] = f.interpolant.beta
        alpha[:, columns] = f.interpolant.alpha
        start += len(rows)
    return Interpolant(kernel, centers[keep], beta, alpha)


def adapt(
    sites: DataSites,
    kernel: Kernel,
    initial: IndexArray,
    options: GreedyOptions,
    *,
    rule: Rule = SEPARATED,
    basis: Callable[[Problem, IndexArray], Basis] = CholeskyBasis.of,
    progress: Progress = silent,
) -> Adaptation:
    """Add centres to `initial` until a stopping rule holds.

    With several columns (MV) sites are chosen by the norm of the residual over the columns. The loop stops by the
    largest error in any column, so MV and SQUV reach the same accuracy, as in the paper's comparison (footnote ix).

    Parameters
    ----------
    sites, kernel : Data sites and kernel.
    initial : (M,) rows of the first centres; for a linear polynomial at least four that are not coplanar.
    options : Steps (5) and (6).
    rule : `Separated()` adds blocks of sites far from one another; `Worst()` is the paper's rule.
    basis : `CholeskyBasis.of` extends one factor; `studies.loop` solves the whole system in every iteration, like the
        paper.
    """
    _check_initial(initial, sites, options)
    history = Recorder(options, progress, perf_counter())
    with single_threaded_blas():
        problem = Problem.of(sites, kernel, options.polynomial)
        sweep = rule.sweep(problem, options)
        current = basis(problem, initial)  # step (1): the initial centres
        errors = problem.errors(current.chosen, [current.coefficients()])[0]  # steps (2), (3): fit, residuals
        while True:
            residual = row_norms(errors)
            history.record(len(current.chosen), errors)
            block = rule.choose(problem.points, residual, current.chosen, options)  # steps (4), (5): the worst sites
            if reason := history.stop(block):  # step (6)
                break
            current, errors = sweep.extended(current, block, residual)  # steps (2), (3)
        interpolant = problem.interpolant(current.chosen, current.refined())
        error = float(np.abs(interpolant(sites.points) - sites.values).max())
    stop = Stop.ROUNDING if reason is Stop.CONVERGED and error >= options.tol_stop else reason
    return Adaptation(interpolant, sites.components, current.chosen, tuple(history.steps), stop, error, current)


def _check_initial(initial: IndexArray, sites: DataSites, options: GreedyOptions) -> None:
    if len(np.unique(initial)) != len(initial) or not len(initial):
        raise ValueError("initial centres must be distinct rows of the sites, and at least one")
    if initial.min() < 0 or initial.max() >= len(sites):
        raise ValueError(f"initial centres {initial.min()} to {initial.max()} are not rows of {len(sites)} sites")
    if options.max_centers < len(initial):
        raise ValueError(f"max_centers = {options.max_centers} is below the {len(initial)} initial centres")
