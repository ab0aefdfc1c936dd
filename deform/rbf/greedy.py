"""Greedy centre adaptation (paper section 4): the loop, its course, and why it ended.

A rule, given to `adapt` as a value, says which sites become centres next: step (5) of the algorithm.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from itertools import zip_longest
from time import perf_counter
from typing import ClassVar, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import FloatArray, IndexArray, first_coincident
from sdm_deflect.deform.base.compiled import compiled
from sdm_deflect.deform.base.threads import Progress, silent, single_threaded_blas

from .factor import CholeskyBasis
from .fitting import Polynomial
from .interpolant import Interpolant
from .kernels import Kernel
from .problem import Coefficients, DataSites, Problem

TIE = 1e-6  # residuals that differ by less than this share of tol_stop are equal: rounding does not choose


@dataclass(frozen=True, slots=True, kw_only=True)
class GreedyOptions:
    """Steps (5) and (6) of the algorithm.

    Parameters
    ----------
    n_add : Number of sites added in an iteration, at most (`Worst`), or least size of a block (`Separated`).
    tol_add, tol_stop : Residuals in metres: sites above the first may be added, the second ends the adaptation.
    max_centers, max_iterations : Limits; reaching one is a result, not an error.
    polynomial : Added to the kernels (eq. 2): at least what the kernel needs.
    """

    n_add: int
    tol_add: float
    tol_stop: float
    max_centers: int = 10_000
    max_iterations: int = 100_000
    polynomial: Polynomial = "linear"

    def __post_init__(self) -> None:
        for name in ("n_add", "max_centers"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} = {getattr(self, name)} must be at least 1")
        if self.max_iterations < 0:
            raise ValueError(f"max_iterations = {self.max_iterations} must not be negative")
        for name in ("tol_add", "tol_stop"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} = {getattr(self, name)} m must be a positive length")


class Rule(Protocol):
    """Chooses the sites of the next block."""

    @property
    def look_ahead(self) -> int:
        """Number of iterations tried on the worst sites before all sites are looked at again."""
        ...

    def choose(
        self, points: FloatArray, residual: FloatArray, chosen: IndexArray, options: GreedyOptions
    ) -> IndexArray:
        """Return rows of points (N, 3) to add, none of them in `chosen`; residual (N,) is -1 where unknown."""
        ...


@dataclass(frozen=True, slots=True)
class Worst:
    """The paper's rule: the `n_add` sites of largest residual, whether they are neighbours or not.

    Parameters
    ----------
    look_ahead : Iterations tried on the worst sites alone, and then checked on all sites in one pass. What does not
        stand the check is taken back, so the centres are those of look_ahead = 1; only the time differs.
    """

    look_ahead: int = 8

    def __post_init__(self) -> None:
        if self.look_ahead < 1:
            raise ValueError(f"look_ahead = {self.look_ahead} must be at least 1")

    def choose(
        self, points: FloatArray, residual: FloatArray, chosen: IndexArray, options: GreedyOptions
    ) -> IndexArray:
        """Return the worst sites, worst first; equal ones by row."""
        del points
        return _ranked(residual, chosen, options.tol_add, options, _room(chosen, options.n_add, options))


@dataclass(frozen=True, slots=True)
class Separated:
    """Large blocks of bad sites that are no neighbours: fewer centres and far fewer iterations than `Worst`.

    The residual is large in the whole gap between centres; one further centre mends most of a gap. So a site is
    left out when a worse one was taken nearer to it than the wider of their two gaps.

    Parameters
    ----------
    share : Sites above this share of the largest residual are looked at.
    spacing : Least distance within a block, as a multiple of the distance to the nearest centre.
    growth : Largest block, as a share of the centres; at least `n_add`.
    """

    share: float = 0.1
    spacing: float = 1.0
    growth: float = 0.5
    look_ahead: ClassVar[int] = 1

    def __post_init__(self) -> None:
        if not (0.0 <= self.share < 1.0 and self.spacing >= 0.0 and self.growth >= 0.0):
            raise ValueError(f"{self} needs 0 <= share < 1, spacing >= 0 and growth >= 0")

    def choose(
        self, points: FloatArray, residual: FloatArray, chosen: IndexArray, options: GreedyOptions
    ) -> IndexArray:
        """Return separated bad sites, worst first."""
        level = max(options.tol_add, self.share * float(residual.max()))
        order = _ranked(residual, chosen, level, options, len(residual))
        room = _room(chosen, max(options.n_add, int(self.growth * len(chosen))), options)
        x = np.ascontiguousarray(points[order].T)
        gap2 = np.full(len(order), np.inf)
        _nearest(x, points[chosen], gap2)
        taken = np.zeros(len(order), dtype=np.bool_)
        _thin(x, self.spacing**2 * gap2, room, taken, np.zeros(len(order), dtype=np.bool_))
        return order[taken]


def _room(chosen: IndexArray, block: int, options: GreedyOptions) -> int:
    return max(0, min(block, options.max_centers - len(chosen)))


def _ranked(residual: FloatArray, chosen: IndexArray, level: float, options: GreedyOptions, count: int) -> IndexArray:
    """Return the `count` rows of largest residual above `level` that are not chosen yet, worst first."""
    free = residual > level
    free[chosen] = False
    above = np.flatnonzero(free)
    rank = np.rint(residual[above] / (TIE * options.tol_stop))
    if len(above) > count > 0:
        keep = rank >= np.partition(rank, -count)[-count]
        above, rank = above[keep], rank[keep]
    return np.asarray(above[np.argsort(-rank, kind="stable")][:count])


@compiled
def _nearest(x: FloatArray, centers: FloatArray, gap2: FloatArray) -> None:  # pragma: no cover - machine code
    """Lower gap2 (M,) to the squared distance of x (3, M) from the nearest of centers (C, 3)."""
    for j in range(len(centers)):
        c0, c1, c2 = centers[j, 0], centers[j, 1], centers[j, 2]
        for i in range(len(gap2)):
            d0, d1, d2 = x[0, i] - c0, x[1, i] - c1, x[2, i] - c2
            gap2[i] = min(gap2[i], d0 * d0 + d1 * d1 + d2 * d2)


@compiled
def _thin(
    x: FloatArray, reach2: FloatArray, room: int, taken: NDArray[np.bool_], near: NDArray[np.bool_]
) -> None:  # pragma: no cover - machine code
    """Take x (3, M) one by one, each unless it is nearer to a taken one than the wider reach of the two."""
    count = 0
    for i in range(len(reach2)):
        if count == room:
            break
        if not near[i]:
            taken[i] = True
            count += 1
            x0, x1, x2, reach = x[0, i], x[1, i], x[2, i], reach2[i]
            for j in range(len(reach2)):
                d0, d1, d2 = x[0, j] - x0, x[1, j] - x1, x[2, j] - x2
                near[j] |= d0 * d0 + d1 * d1 + d2 * d2 < max(reach, reach2[j])


class Stop(Enum):
    """Why the adaptation ended."""

    CONVERGED = "largest error below the tolerance"
    MAX_CENTERS = "limit on the number of centres reached: raise max_centers or accept the error"
    MAX_ITERATIONS = "limit on the number of iterations reached: raise max_iterations or n_add"
    ROUNDING = "largest error below the tolerance in the adaptation, but not when computed afresh: raise the tolerance"
    EXHAUSTED = "no remaining site is off by more than tol_add: lower it to go on"


@dataclass(frozen=True, slots=True)
class Iteration:
    """One row of the convergence history."""

    iteration: int
    n_centers: int
    max_residual: float  # m, over all sites and columns
    seconds: float  # since the start


@dataclass(frozen=True, slots=True, eq=False)
class Recorder:
    """Records one step for each interpolant that was evaluated at all sites."""

    options: GreedyOptions
    progress: Progress
    start: float
    steps: list[Iteration] = field(default_factory=list)

    def record(self, n_centers: int, errors: FloatArray) -> None:
        """Append the step of an interpolant with errors (N, k)."""
        largest = float(np.abs(errors).max())
        self.steps.append(Iteration(len(self.steps), n_centers, largest, perf_counter() - self.start))
        if self.progress is not silent:
            self.progress(f"{n_centers} centres, error {largest:.2e} m", self._fraction())

    def _fraction(self) -> float:
        """Estimate how much is done from the fall of the residual and the use of centres."""
        tol, last = self.options.tol_stop, self.steps[-1]
        first = max(self.steps[0].max_residual, tol)
        fallen = np.log(first / max(last.max_residual, tol)) / np.log(first / tol) if first > tol else 1.0
        return float(max(fallen, last.n_centers / self.options.max_centers))

    def stop(self, block: IndexArray) -> Stop | None:
        """Return why to stop after the last step (step 6), or None to go on with `block`."""
        last, options = self.steps[-1], self.options
        if last.max_residual < options.tol_stop:
            return Stop.CONVERGED
        if last.n_centers >= options.max_centers:
            return Stop.MAX_CENTERS
        if last.iteration >= options.max_iterations:
            return Stop.MAX_ITERATIONS
        return None if len(block) else Stop.EXHAUSTED


__all__ = ["Adaptation", "Basis", "CheckedBasis", "Iteration", "Stop", "TrialBasis", "adapt"]

WORTH_GUESSING = 400_000  # pairs of a sweep; a smaller one costs no more than a guess
BAD = 0.5  # sites above this share of the residuals just mended are looked at when blocks are guessed


@dataclass(frozen=True, slots=True, eq=False)
class Adaptation:
    """The fitted interpolant and how it was reached."""

    interpolant: Interpolant
    components: tuple[int, ...]
    chosen: IndexArray  # (C,) rows of the data sites: the centres
    history: tuple[Iteration, ...]
    stop: Stop
    max_error: float  # m, of the final interpolant over all sites and columns, computed afresh
    basis: "Basis | None" = field(default=None, repr=False)  # on which other values can be interpolated

    @classmethod
    def on(cls, basis: CholeskyBasis, stop: Stop) -> "Adaptation":
        """Build the fit on the centres of a basis, without a history; nobody measures its error."""
        problem = basis.kernel.problem
        interpolant = problem.interpolant(basis.chosen, basis.refined())
        return cls(interpolant, problem.sites.components, basis.chosen, (), stop, np.nan, basis)


def fused(fits: Sequence[Adaptation]) -> Interpolant:
    """Return one interpolant with columns x, y, z on the union of all centres; zero for a direction without fit.

    The costly part of a pair, the logarithm, is then taken once for all directions that share a centre.
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


class Basis(Protocol):
    """Interpolants on growing centres: all that the greedy loop knows of linear algebra."""

    @property
    def chosen(self) -> IndexArray:
        """Rows (C,) of the sites: the centres."""
        ...

    def extended(self, block: IndexArray) -> Self:
        """Return the basis with these rows of the sites as further centres."""
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
    rule: Rule = Separated(),
    basis: Callable[[Problem, IndexArray], Basis] = CholeskyBasis.of,
    progress: Progress = silent,
) -> Adaptation:
    """Grow the centres from `initial` until a stopping rule holds.

    With several columns (MV) the sites are chosen by the combined residual, the norm over the columns; the
    adaptation stops on the largest error of any one column, so that MV and SQUV are held to the same accuracy
    (the paper compares them so, footnote ix).

    Parameters
    ----------
    sites, kernel : What to interpolate, by what.
    initial : (M,) rows of the sites: the first centres; at least four that span a volume, for a linear polynomial.
    options : Steps (5) and (6).
    rule : `Separated()` adds large blocks of sites that are no neighbours, `Worst()` is the paper's.
    basis : `CholeskyBasis.of` extends one factor; `studies.loop` solves again in every iteration, as the paper does.
    """
    _check_initial(initial, sites, options)
    history = Recorder(options, progress, perf_counter())
    with single_threaded_blas():
        problem = Problem.of(sites, kernel, options.polynomial)
        trail = [TrialBasis.of(basis(problem, initial))]
        while (checked := _checked(problem, trail, rule, history)).stop is None:
            trail = _tried(problem, checked, rule, options)
        chosen = checked.basis.chosen
        interpolant = problem.interpolant(chosen, checked.basis.refined())
        error = float(np.abs(interpolant(sites.points) - sites.values).max())
    stop = Stop.ROUNDING if checked.stop is Stop.CONVERGED and error >= options.tol_stop else checked.stop
    return Adaptation(interpolant, sites.components, chosen, tuple(history.steps), stop, error, checked.basis)


class TrialBasis(NamedTuple):
    """A basis that has not been checked on all sites yet."""

    basis: Basis
    coefficients: Coefficients

    @classmethod
    def of(cls, basis: Basis) -> Self:
        """Solve for the coefficients."""
        return cls(basis, basis.coefficients())


class CheckedBasis(NamedTuple):
    """A basis with its residual at all sites, and what follows from it."""

    basis: Basis
    residual: FloatArray  # (N,) combined over the columns
    block: IndexArray  # the centres to add
    stop: Stop | None


def _checked(problem: Problem, trail: Sequence[TrialBasis], rule: Rule, history: Recorder) -> CheckedBasis:
    """Evaluate a trail of ever larger bases at all sites, and follow it as far as `rule` would have gone.

    The first basis of the trail is certain; each of the others rests on a guess of the block that follows.
    """
    all_errors = problem.errors(trail[-1].basis.chosen, [trial.coefficients for trial in trail])
    guesses = [trial.basis.chosen for trial in trail[1:]]
    for trial, errors, guess in zip_longest(trail, all_errors, guesses):
        basis, residual = trial.basis, _combined(errors)
        block = rule.choose(problem.points, residual, basis.chosen, history.options)
        history.record(len(basis.chosen), errors)
        checked = CheckedBasis(basis, residual, block, history.stop(block))
        if checked.stop is not None or guess is None or not np.array_equal(block, guess[len(basis.chosen) :]):
            break
    return checked


def _tried(problem: Problem, checked: CheckedBasis, rule: Rule, options: GreedyOptions) -> list[TrialBasis]:
    """Extend a checked basis by its block, and by further blocks guessed from a part of the sites.

    A residual that comes to be among the worst was large before, or is near a new centre, where it may grow.
    """
    trail, block = [TrialBasis.of(checked.basis.extended(checked.block))], checked.block
    residual = np.where(checked.residual > BAD * checked.residual[block].min(), checked.residual, -1.0)
    while len(trail) < rule.look_ahead and len(residual) * len(checked.basis.chosen) > WORTH_GUESSING:
        basis, coefficients = trail[-1]
        residual[problem.neighbours(block)] = 0.0
        rows = np.flatnonzero(residual >= 0.0)
        residual[rows] = _combined(problem.errors(basis.chosen, [coefficients], rows)[0])
        block = rule.choose(problem.points, residual, basis.chosen, options)
        if not len(block):
            break
        trail.append(TrialBasis.of(basis.extended(block)))
    return trail


def _combined(errors: FloatArray) -> FloatArray:
    """Return the norms (N,) of errors (N, k) over the columns: the residual of MV (section 4)."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", errors, errors)))


def _check_initial(initial: IndexArray, sites: DataSites, options: GreedyOptions) -> None:
    if len(np.unique(initial)) != len(initial) or not len(initial):
        raise ValueError("initial centres must be distinct rows of the sites, and at least one")
    if initial.min() < 0 or initial.max() >= len(sites):
        raise ValueError(f"initial centres {initial.min()} to {initial.max()} are not rows of {len(sites)} sites")
    if options.max_centers < len(initial):
        raise ValueError(f"max_centers = {options.max_centers} is below the {len(initial)} initial centres")
