"""How often the mesher succeeds: it is not deterministic, so the rate is measured.

``python -m benchmarks.mesh_reliability --count 20 --json FILE`` makes meshes of the undeflected aircraft from
scratch, without any cache, and writes what became of each.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

from sdm_deflect.geometry.aircraft import build
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.child import MeshingError
from sdm_deflect.meshing.generate.generation import generate
from sdm_deflect.meshing.generate.parameters import SCALES, MeshParameters
from sdm_deflect.meshing.mesh import tets_of


@dataclass(frozen=True, slots=True)
class Trial:
    """One mesh from scratch; attempts is 0 where none of them passed verification."""

    attempts: int
    rejected: tuple[str, ...]
    seconds: float
    cells: int
    quality_min: float
    quality_mean: float
    below_0_4: float
    boundary_to_cad_max: float
    worst_patch: str
    mesher_peak_bytes: int
    mesher_processor_seconds: float


def trial(model: CadModel, parameters: MeshParameters) -> Trial:
    """Make one mesh."""
    start = time.perf_counter()
    try:
        made = generate(model, parameters)
    except MeshingError as error:
        return Trial(0, (str(error),), time.perf_counter() - start, 0, 0.0, 0.0, 0.0, 0.0, "", 0, 0.0)
    checked = made.report.verification
    return Trial(
        attempts=made.report.attempts,
        rejected=made.report.rejected,
        seconds=made.report.seconds,
        cells=len(tets_of(made.mesh)),
        quality_min=checked.quality.min,
        quality_mean=checked.quality.mean,
        below_0_4=checked.quality.below_0_4,
        boundary_to_cad_max=checked.boundary_to_cad_max,
        worst_patch=min(checked.worst, key=lambda patch: checked.worst[patch].quality),
        mesher_peak_bytes=made.report.peak_bytes,
        mesher_processor_seconds=made.report.processor_seconds,
    )


def summary(trials: list[Trial]) -> dict[str, float]:
    """Counts, and medians and extremes over the meshes that passed."""
    passed = [one for one in trials if one.attempts]
    return {
        "meshes": len(trials),
        "passed_first_try": sum(one.attempts == 1 for one in trials),
        "passed_with_retry": len(passed),
        "seconds_median": median(one.seconds for one in trials),
        "seconds_max": max(one.seconds for one in trials),
        "mesher_processor_seconds_median": median(one.mesher_processor_seconds for one in trials),
        "quality_min_lowest": min((one.quality_min for one in passed), default=0.0),
        "quality_mean_lowest": min((one.quality_mean for one in passed), default=0.0),
        "boundary_to_cad_max": max((one.boundary_to_cad_max for one in passed), default=0.0),
    }


def table(trials: list[Trial], scale: str) -> str:
    """Markdown: the summary in a sentence, then one row for each mesh."""
    figures = summary(trials)
    rows = [
        f"| {i} | {one.attempts or 'none passed'} | {one.seconds:.1f} | {one.mesher_processor_seconds:.1f} "
        f"| {one.cells} | {one.quality_min:.3f} | {one.worst_patch} "
        f"| {one.quality_mean:.4f} | {one.below_0_4:.4%} | {one.boundary_to_cad_max:.1e} "
        f"| {one.mesher_peak_bytes / 1e9:.2f} |"
        for i, one in enumerate(trials, 1)
    ]
    reasons = [f"- mesh {i}: {reason}" for i, one in enumerate(trials, 1) for reason in one.rejected]
    return "\n".join(
        [
            "# Reliability of the mesher",
            "",
            f"{figures['meshes']} meshes of the undeflected aircraft at {scale} scale, each from scratch: "
            f"{figures['passed_first_try']} passed verification at the first try, "
            f"{figures['passed_with_retry']} with retries. "
            f"Median {figures['seconds_median']:.1f} s, longest {figures['seconds_max']:.1f} s; "
            f"smallest mean ratio of all accepted meshes {figures['quality_min_lowest']:.3f}.",
            "",
            "Seconds are wall-clock time of everything from the CAD model on; the processor seconds of the volume "
            "mesher (last attempt) do not depend on what else the machine was doing.",
            "",
            "| mesh | attempts | seconds | processor seconds | cells | Q min | worst cell at | Q mean | below 0.4 "
            "| to CAD (m) | mesher's peak (GB) |",
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
            *rows,
            "",
            "Rejected attempts:" if reasons else "No attempt was rejected.",
            *([""] if reasons else []),
            *reasons,
            "",
        ]
    )


def main() -> None:
    """Run the trials; the files are rewritten after each, so an interruption loses one mesh only."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--scale", choices=sorted(SCALES), default="small")
    parser.add_argument("--json", type=Path, required=True, help="result; a .md table goes beside it")
    options = parser.parse_args()
    model = build(Fighter())
    trials: list[Trial] = []
    for number in range(1, options.count + 1):
        trials.append(trial(model, SCALES[options.scale]))
        result = {"scale": options.scale, "summary": summary(trials), "trials": [asdict(one) for one in trials]}
        options.json.write_text(json.dumps(result, indent=1) + "\n")
        options.json.with_suffix(".md").write_text(table(trials, options.scale))
        print(f"{number}/{options.count}: {trials[-1]}", flush=True)


if __name__ == "__main__":
    main()
