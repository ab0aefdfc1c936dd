"""Adaptation: growing the factor beside solving again in every iteration, with the same evaluation."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import scipy.linalg
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped, unused-ignore]

from benchmarks.measure import FloatArray, Times, exponent, side_by_side
from benchmarks.results import Result
from benchmarks.workloads import Workload, aileron, chimera, tail
from deform.greedy import Adaptation, adapt
from deform.interpolant import Solve, direct, krylov
from deform.kernels import ThinPlateSpline
from deform.resolved import Resolved
from deform.selection import GreedyOptions, Rule, Separated, Worst
from deform.threads import available_threads

UNREACHABLE = 1e-12  # m: the adaptation ends at its limit of centres
Z = 2  # the direction that needs most centres


def results(rounds: int, slow_rounds: int) -> Iterator[Result]:
    """Yield all figures about adaptation."""
    yield from _small(rounds)
    yield from _medium(rounds)
    yield from _large(slow_rounds)
    yield from _strategies(rounds)
    yield from _growth(slow_rounds)


def _options(n_add: int, centers: int = 10_000, tol: float = UNREACHABLE) -> GreedyOptions:
    return GreedyOptions(n_add=n_add, tol_add=tol, tol_stop=tol, max_centers=centers)


class Runs:
    """Adaptations of one workload, each keeping its last outcome."""

    def __init__(self, workload: Workload, component: int = Z) -> None:
        self.workload = replace(workload, sites=workload.sites.column(component))
        self.last: dict[str, Adaptation] = {}

    def action(
        self, name: str, options: GreedyOptions, rule: Rule, solve: Solve | None = None
    ) -> Callable[[], Adaptation]:
        """Return an action that adapts; with `solve` it solves again in every iteration."""

        def run() -> Adaptation:
            sites, initial = self.workload.sites, self.workload.initial
            if solve is None:
                self.last[name] = adapt(sites, ThinPlateSpline(), initial, options, rule=rule)
            else:
                basis = partial(Resolved.of, solve=solve)
                self.last[name] = adapt(sites, ThinPlateSpline(), initial, options, rule=rule, basis=basis)
            return self.last[name]

        return run


def _compared(runs: Runs, times: Times, ours: str, other: str, name: str, rounds: int) -> Result:
    a, b = runs.last[ours], runs.last[other]
    same = "same centres" if np.array_equal(a.chosen, b.chosen) else f"{len(a.chosen)} against {len(b.chosen)} centres"
    note = f"{times.median(ours):.3f} s; {same}, error {a.max_error:.3g} against {b.max_error:.3g} m"
    return Result(name, times.ratio(other, ours), "their time / ours", rounds, note)


def _small(rounds: int) -> Iterator[Result]:
    """Section 5.1: 1,040 sites, n_add = 1, to the paper's 348 centres."""
    runs, options = Runs(aileron()), _options(1, 348)
    times = side_by_side(
        {
            "ours": runs.action("ours", options, Worst()),
            "resolve": runs.action("resolve", options, Worst(1), best_solve(348)),
        },
        rounds,
    )
    yield Result("small_adaptation_seconds", times.median("ours"), "s", rounds, "1,040 sites, n_add 1, 348 centres")
    yield _compared(runs, times, "ours", "resolve", "small_adaptation_vs_resolve", rounds)
    gmres = side_by_side({"gmres": runs.action("gmres", options, Worst(1), krylov(1e-8))}, 1)
    ratio = gmres.median("gmres") / times.median("ours")
    note = f"as in the paper: {gmres.median('gmres'):.2f} s"
    yield Result("small_adaptation_vs_gmres", ratio, "their time / ours", 1, note)


def _medium(rounds: int) -> Iterator[Result]:
    """Section 5.2: 21,624 sites, n_add = 8, to 8e-5 m."""
    runs, options = Runs(chimera()), _options(8, tol=8e-5)
    times = side_by_side(
        {
            "worst": runs.action("worst", options, Worst()),
            "lean": runs.action("lean", options, Separated()),
            "resolve": runs.action("resolve", options, Worst(1), best_solve(600)),
        },
        rounds,
    )
    yield _compared(runs, times, "worst", "resolve", "chimera_adaptation_vs_resolve", rounds)
    yield _compared(runs, times, "lean", "resolve", "chimera_lean_vs_resolve", rounds)


def _large(rounds: int) -> Iterator[Result]:
    """Section 5.3: 25,896 sites, n_add = 12, to the paper's 2,200 centres; lean to the same residual."""
    runs, options = Runs(tail()), _options(12, 2_200)
    residual = runs.action("worst", options, Worst())().max_error
    times = side_by_side(
        {
            "worst": runs.action("worst", options, Worst()),
            "plain": runs.action("plain", options, Worst(1)),
            "lean": runs.action("lean", _options(12, tol=residual), Separated()),
            "resolve": runs.action("resolve", options, Worst(1), best_solve(1_600)),
        },
        rounds,
    )
    yield _compared(runs, times, "worst", "resolve", "adaptation_vs_resolve", rounds)
    yield _compared(runs, times, "plain", "resolve", "adaptation_without_look_ahead_vs_resolve", rounds)
    yield _compared(runs, times, "lean", "resolve", "lean_vs_resolve", rounds)


def _strategies(rounds: int) -> Iterator[Result]:
    """Three directions of the tail at 8e-5 m: one after the other (SQUV) against all at once (MV)."""
    workload, options = tail(), _options(12, tol=8e-5)
    squv = [Runs(workload, c) for c in range(3)]
    actions = [r.action("lean", options, Separated()) for r in squv]
    times = side_by_side(
        {
            "squv": lambda: [action() for action in actions],
            "mv": lambda: adapt(workload.sites, ThinPlateSpline(), workload.initial, options),
        },
        rounds,
    )
    counts = ", ".join(str(len(r.last["lean"].chosen)) for r in squv)
    union = len(np.unique(np.concatenate([r.last["lean"].chosen for r in squv])))
    together = adapt(workload.sites, ThinPlateSpline(), workload.initial, options)
    note = f"SQUV {counts} centres, {union} in all; MV {len(together.chosen)}"
    yield Result("squv_vs_mv", times.ratio("squv", "mv"), "SQUV's time / MV's", rounds, note)


def _growth(rounds: int) -> Iterator[Result]:
    centers = [300 * 2**k for k in range(5)]
    runs = Runs(tail())
    for label, rule in (("adaptation", Worst()), ("lean", Separated())):
        times = side_by_side({str(c): runs.action("", _options(12, c), rule) for c in centers}, rounds)
        medians = [times.median(str(c)) for c in centers]
        yield Result(f"{label}_exponent_centers", exponent(centers, medians), "", rounds, "300 to 4,800 centres")
    sites = [25_896 * 2**k // 4 for k in range(5)]
    several = {n: Runs(tail(n)) for n in sites}
    for label, rule in (("adaptation", Worst()), ("lean", Separated())):
        times = side_by_side({str(n): r.action("", _options(12, 1_000), rule) for n, r in several.items()}, rounds)
        medians = [times.median(str(n)) for n in sites]
        yield Result(f"{label}_exponent_sites", exponent(sites, medians), "", rounds, "6,474 to 103,584 sites")


def best_solve(size: int) -> Solve:
    """Return the fastest of LAPACK's two solves on one thread and on all, for systems of this size."""
    a = np.random.default_rng(0).normal(size=(size, size))
    a, b = a + a.T, np.ones((size, 1))
    solves: dict[str, Solve] = {
        f"{name}, {threads}": _on_threads(solve, threads)
        for name, solve in (("symmetric", direct), ("general", _general))
        for threads in {1, available_threads()}
    }
    times = side_by_side({name: partial(solve, a, b) for name, solve in solves.items()}, 3)
    return solves[min(solves, key=times.median)]


def _general(matrix: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(scipy.linalg.lapack.dgesv(matrix, right)[2])


def _on_threads(solve: Solve, threads: int) -> Solve:
    controller = ThreadpoolController()

    def run(matrix: FloatArray, right: FloatArray) -> FloatArray:
        with controller.limit(limits=threads, user_api="blas"):
            return solve(matrix, right)

    return run
