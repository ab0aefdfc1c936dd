"""Adaptation: growing the factor beside solving again in every iteration, with the same evaluation."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.lapack import best_solve
from benchmarks.measure import Times, exponent, side_by_side, warm
from benchmarks.results import Result
from benchmarks.workloads import Workload, aileron, chimera, tail
from sdm_deflect.deform.rbf.greedy import Adaptation, adapt
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.rules import GreedyOptions, Rule, Separated, Worst
from studies.loop import DirectBasis, Gmres

# Tolerance (m) that no fit reaches, so that the adaptation ends at its limit of centres.
UNREACHABLE = 1e-12
# The direction that needs most centres.
Z = 2


@dataclass(frozen=True, slots=True)
class Extent:
    """How much is measured."""

    rounds: int
    slow_rounds: int  # of what takes seconds
    largest_centers: int  # of the study of growth
    largest_sites: int


def results(extent: Extent) -> Iterator[Result]:
    """Yield all figures about adaptation."""
    yield from _small(extent.rounds)
    yield from _medium(extent.rounds)
    yield from _large(extent.slow_rounds)
    yield from _strategies(extent.rounds)
    yield from _growth_in_centers(extent)
    yield from _growth_in_sites(extent)


def _options(n_add: int, centers: int = 10_000, tol: float = UNREACHABLE) -> GreedyOptions:
    return GreedyOptions(n_add=n_add, tol_add=tol, tol_stop=tol, max_centers=centers)


class Runs:
    """Adaptations of one direction of a workload; each keeps its last outcome."""

    def __init__(self, workload: Workload, component: int = Z) -> None:
        self.workload = replace(workload, sites=workload.sites.column(component))
        self.last: dict[str, Adaptation] = {}

    def grown(self, name: str, options: GreedyOptions, rule: Rule) -> Callable[[], Adaptation]:
        """Return an action that adapts as the product does."""
        return self._kept(name, partial(adapt, options=options, rule=rule))

    def resolved(self, name: str, options: GreedyOptions, solve: Callable[..., np.ndarray]) -> Callable[[], Adaptation]:
        """Return an action that solves again in every iteration, as the paper does."""
        basis = partial(DirectBasis.of, solve=solve)
        return self._kept(name, partial(adapt, options=options, rule=Worst(1), basis=basis))

    def _kept(self, name: str, adaptation: Callable[..., Adaptation]) -> Callable[[], Adaptation]:
        def run() -> Adaptation:
            self.last[name] = adaptation(self.workload.sites, ThinPlateSpline(), self.workload.initial)
            return self.last[name]

        return run

    def compared(self, figure: str, times: Times, ours: str) -> Result:
        """Return how much longer solving again takes than `ours`, and whether the outcome is the same."""
        a, b = self.last[ours], self.last["resolve"]
        counts = f"{len(a.chosen)} against {len(b.chosen)} centres"
        same = "same centres" if np.array_equal(a.chosen, b.chosen) else counts
        note = f"{times.median(ours):.3f} s, {same}, error {a.max_error:.3g} against {b.max_error:.3g} m"
        return Result(figure, times.ratio("resolve", ours), "their time / ours", len(times.seconds), note)


def _small(rounds: int) -> Iterator[Result]:
    """Section 5.1: 1,040 sites, n_add = 1, to the paper's 348 centres."""
    runs, options, best = Runs(aileron()), _options(1, 348), best_solve(240)
    actions = {"worst": runs.grown("worst", options, Worst()), "resolve": runs.resolved("resolve", options, best.solve)}
    times = side_by_side(actions, rounds)
    seconds = times.median("worst")
    yield Result("small_adaptation_seconds", seconds, "s", rounds, "1,040 sites, n_add 1, 348 centres")
    yield runs.compared("small_adaptation_vs_resolve", times, "worst")


def gmres() -> Iterator[Result]:
    """Yield the paper's way on section 5.1's sites: GMRES in every iteration; seconds that only patience repeats."""
    runs, options = Runs(aileron()), _options(1, 348)
    actions = {
        "worst": runs.grown("worst", options, Worst()),
        "resolve": runs.resolved("resolve", options, Gmres(1e-8)),
    }
    warm({"worst": actions["worst"]})
    yield runs.compared("small_adaptation_vs_gmres", side_by_side(actions, 1), "worst")


def _medium(rounds: int) -> Iterator[Result]:
    """Section 5.2: 21,624 sites, n_add = 8, to 8e-5 m."""
    runs, options, best = Runs(chimera()), _options(8, tol=8e-5), best_solve(700)
    actions = {
        "worst": runs.grown("worst", options, Worst()),
        "lean": runs.grown("lean", options, Separated()),
        "resolve": runs.resolved("resolve", options, best.solve),
    }
    times = side_by_side(actions, rounds)
    yield runs.compared("chimera_adaptation_vs_resolve", times, "worst")
    yield runs.compared("chimera_lean_vs_resolve", times, "lean")


def _large(rounds: int) -> Iterator[Result]:
    """Section 5.3: 25,896 sites, n_add = 12, to the paper's 2,200 centres; lean to the same residual."""
    runs, options, best = Runs(tail()), _options(12, 2_200), best_solve(1_600)
    residual = runs.grown("worst", options, Worst())().max_error
    actions = {
        "worst": runs.grown("worst", options, Worst()),
        "plain": runs.grown("plain", options, Worst(look_ahead=1)),
        "lean": runs.grown("lean", _options(12, tol=residual), Separated()),
        "resolve": runs.resolved("resolve", options, best.solve),
    }
    times = side_by_side(actions, rounds)
    yield runs.compared("adaptation_vs_resolve", times, "worst")
    yield runs.compared("without_look_ahead_vs_resolve", times, "plain")
    yield runs.compared("lean_vs_resolve", times, "lean")
    yield Result("resolve_seconds", times.median("resolve"), "s", rounds, f"tail, 2,200 centres; LAPACK: {best.name}")


def _strategies(rounds: int) -> Iterator[Result]:
    """Three directions of the tail at 8e-5 m: one after the other (SQUV) against all at once (MV)."""
    workload, options = tail(), _options(12, tol=8e-5)
    squv = [Runs(workload, c) for c in range(3)]
    directions = [r.grown("lean", options, Separated()) for r in squv]
    actions = {
        "squv": lambda: [direction() for direction in directions],
        "mv": lambda: adapt(workload.sites, ThinPlateSpline(), workload.initial, options),
    }
    times = side_by_side(actions, rounds)
    counts = ", ".join(str(len(r.last["lean"].chosen)) for r in squv)
    union = len(np.unique(np.concatenate([r.last["lean"].chosen for r in squv])))
    together = adapt(workload.sites, ThinPlateSpline(), workload.initial, options)
    note = f"SQUV {counts} centres, {union} in all; MV {len(together.chosen)}"
    yield Result("squv_vs_mv", times.ratio("squv", "mv"), "SQUV's time / MV's", rounds, note)


def _growth_in_centers(extent: Extent) -> Iterator[Result]:
    sizes, runs = _doubled(extent.largest_centers), Runs(tail())
    for label, rule in (("adaptation", Worst()), ("lean", Separated())):
        actions = {str(n): runs.grown(str(n), _options(12, n), rule) for n in sizes}
        yield _fitted(f"{label}_exponent_centers", actions, sizes, extent.slow_rounds)


def _growth_in_sites(extent: Extent) -> Iterator[Result]:
    sizes = _doubled(extent.largest_sites)
    several = {str(n): Runs(tail(n)) for n in sizes}
    for label, rule in (("adaptation", Worst()), ("lean", Separated())):
        actions = {n: runs.grown(n, _options(12, 1_000), rule) for n, runs in several.items()}
        yield _fitted(f"{label}_exponent_sites", actions, sizes, extent.slow_rounds)


def _doubled(largest: int) -> list[int]:
    return [largest // 2**k for k in range(4, -1, -1)]


def _fitted(figure: str, actions: dict[str, Callable[[], Adaptation]], sizes: list[int], rounds: int) -> Result:
    times = side_by_side(actions, rounds)
    seconds = [times.median(name) for name in actions]
    note = f"{sizes[0]:,} to {sizes[-1]:,}: {seconds[0]:.3f} to {seconds[-1]:.3f} s"
    return Result(figure, exponent(sizes, seconds), "", rounds, note)
