"""Evaluation: our kernel sum beside the others', on the tail's points (section 5.3)."""

from collections.abc import Callable, Iterable, Iterator
from functools import partial

import numpy as np
from scipy.interpolate import RBFInterpolator

from benchmarks.measure import exponent, side_by_side, warm
from benchmarks.memory import peak_above_arrays
from benchmarks.peers import Sum, UnavailableError, available
from benchmarks.results import Result
from benchmarks.roofline import PER_PAIR, multiply_adds
from benchmarks.workloads import points_around, tail
from sdm_deflect.base.threads import available_threads
from sdm_deflect.deform.rbf.interpolant import Interpolant, fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline

CENTERS, INSIDE, WHOLE = 2_200, 80_261, 623_387
SITES = 25_896
# Number of centres of a small interpolant.
FEW = 256
OURS, ALONE = "this package", "this package, one thread"
# Seconds of each sum before it is timed: threads of another's OpenBLAS or OpenMP spin for 0.1 s after their work.
SETTLING = 0.2


def results(rounds: int, peers: Iterable[str]) -> Iterator[Result]:
    """Yield all figures about evaluation."""
    yield from _beside_peers(rounds, peers)
    yield from dense_fit(rounds)
    yield from _beside_roofline(rounds)
    yield from _confined(rounds)
    yield from _growth(rounds)
    yield from _few_centers(rounds)
    points, centers = np.empty((INSIDE, 3)), CENTERS
    above = peak_above_arrays(len(points), centers)
    yield Result("evaluation_memory", above / 2**20, "MiB", 1, "peak above the arrays")


def task(points: int, centers: int) -> Sum:
    """Return a sum for three directions."""
    workload = tail(max(SITES, centers))
    rows = np.linspace(0, len(workload.sites) - 1, centers).round().astype(np.intp)
    beta = np.random.default_rng(0).normal(size=(centers, 3))
    return Sum(points_around(workload.region, points), workload.sites.points[rows], beta)


def interpolant(sum_: Sum) -> Interpolant:
    """Return our form of a sum."""
    return Interpolant(ThinPlateSpline(), sum_.centers, sum_.beta, np.zeros((4, sum_.beta.shape[1])))


def _beside_peers(rounds: int, peers: Iterable[str]) -> Iterator[Result]:
    sum_ = task(INSIDE, CENTERS)
    ours = interpolant(sum_)
    actions, missing = available(sum_, peers)
    everyone = {OURS: lambda: ours(sum_.points), ALONE: lambda: ours(sum_.points, threads=1), **actions}
    warm(everyone)
    times = side_by_side(everyone, rounds, SETTLING)
    names = {"C, one direction": "evaluation_vs_c", "SciPy RBFInterpolator": "evaluation_vs_scipy"}
    for peer in actions:
        slug = names.get(peer, "evaluation_vs_" + peer.split()[0].strip(",").lower().replace("-", "_"))
        alone = f"; {times.ratio(peer, ALONE):.1f} with ours on one thread"
        note = f"{peer}: {times.median(peer):.3f} s{alone}"
        yield Result(slug, times.ratio(peer, OURS), "their time / ours", rounds, note)
    for peer, reason in missing.items():
        if peer in names:
            yield Result(names[peer], float("nan"), "their time / ours", 0, reason)
    seconds = times.median(OURS)
    note = f"three directions: {seconds:.3f} s"
    yield Result("pairs_per_second", INSIDE * CENTERS / seconds, "1/s", rounds, note)


def dense_fit(rounds: int) -> Iterator[Result]:
    """Yield the time of SciPy's dense fit over that of ours, of the same system without a choice of centres."""
    sum_ = task(8, CENTERS)
    actions = {
        OURS: lambda: fit(ThinPlateSpline(), sum_.centers, sum_.beta),
        "SciPy": lambda: RBFInterpolator(sum_.centers, sum_.beta, kernel="thin_plate_spline", degree=1),
    }
    warm(actions)
    times = side_by_side(actions, rounds, SETTLING)
    note = f"SciPy: {times.median('SciPy'):.3f} s, ours {times.median(OURS):.3f} s, {CENTERS:,} centres"
    yield Result("dense_fit_vs_scipy", times.ratio("SciPy", OURS), "their time / ours", rounds, note)


def _beside_roofline(rounds: int) -> Iterator[Result]:
    """Multiplications of a sum for three directions, against the processor's most; its divisions are not counted."""
    sum_ = task(INSIDE, CENTERS)
    ours = interpolant(sum_)
    actions = {OURS: lambda: ours(sum_.points), "roofline": multiply_adds}
    try:
        warm(actions)
    except UnavailableError as reason:
        yield Result("roofline_share", float("nan"), "% of the processor's FMA rate", 0, str(reason))
        return
    times = side_by_side(actions, rounds)
    most = multiply_adds() * available_threads()
    share = PER_PAIR * INSIDE * CENTERS / most * times.ratio("roofline", OURS)
    note = f"most: {most / times.median('roofline'):.3g} FMA/s; beside {PER_PAIR} FMA a pair has one division"
    yield Result("roofline_share", 100.0 * share, "% of the processor's FMA rate", rounds, note)


def _confined(rounds: int) -> Iterator[Result]:
    workload = tail()
    ours = interpolant(task(8, CENTERS))
    points = points_around(workload.region, INSIDE, WHOLE - INSIDE)
    inside = np.flatnonzero(workload.region.contains(points))
    near = points[inside]
    actions = {
        "filter": lambda: workload.region.contains(points),
        "confined": lambda: ours(near),
        "whole": lambda: ours(points),
    }
    warm(actions)
    times = side_by_side(actions, rounds)
    saved = times.of("whole") - times.of("confined")
    note = f"{len(inside)} of {len(points)} points"
    yield Result("whole_vs_confined", times.ratio("whole", "confined"), "ratio", rounds, note)
    share = 100.0 * float(np.median(times.of("filter") / saved))
    yield Result("filter_share", share, "% of the time saved", rounds, f"{1e3 * times.median('filter'):.1f} ms")


def _growth(rounds: int) -> Iterator[Result]:
    """Points, then centres, begin at the paper's number and double four times; the other is held at a quarter."""
    few = interpolant(task(8, CENTERS // 4))
    clouds = {n: points_around(tail().region, n) for n in doubled(INSIDE)}
    yield _fitted("evaluation_exponent_points", {n: partial(few, c) for n, c in clouds.items()}, rounds)
    sums = {c: interpolant(task(8, c)) for c in doubled(CENTERS)}
    cloud = points_around(tail().region, INSIDE // 4)
    yield _fitted("evaluation_exponent_centers", {c: partial(s, cloud) for c, s in sums.items()}, rounds)


def doubled(first: int) -> list[int]:
    """Return a size and its four doublings."""
    return [first * 2**k for k in range(5)]


def _fitted(name: str, actions: dict[int, Callable[[], object]], rounds: int) -> Result:
    """Measure actions, each under its size, and fit the exponent."""
    named = {str(size): action for size, action in actions.items()}
    warm(named)
    times = side_by_side(named, rounds)
    seconds = [times.median(size) for size in named]
    note = f"{min(actions):,} to {max(actions):,}: {seconds[0]:.3f} to {seconds[-1]:.3f} s"
    return Result(name, exponent(list(actions), seconds), "", rounds, note)


def _few_centers(rounds: int) -> Iterator[Result]:
    """Time of a pair where centres are few: what a point costs beside its pairs is then shared by few."""
    sums = {c: interpolant(task(8, c)) for c in (FEW, CENTERS)}
    cloud = points_around(tail().region, INSIDE)
    actions = {str(c): partial(s, cloud, threads=1) for c, s in sums.items()}
    warm(actions)
    times = side_by_side(actions, rounds)
    few, many = (1e9 * times.median(str(c)) / (INSIDE * c) for c in (FEW, CENTERS))
    fixed = (few - many) / (1.0 / FEW - 1.0 / CENTERS)
    note = f"{FEW} centres; {many:.3f} with {CENTERS:,}: {fixed:.0f} ns a point beside its pairs"
    yield Result("evaluation_small_ns", few, "ns a pair, one thread", rounds, note)
