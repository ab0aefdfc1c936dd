"""The best that LAPACK can do for one system here: the rival of the grown factor."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg.lapack import dgesv
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped, unused-ignore]

from benchmarks.measure import FloatArray, side_by_side, warm
from sdm_deflect.base.threads import available_threads
from sdm_deflect.deform.rbf.interpolant import Solve, direct

ROUNDS = 5


@dataclass(frozen=True, slots=True)
class Best:
    """The fastest of several solves."""

    name: str
    solve: Solve


def best_solve(size: int) -> Best:
    """Return the faster of LAPACK's symmetric and general solves, on one thread or on all, for systems of `size`."""
    a = np.random.default_rng(0).normal(size=(size, size))
    a, b = a + a.T, np.ones((size, 1))
    solves = {
        f"{name} on {threads} threads": _on_threads(solve, threads)
        for name, solve in (("dsysv", direct), ("dgesv", _general))
        for threads in {1, available_threads()}
    }
    actions = {name: partial(solve, a, b) for name, solve in solves.items()}
    warm(actions)
    times = side_by_side(actions, ROUNDS)
    name = min(solves, key=times.median)
    return Best(name, solves[name])


def _general(matrix: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(dgesv(matrix, right)[2])


def _on_threads(solve: Solve, threads: int) -> Solve:
    controller = ThreadpoolController()

    def run(matrix: FloatArray, right: FloatArray) -> FloatArray:
        with controller.limit(limits=threads, user_api="blas"):
            return solve(matrix, right)

    return run
