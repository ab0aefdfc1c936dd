"""`python -m benchmarks [--quick] --json FILE`: speed as ratios measured within one run."""

import argparse
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from time import perf_counter

from benchmarks import adaptation, evaluation, per_million
from benchmarks.first_call import first_call
from benchmarks.memory import seconds_and_peak
from benchmarks.peers import MAIN_PEERS, PEERS
from benchmarks.results import Result, markdown, show, write
from studies.machine import machine

LARGE = 10_000_000


def main() -> None:
    """Measure, print one table and write the figures."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer repetitions: within two minutes")
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="write {name: {value, unit, median_of}} here, a .md table beside"
    )
    arguments = parser.parse_args()
    start = perf_counter()
    results = list(_quick() if arguments.quick else _full())
    title = f"{date.today().isoformat()}, {machine()}, {perf_counter() - start:.0f} s"
    show(title, results)
    if arguments.json is not None:
        write(arguments.json, results)
        arguments.json.with_suffix(".md").write_text(markdown(title, results), encoding="utf-8")


def _quick() -> Iterator[Result]:
    yield from first_call()
    yield from per_million.results(rounds=3)
    yield from evaluation.results(3, MAIN_PEERS)
    yield from adaptation.results(adaptation.Extent(3, 1, largest_centers=3_840, largest_sites=51_792))


def _full() -> Iterator[Result]:
    yield from first_call()
    yield from per_million.results(rounds=5)
    yield from evaluation.results(7, PEERS)
    yield from adaptation.results(adaptation.Extent(5, 5, largest_centers=4_800, largest_sites=103_584))
    yield from adaptation.gmres()
    seconds, peak = seconds_and_peak(LARGE, evaluation.CENTERS)
    pairs = LARGE * evaluation.CENTERS / seconds
    yield Result("large_evaluation", seconds, "s", 1, f"10 million points, 2,200 centres: {pairs:.3g} pairs/s")
    yield Result("large_evaluation_peak", peak / 2**30, "GiB", 1, "of the whole process")


if __name__ == "__main__":
    main()
