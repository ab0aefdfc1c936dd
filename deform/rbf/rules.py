"""Rules of the greedy algorithm: which sites become centres next."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, IndexArray
from sdm_deflect.base.compiled import compiled
from sdm_deflect.base.ties import EQUAL

from .fitting import Polynomial
from .problem import Basis, Coefficients, Problem

# Difference of residuals, as a share of `tol_stop`, below which they are equal: their rows decide. It is larger than
# `EQUAL` because the solution of the linear system multiplies rounding, to some 1e-10 of `tol_stop`.
TIE = 1e-6
# Squares of equal distances differ by less than this share.
LESS = 1.0 - 2.0 * EQUAL
# Number of pairs below which a sweep costs no more than a guess.
WORTH_GUESSING = 400_000
# Share of the last block's residuals, above which a guess looks at a site.
BAD = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class GreedyOptions:
    """Steps (5) and (6) of the algorithm.

    Parameters
    ----------
    n_add : Largest number of sites added in an iteration (`Worst`), or smallest block (`Separated`).
    tol_add, tol_stop : Residuals in metres: sites above `tol_add` may be added; the loop stops at `tol_stop`.
    max_centers, max_iterations : Limits; reaching one is a result and not an error.
    polynomial : Polynomial beside the kernel (eq. 2), at least what the kernel requires.
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


class Rule:
    """Chooses the sites of the next block: step (4) of the algorithm."""

    __slots__ = ()

    def choose(
        self, points: FloatArray, residual: FloatArray, chosen: IndexArray, options: GreedyOptions
    ) -> IndexArray:
        """Return rows of points (N, 3) to add, none of them in `chosen`; the residual (N,) is -1 where unknown."""
        raise NotImplementedError

    def sweep(self, problem: Problem, options: GreedyOptions) -> Sweep:
        """Return the object that extends a basis and evaluates it at all sites."""
        del options
        return Sweep(problem)


@dataclass(frozen=True, slots=True)
class Worst(Rule):
    """The paper's rule: the `n_add` sites with the largest residual, neighbours or not.

    Parameters
    ----------
    look_ahead : Number of iterations guessed from the worst sites alone, then checked at all sites in one pass. Wrong
        guesses are dropped, so the centres are those of look_ahead = 1; only the time differs.
    """

    look_ahead: int = 8

    def __post_init__(self) -> None:
        if self.look_ahead < 1:
            raise ValueError(f"look_ahead = {self.look_ahead} must be at least 1")

    def choose(
        self, points: FloatArray, residual: FloatArray, chosen: IndexArray, options: GreedyOptions
    ) -> IndexArray:
        """Return the worst sites, worst first; ties by row."""
        del points
        return _worst(residual, chosen, options.tol_add, options, _room(chosen, options.n_add, options))

    def sweep(self, problem: Problem, options: GreedyOptions) -> Sweep:
        return LookingAhead(problem, self, options) if self.look_ahead > 1 else Sweep(problem)


@dataclass(frozen=True, slots=True)
class Separated(Rule):
    """Large blocks of bad sites far from one another: fewer centres and far fewer iterations than `Worst`.

    The residual is large in the whole gap between centres, and one more centre mends most of a gap. So a site is left
    out if a worse one has been taken nearer to it than the wider of their two gaps.

    Parameters
    ----------
    share : Sites above this share of the largest residual are considered.
    spacing : Least distance within a block, as a multiple of the distance to the nearest centre.
    growth : Largest block as a share of the centres; at least `n_add`.
    """

    share: float = 0.1
    spacing: float = 1.0
    growth: float = 0.5

    def __post_init__(self) -> None:
        if not (0.0 <= self.share < 1.0 and self.spacing >= 0.0 and self.growth >= 0.0):
            raise ValueError(f"{self} needs 0 <= share < 1, spacing >= 0 and growth >= 0")

    def choose(
        self, points: FloatArray, residual: FloatArray, chosen: IndexArray, options: GreedyOptions
    ) -> IndexArray:
        """Return bad sites far from one another, worst first."""
        level = max(options.tol_add, self.share * float(residual.max()))
        order = _worst(residual, chosen, level, options, len(residual))
        room = _room(chosen, max(options.n_add, int(self.growth * len(chosen))), options)
        x = np.ascontiguousarray(points[order].T)
        gap2 = np.full(len(order), np.inf)
        _nearest(x, points[chosen], gap2)
        taken = np.zeros(len(order), dtype=np.bool_)
        _thin(x, self.spacing**2 * gap2, room, taken, np.zeros(len(order), dtype=np.bool_))
        return order[taken]


def _room(chosen: IndexArray, block: int, options: GreedyOptions) -> int:
    return max(0, min(block, options.max_centers - len(chosen)))


def _worst(residual: FloatArray, chosen: IndexArray, level: float, options: GreedyOptions, count: int) -> IndexArray:
    """Return at most `count` rows with the largest residual above `level` that are not chosen yet, worst first."""
    free = residual > level
    free[chosen] = False
    above = np.flatnonzero(free)
    tie = TIE * options.tol_stop
    if len(above) > count > 0:
        above = above[residual[above] >= np.partition(residual[above], -count)[-count] - tie]
    falling = above[np.argsort(-residual[above], kind="stable")]
    rank = np.cumsum(-np.diff(residual[falling], prepend=residual[falling[:1]]) > tie)
    return np.asarray(falling[np.lexsort((falling, rank))][:count])


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
    """Take the points x (3, M) in order, except those nearer to a taken one than the wider reach of the two."""
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
                near[j] |= d0 * d0 + d1 * d1 + d2 * d2 < LESS * max(reach, reach2[j])


def row_norms(errors: FloatArray) -> FloatArray:
    """Return the norms (N,) of errors (N, k) over the columns: the residual of MV (section 4)."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", errors, errors)))


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Extends a basis, and evaluates it at all sites."""

    problem: Problem

    def extended(self, basis: Basis, block: IndexArray, residual: FloatArray) -> tuple[Basis, FloatArray]:
        """Return the basis with a block of centres added, and its errors (N, k); `residual` (N,) is from before."""
        del residual
        new = basis.extended(block)
        return new, self.problem.errors(new.chosen, [new.coefficients()])[0]


class Guess(NamedTuple):
    """A basis and its coefficients."""

    basis: Basis
    coefficients: Coefficients

    @classmethod
    def of(cls, basis: Basis) -> Guess:
        """Solve for the coefficients of a basis."""
        return cls(basis, basis.coefficients())


@dataclass(frozen=True, slots=True, eq=False)
class LookingAhead(Sweep):
    """Guesses the next blocks from some of the sites, and evaluates all of them in one pass.

    A guess is checked when its block is asked for; a wrong one is dropped with all that follow. `waiting` holds bases
    and errors that are not yet asked for.
    """

    rule: Worst
    options: GreedyOptions
    waiting: list[tuple[Basis, FloatArray]] = field(default_factory=list)

    def extended(self, basis: Basis, block: IndexArray, residual: FloatArray) -> tuple[Basis, FloatArray]:
        if not self.waiting or not np.array_equal(block, self.waiting[0][0].chosen[len(basis.chosen) :]):
            guesses = self._guess(basis, block, residual)
            errors = self.problem.errors(guesses[-1].basis.chosen, [guess.coefficients for guess in guesses])
            self.waiting[:] = zip((guess.basis for guess in guesses), errors, strict=True)
        return self.waiting.pop(0)

    def _guess(self, basis: Basis, block: IndexArray, residual: FloatArray) -> list[Guess]:
        """Extend a basis by its block and by guessed ones.

        A site among the worst had a large residual before, or is near a new centre, where the residual may grow.
        """
        problem, count, guesses = self.problem, len(basis.chosen), [Guess.of(basis.extended(block))]
        residual = np.where(residual > BAD * residual[block].min(), residual, -1.0)
        while len(guesses) < self.rule.look_ahead and len(residual) * count > WORTH_GUESSING:
            new, coefficients = guesses[-1]
            residual[problem.neighbours(block)] = 0.0
            rows = np.flatnonzero(residual >= 0.0)
            residual[rows] = row_norms(problem.errors(new.chosen, [coefficients], rows)[0])
            block = self.rule.choose(problem.points, residual, new.chosen, self.options)
            if not len(block):
                break
            guesses.append(Guess.of(new.extended(block)))
        return guesses
