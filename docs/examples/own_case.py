"""A case of one's own: both tails as an elevator, by replacing values of a registered case.

python docs/examples/own_case.py runs/elevator
"""

import sys
from dataclasses import replace
from pathlib import Path

from sdm_deflect.cases.aircraft.case import Case, SurfaceTurn
from sdm_deflect.cases.aircraft.metrics import Run
from sdm_deflect.cases.aircraft.pipeline import run_case
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.output import output_folder
from sdm_deflect.cases.run.progress import Stopwatch


def elevator() -> Case:
    """Return the tail case with both tails, their trailing edges 8 degrees up."""
    tail = case_named("tail", "small")
    return replace(
        tail,
        name="elevator",
        title="both tails together",
        deflections=(SurfaceTurn("tail_left"), SurfaceTurn("tail_right")),
        angle=-8.0,
        adaptation=replace(tail.adaptation, tolerance=5e-5),
    )


def main(folder: Path) -> Run:
    """Run the case; files, validation and report are those of `sdm run`."""
    with output_folder(folder) as scratch:
        run = run_case(elevator(), Stopwatch(), scratch)
    for check in run.checks:
        print(f"{check.name}: {check.value:.3g} {check.unit}, {'passed' if check.passed else 'FAILED'}")
    return run


if __name__ == "__main__":
    main(Path(sys.argv[1]))
