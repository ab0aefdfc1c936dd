"""The meshes of further seeds: how often the mesher succeeds, and how far meshes and deflections differ by chance.

``python -m benchmarks.mesh_seeds --seeds 20 --scale small --json benchmarks/mesh_reliability.json`` makes the four
undeflected meshes of each seed, deflects the cases in them, and writes the file after each mesh, and the page beside
it. It goes on where it was stopped, and keeps the trials of other scales.
"""

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median

from sdm_deflect.base.files import replacing
from sdm_deflect.cases.aircraft.cad import around_block, generate_undeflected
from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.overset import finer_background
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.meshing.child import MeshingError
from sdm_deflect.meshing.generate.generation import Generated
from sdm_deflect.meshing.mesh.labelled import tets_of

# The meshes, and the cases that are deflected in them, at their own angles.
MESHES = {
    "aircraft": ("aileron", "tail", "rudder", "all"),
    "notch": ("aileron-free",),
    "block": ("aileron-chimera",),
    "background": (),
}


@dataclass(frozen=True, slots=True)
class Trial:
    """One mesh of a seed. `attempts` is 0 where none passed; `least` has the least mean ratio in the box by case."""

    mesh: str
    seed: int
    attempts: int
    rejected: str = ""
    cells: int = 0
    quality_min: float = 0.0
    quality_mean: float = 0.0
    processor_seconds: float = 0.0
    seconds: float = 0.0
    unseeded: str = ""
    least: dict[str, float] | None = None
    scale: str = "small"


def trial(name: str, seed: int, scale: str) -> Trial:
    """Make a mesh of a seed, and deflect its cases."""
    first = case_named((*MESHES[name], "aileron-chimera")[0], scale)
    case = replace(first, mesh=replace(first.mesh, seed=seed), background=replace(first.background, seed=seed))
    try:
        made = _maker(name, case)()
    except MeshingError as error:
        return Trial(name, seed, 0, str(error), scale=scale)
    report = made.report
    quality = report.verification.quality
    return Trial(
        name, seed, report.attempts, "; ".join(report.rejected), len(tets_of(made.mesh)), quality.min, quality.mean,
        report.processor_seconds, report.seconds, report.unseeded, dict(_least(name, made, scale)), scale,
    )  # fmt: skip


def _maker(name: str, case: Case) -> Callable[[], Generated]:
    if name == "background":
        return lambda: around_block(case, finer_background(case), Stopwatch())
    return lambda: generate_undeflected(case, Stopwatch())


def _least(name: str, made: Generated, scale: str) -> Iterator[tuple[str, float]]:
    for one in MESHES[name]:
        found = deflect(plan_of(case_named(one, scale), made.mesh))
        yield one, min(quality.min for quality in found.quality)


def markdown(trials: list[Trial]) -> str:
    """Return the page: a table of medians and extremes for each scale, and the attempts that were rejected."""
    scales = dict.fromkeys(trial.scale for trial in trials)
    parts = [_table([trial for trial in trials if trial.scale == scale], scale) for scale in scales]
    about = (
        "Each mesh is made from seeds 1, 2, 3, ... `python -m benchmarks.mesh_seeds` measures it. A mesh that fails "
        "verification is made again with the next seed. Columns of three figures have the least, median and largest. "
        "Quality is the mean ratio; after the deflection it is that of the cells at the box, repaired. Processor "
        "seconds are those of the volume mesher.\n"
    )
    return "\n".join(["# Reliability of the mesher\n", about, *parts])


def _table(trials: list[Trial], scale: str) -> str:
    heads = ("mesh", "seeds", "passed at once", "passed", "cells", "least quality", "after, by case", "processor s")
    lines = ["| " + " | ".join(heads) + " |", "| --- |" + " ---: |" * 5 + " --- | ---: |"]
    for name, cases in MESHES.items():
        own = [one for one in trials if one.mesh == name]
        passed = [one for one in own if one.attempts]
        if not passed:
            continue
        after = [f"`{case}` {_span([(one.least or {})[case] for one in passed], '.3f')}" for case in cases]
        cells = (
            name, str(len(own)), str(sum(one.attempts == 1 for one in own)), str(len(passed)),
            _span([one.cells for one in passed], ",.0f"), _span([one.quality_min for one in passed], ".3f"),
            "; ".join(after), _span([one.processor_seconds for one in passed], ".0f"),
        )  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    rejected = [f"- {one.mesh}, seed {one.seed}: {one.rejected}" for one in trials if one.rejected]
    return "\n".join([f"## Scale `{scale}`\n", *lines, "", *(rejected or ["No attempt was rejected."]), ""])


def _span(values: list[float], form: str) -> str:
    return " / ".join(f"{value:{form}}" for value in (min(values), median(values), max(values)))


def main() -> None:
    """Go through seeds and meshes; keep what is done."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mesh_seeds", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="number of seeds, from 1")
    parser.add_argument("--scale", default="small", help="scale of the meshes")
    parser.add_argument("--json", type=Path, required=True, metavar="FILE", help="where the trials are kept")
    given = parser.parse_args()
    kept = json.loads(given.json.read_text(encoding="utf-8")) if given.json.exists() else []
    trials = [Trial(**one) for one in kept]
    for seed in range(1, given.seeds + 1):
        for name in MESHES:
            if not any((one.mesh, one.seed, one.scale) == (name, seed, given.scale) for one in trials):
                trials.append(trial(name, seed, given.scale))
                print(trials[-1], flush=True)
                text = json.dumps([asdict(one) for one in trials], indent=1)
                with replacing(given.json) as beside:
                    beside.write_text(text + "\n", encoding="utf-8")
                given.json.with_suffix(".md").write_text(markdown(trials), encoding="utf-8")


if __name__ == "__main__":
    main()
