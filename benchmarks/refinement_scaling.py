"""Time and memory of a deformation against the size of the mesh, on nested meshes.

``python -m benchmarks.refinement_scaling --refinements 3 --json FILE`` meshes the aircraft coarsely, refines it
uniformly again and again and deflects the left tail in each mesh: the search for the nodes inside the hexahedron and
the evaluation there with the same centres on all meshes, and the whole deflection with centres chosen anew.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter, process_time
from typing import TypeVar

import numpy as np

from benchmarks.measure import exponent
from benchmarks.results import machine
from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.quality import mean_ratio
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.volume.deflection import BoxDeflection, deflect
from sdm_deflect.geometry.aircraft import build
from sdm_deflect.meshing.child import peak_bytes
from sdm_deflect.meshing.generate.generation import generate, refined
from sdm_deflect.meshing.generate.parameters import SCALES, MeshParameters
from sdm_deflect.meshing.mesh import tets_of, touching

T = TypeVar("T")

# A little coarser than the small scale: refined three times it has 40 million cells.
COARSE = replace(SCALES["small"].scaled(1.22), growth=0.4, accept_mean=0.86)
ROUNDS = 3
RESET = Path("/proc/self/clear_refs")


@dataclass(frozen=True, slots=True)
class Cost:
    """Wall-clock time, processor time of all threads, and the process's peak memory.

    The peak is that of the time meanwhile where the system lets it be reset, else that since the process began.
    """

    seconds: float
    processor_seconds: float
    peak_bytes: int


@dataclass(frozen=True, slots=True)
class Size:
    """One mesh of the series and what its deformation took.

    Attributes
    ----------
    refine_seconds, refine_processor_seconds, refine_peak_bytes : making it from the mesh before, and the process's
        peak memory meanwhile.
    filter_seconds, evaluation_seconds : finding the nodes inside the hexahedron, and their displacement, with the
        centres of the first mesh.
    deflect_seconds, deflect_processor_seconds, deflect_peak_bytes, centers : everything from the surface's motion
        on, centres chosen anew (of all directions), and the process's peak memory, the mesh included.
    quality_before, quality_after, inverted : smallest mean ratio of the cells in the hexahedron, and how many of
        them are inverted after everything.
    """

    refinements: int
    points: int
    cells: int
    inside: int
    refine_seconds: float
    refine_processor_seconds: float
    refine_peak_bytes: int
    filter_seconds: float
    evaluation_seconds: float
    deflect_seconds: float
    deflect_processor_seconds: float
    deflect_peak_bytes: int
    centers: int
    quality_before: float
    quality_after: float
    inverted: int

    @property
    def deform_seconds(self) -> float:
        """Filter and evaluation."""
        return self.filter_seconds + self.evaluation_seconds


def series(parameters: MeshParameters, refinements: int) -> Iterator[Size]:
    """Yield one mesh after the other, beginning with the one refined once."""
    case = case_named("tail")
    model = build(case.fighter)
    mesh, first = generate(model, parameters).mesh, None
    for level in range(1, refinements + 1):
        mesh, made = measured(partial(refined, mesh, model))
        first = first or turned(mesh, case).steps[0].fits.interpolant
        yield size(mesh, case, first, level, made)


def size(mesh: Mesh, case: Case, first: Interpolant, refinements: int, made: Cost) -> Size:
    """Measure on one mesh; `made` is what its last refinement took."""
    found, cost = measured(partial(turned, mesh, case))
    hexahedron, inside = found.plan.region.hexahedron, found.plan.region.inside
    cells = tets_of(mesh)[touching(mesh, inside)]
    return Size(
        refinements=refinements,
        points=len(mesh.points),
        cells=len(tets_of(mesh)),
        inside=len(inside),
        refine_seconds=made.seconds,
        refine_processor_seconds=made.processor_seconds,
        refine_peak_bytes=made.peak_bytes,
        filter_seconds=fastest(lambda: np.flatnonzero(hexahedron.contains(mesh.points))),
        evaluation_seconds=fastest(lambda: first(mesh.points[inside])),
        deflect_seconds=cost.seconds,
        deflect_processor_seconds=cost.processor_seconds,
        deflect_peak_bytes=cost.peak_bytes,
        centers=sum(len(fit.interpolant.centers) for step in found.steps for fit in step.fits.adaptations),
        quality_before=float(mean_ratio(mesh.points, cells).min()),
        quality_after=float(mean_ratio(found.points, cells).min()),
        inverted=found.inverted,
    )


def turned(mesh: Mesh, case: Case) -> BoxDeflection:
    """Deflect the case's control surface."""
    plan = plan_of(case, mesh)
    (found,) = deflect(plan, plan.angle).boxes
    return found


def measured(action: Callable[[], T]) -> tuple[T, Cost]:
    """The action's result and what it took."""
    if RESET.exists():
        RESET.write_text("5", encoding="ascii")
    start, processor = perf_counter(), process_time()
    result = action()
    return result, Cost(perf_counter() - start, process_time() - processor, peak_bytes())


def fastest(action: Callable[[], object]) -> float:
    """Seconds of the fastest of several times: other work on the machine only adds to them."""
    return min(measured(action)[1].seconds for _ in range(ROUNDS))


def table(sizes: list[Size]) -> str:
    """Markdown: one row for each mesh."""
    rows = [
        f"| {one.refinements} | {one.cells:,} | {one.points:,} | {one.inside:,} "
        f"| {one.refine_seconds:.1f} | {one.refine_processor_seconds:.1f} "
        f"| {one.refine_peak_bytes / 1e9:.2f} | {1e3 * one.filter_seconds:.1f} | {1e3 * one.evaluation_seconds:.1f} "
        f"| {one.deflect_seconds:.1f} | {one.deflect_processor_seconds:.1f} | {one.centers} "
        f"| {one.deflect_peak_bytes / 1e9:.2f} | {one.quality_before:.3f} | {one.quality_after:.3f} | {one.inverted} |"
        for one in sizes
    ]
    growth = ""
    if len(sizes) > 1:
        power = exponent([one.points for one in sizes], [one.deform_seconds for one in sizes])
        growth = f" Filter and evaluation together take time as points to the power of {power:.2f}."
    return "\n".join(
        [
            "# Deformation against the size of the mesh",
            "",
            "The left tail turned by 12 degrees in nested meshes, each the uniform refinement of the one before with "
            f"its boundary nodes put on the CAD.{growth}",
            "",
            f"On {machine()}, shared with other work. Filter and evaluation have the centres of the first mesh, and "
            f"are the fastest of {ROUNDS}; `all` is everything from the motion of the surface on, once, with centres "
            "chosen on that mesh. Peaks are the whole process's, the mesh included; Q is the smallest mean ratio of "
            "the cells in the hexahedron. Processor seconds do not depend on what else the machine was doing.",
            "",
            "| refined | cells | points | inside | refinement (s) | processor (s) | its peak (GB) "
            "| filter (ms) | evaluation (ms) "
            "| all (s) | processor (s) | centres, three directions | its peak (GB) | Q before | Q after | inverted |",
            "|" + 16 * " --- |",
            *rows,
            "",
        ]
    )


def main() -> None:
    """Run the series; the files are rewritten after each mesh."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--refinements", type=int, default=3)
    parser.add_argument("--json", type=Path, required=True, help="result; a .md table goes beside it")
    options = parser.parse_args()
    sizes: list[Size] = []
    for one in series(COARSE, options.refinements):
        sizes.append(one)
        result = {"machine": machine(), "sizes": [asdict(each) for each in sizes]}
        options.json.write_text(json.dumps(result, indent=1) + "\n")
        options.json.with_suffix(".md").write_text(table(sizes))
        print(one, flush=True)


if __name__ == "__main__":
    main()
