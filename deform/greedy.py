"""Greedy centre adaptation (paper section 4)."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from time import perf_counter
from typing import Protocol

import numpy as np

from deform.duplicates import IndexArray
from deform.factor import Grown
from deform.interpolant import Interpolant
from deform.kernels import FloatArray, Kernel
from deform.problem import Coefficients, Problem
from deform.progress import Progress, silent
from deform.sites import DataSites
from deform.threads import single_threaded_blas

TIE = 1e-6  # residuals that differ by less than this share of tol_stop are equal: rounding does not choose


class Stop(Enum):
    """Why the adaptation ended."""

    CONVERGED = "largest error below tol_stop"
    MAX_CENTERS = "limit on the number of centres reached: raise max_centers or accept the error"
    MAX_ITERATIONS = "limit on the number of iterations reached: raise max_iterations or n_add"
    EXHAUSTED = "no remaining site is off by more than tol_add: lower tol_add to go on"


@dataclass(frozen=True, slots=True, kw_only=True)
class GreedyOptions:
    """Steps (5) and (6) of the algorithm.

    Parameters
    ----------
    n_add
        Number of sites added in an iteration, at most.
    tol_add, tol_stop
        Residuals in metres: sites above the first may be added, the second ends the adaptation.
    max_centers, max_iterations
        Limits; reaching one is a result, not an error.
    """

    n_add: int
    tol_add: float
    tol_stop: float
    max_centers: int = 10_000
    max_iterations: int = 100_000

    def __post_init__(self) -> None:
        for name in ("n_add", "max_centers"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} = {getattr(self, name)} must be at least 1")
        if self.max_iterations < 0:
            raise ValueError(f"max_iterations = {self.max_iterations} must not be negative")
        for name in ("tol_add", "tol_stop"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} = {getattr(self, name)} m must be a positive length")


@dataclass(frozen=True, slots=True)
class Step:
    """One row of the convergence history."""

    iteration: int
    n_centers: int
    max_residual: float  # m, over all sites and columns
    seconds: float  # since the start


@dataclass(frozen=True, slots=True, eq=False)
class Adaptation:
    """The fitted interpolant and how it was reached."""

    interpolant: Interpolant
    components: tuple[int, ...]
    chosen: IndexArray  # (C,) rows of the data sites: the centres
    history: tuple[Step, ...]
    stop: Stop
    max_error: float  # m, of the final interpolant over all sites and columns, computed afresh


class Basis(Protocol):
    """Interpolants on growing centres: all that the greedy loop knows of linear algebra."""

    chosen: IndexArray

    def extend(self, block: IndexArray) -> None:
        """Take these rows of the sites as further centres."""
        ...

    def coefficients(self) -> Coefficients:
        """Return the coefficients on the chosen centres."""
        ...

    def refined(self) -> Coefficients:
        """Return the final coefficients, as exact as this basis can."""
        ...


def adapt(
    sites: DataSites,
    kernel: Kernel,
    initial: IndexArray,
    options: GreedyOptions,
    *,
    basis: Callable[[Problem, IndexArray], Basis] = Grown,
    progress: Progress = silent,
) -> Adaptation:
    """Grow the centres from `initial` until a stopping rule holds.

    With several columns (MV) the sites are chosen by the combined residual, the norm over the columns; the
    adaptation stops on the largest error of any one column, so that MV and SQUV are held to the same accuracy
    (the paper compares them so, footnote ix).

    Parameters
    ----------
    sites, kernel
        What to interpolate, by what.
    initial
        (M,) rows of the sites: the first centres; at least four that span a volume.
    options
        Steps (5) and (6).
    basis
        `Grown` extends one factor; `Resolved` solves again in every iteration, as the paper does.
    """
    _check_initial(initial, sites, options)
    start, history = perf_counter(), list[Step]()
    with single_threaded_blas():
        problem = Problem.of(sites, kernel)
        state = basis(problem, initial)
        while True:
            errors = problem.errors(state.chosen, state.coefficients())
            largest = float(np.abs(errors).max())
            history.append(Step(len(history), len(state.chosen), largest, perf_counter() - start))
            progress(f"{len(state.chosen)} centres, error {largest:.2e} m", _fraction(history, options))
            block = worst(errors, state.chosen, options)
            stop = _stop(history[-1], block, options)
            if stop is not None:
                break
            state.extend(block)
        interpolant = problem.interpolant(state.chosen, state.refined())
        error = float(np.abs(interpolant(sites.points) - sites.values).max())
    return Adaptation(interpolant, sites.components, state.chosen, tuple(history), stop, error)


def worst(errors: FloatArray, chosen: IndexArray, options: GreedyOptions) -> IndexArray:
    """Return the sites to add (steps 4 and 5): the `n_add` worst of those above tol_add, worst first."""
    residual = np.sqrt(np.einsum("ij,ij->i", errors, errors))
    residual[chosen] = -1.0
    room = min(options.n_add, options.max_centers - len(chosen))
    above = np.flatnonzero(residual > options.tol_add)
    rank = np.rint(residual[above] / (TIE * options.tol_stop))
    if len(above) > room > 0:
        keep = rank >= np.partition(rank, -room)[-room]
        above, rank = above[keep], rank[keep]
    return np.asarray(above[np.argsort(-rank, kind="stable")][: max(room, 0)])


def _check_initial(initial: IndexArray, sites: DataSites, options: GreedyOptions) -> None:
    if len(np.unique(initial)) != len(initial) or not len(initial):
        raise ValueError("initial centres must be distinct rows of the sites, and at least one")
    if initial.min() < 0 or initial.max() >= len(sites):
        raise ValueError(f"initial centres {initial.min()} to {initial.max()} are not rows of {len(sites)} sites")
    if options.max_centers < len(initial):
        raise ValueError(f"max_centers = {options.max_centers} is below the {len(initial)} initial centres")


def _stop(last: Step, block: IndexArray, options: GreedyOptions) -> Stop | None:
    """Return why to stop (step 6), or None to go on with `block`."""
    if last.max_residual < options.tol_stop:
        return Stop.CONVERGED
    if last.n_centers >= options.max_centers:
        return Stop.MAX_CENTERS
    if last.iteration >= options.max_iterations:
        return Stop.MAX_ITERATIONS
    return None if len(block) else Stop.EXHAUSTED


def _fraction(history: list[Step], options: GreedyOptions) -> float:
    """Estimate how much is done from the fall of the residual and the use of centres."""
    first, last = (max(step.max_residual, options.tol_stop) for step in (history[0], history[-1]))
    fallen = np.log(first / last) / np.log(first / options.tol_stop) if first > options.tol_stop else 1.0
    return float(max(fallen, history[-1].n_centers / options.max_centers))
