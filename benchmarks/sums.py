"""The kernel sum by 1, 2, 4, ... threads, and on a CUDA card if there is one: ``python -m benchmarks.sums``.

Sums of 2,200 centres in three directions, as of the paper's tail. On the card the time includes the transfers; the
error is the largest difference from the processor's sums over their largest value. `--job` also measures a deflection
of a block of 2.1 million nodes, of which 0.45 million are in the box, by processor and by card.
"""

import argparse
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np

from benchmarks.commands import COMMANDS, ROOT, Command, Version, make_meshes, measured
from benchmarks.results import Result, show
from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.rbf.gpu import check_card, sum_on_card
from sdm_deflect.deform.rbf.kernels import Cubic, Kernel, Multiquadric, ThinPlateSpline, WendlandC2, kernel_sum
from studies.machine import machine

# Centres of the paper's tail (section 5.3).
CENTERS = 2_200
# Points of which sums are compared.
COMPARED = 100_000
KERNELS: dict[str, Kernel] = {
    "thin plate spline": ThinPlateSpline(),
    "multiquadric": Multiquadric(100.0),
    "Wendland": WendlandC2(0.5),
    "cubic": Cubic(),
}
# Timed runs, of which the median is shown; one more is not timed.
ROUNDS = 5


def by_threads(points: int, cores: int) -> Iterator[Result]:
    """Yield the pairs a second of the thin plate spline by numbers of threads."""
    rng = np.random.default_rng(1)
    terms = ThinPlateSpline(), rng.random((points, 3)), rng.random((CENTERS, 3)), rng.normal(size=(CENTERS, 3))
    counts = [1 << k for k in range(cores.bit_length()) if 1 << k < cores] + [cores]
    for count in counts:
        spent = []
        for _ in range(ROUNDS + 1):
            start = perf_counter()
            kernel_sum(*terms, np.zeros((4, 3)), threads=count)
            spent.append(perf_counter() - start)
        seconds = median(spent[1:])
        yield Result(
            f"{count} thread{'s' * (count > 1)}", points * CENTERS / seconds, "pairs/s", ROUNDS, f"{seconds:.3f} s"
        )


def on_card(points: int) -> Iterator[Result]:
    """Yield the pairs a second of each kernel on the card, with the first call and the error."""
    rng = np.random.default_rng(1)
    terms = rng.random((points, 3)), rng.random((CENTERS, 3)), rng.normal(size=(CENTERS, 3)), rng.normal(size=(4, 3))
    for name, kernel in KERNELS.items():
        spent = []
        for _ in range(ROUNDS + 1):
            start = perf_counter()
            found = sum_on_card(kernel, *terms)
            spent.append(perf_counter() - start)
        expected = kernel_sum(kernel, terms[0][:COMPARED], *terms[1:])
        error = np.abs(found[:COMPARED] - expected).max() / np.abs(expected).max()
        seconds = median(spent[1:])
        note = f"{seconds:.3f} s with transfers, the first call {spent[0]:.2f} s, error {error:.1e}"
        yield Result(f"card, {name}", points * CENTERS / seconds, "pairs/s", ROUNDS, note)


def job() -> Iterator[Result]:
    """Yield the seconds of a whole deflection, by processor and by card."""
    words = COMMANDS["block"].words + " --repair off"
    commands = {"block, cpu": Command(words), "block, gpu": Command(f"{words} --set processor=gpu")}
    with tempfile.TemporaryDirectory() as scratch:
        make_meshes(Path(scratch), words)
        yield from measured(commands, {"": Version(ROOT, os.cpu_count() or 1)}, ROUNDS, Path(scratch))


def main() -> None:
    """Measure and print one table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sums", description=__doc__)
    parser.add_argument("--points", type=float, default=1e6, help="of the sums by threads")
    parser.add_argument("--card-points", type=float, default=2e7, help="of the sums on the card")
    parser.add_argument("--job", action="store_true", help="measure the deflection of a block, too")
    given = parser.parse_args()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    results = list(by_threads(int(given.points), cores))
    try:
        check_card()
    except InputError as error:
        print(error)
    else:
        results += [*on_card(int(given.card_points)), *(job() if given.job else ())]
    show(f"kernel sums; {machine()}", results)


if __name__ == "__main__":
    main()
