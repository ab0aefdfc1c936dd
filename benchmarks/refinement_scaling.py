"""Time and memory of a deformation against the size of the mesh, on nested meshes.

``python -m benchmarks.refinement_scaling --refinements 3 --json FILE`` meshes the aircraft coarsely, refines it
uniformly again and again and deflects the left tail in each mesh. The centres are chosen once, on the mesh that was
refined once: what grows with the mesh is the search for the nodes inside the hexahedron and the evaluation there.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TypeVar

import numpy as np

from benchmarks.measure import exponent
from benchmarks.results import machine
from cases.case import Case
from cases.deflect import deflect
from cases.registry import case_named
from deform.hexahedron import Hexahedron
from deform.interpolant import Interpolant
from deform.volume import fused
from geometry.aircraft import build
from meshing.child import peak_bytes
from meshing.generate import generate
from meshing.mesh import FloatArray, IntArray, TetMesh
from meshing.parameters import SCALES, MeshParameters
from meshing.quality import mean_ratio
from meshing.refine import refined

T = TypeVar("T")

# Sizes of the coarsest mesh by those of the small scale: refined three times it has 40 million cells.
COARSER = 1.22
RESET = Path("/proc/self/clear_refs")


@dataclass(frozen=True, slots=True)
class Size:
    """One mesh of the series and what its deformation took; qualities are the smallest mean ratios.

    Attributes
    ----------
    refine_seconds, refine_peak_bytes : making it from the mesh before, and the process's peak memory meanwhile.
    filter_seconds, evaluation_seconds : finding the nodes inside the hexahedron, and their displacement.
    deform_peak_bytes : the process's peak memory during both, the mesh included.
    """

    refinements: int
    points: int
    cells: int
    inside: int
    refine_seconds: float
    refine_peak_bytes: int
    filter_seconds: float
    evaluation_seconds: float
    deform_peak_bytes: int
    quality_before: float
    quality_after: float

    @property
    def deform_seconds(self) -> float:
        """Filter and evaluation."""
        return self.filter_seconds + self.evaluation_seconds


def series(parameters: MeshParameters, refinements: int) -> Iterator[Size]:
    """Yield one mesh after the other; the centres are those chosen on the first."""
    case = case_named("tail")
    model = build(case.fighter)
    mesh, seconds, peak = measured(partial(refined, generate(model, parameters).mesh, model))
    interpolant, region = fitted(case, mesh)
    yield deformed(mesh, interpolant, region, (1, seconds, peak))
    for level in range(2, refinements + 1):
        mesh, seconds, peak = measured(partial(refined, mesh, model))
        yield deformed(mesh, interpolant, region, (level, seconds, peak))


def fitted(case: Case, mesh: TetMesh) -> tuple[Interpolant, Hexahedron]:
    """The interpolant of the tail's deflection on a mesh, and where it applies."""
    found = deflect(mesh, case, case.deflections[0], lambda text, fraction: None)
    return fused(found.steps[0].fits), found.turn.region.hexahedron


def deformed(mesh: TetMesh, interpolant: Interpolant, region: Hexahedron, made: tuple[int, float, int]) -> Size:
    """Deform a mesh; `made` is how often it was refined, and the last time's seconds and peak memory."""
    interpolant(mesh.points[:1000])  # loads the machine code
    region.contains(mesh.points[:1000])
    inside, filter_seconds, _ = measured(lambda: np.flatnonzero(region.contains(mesh.points)))
    moves, evaluation_seconds, peak = measured(lambda: interpolant(mesh.points[inside]))
    before, after = qualities(mesh, inside, moves)
    level, refine_seconds, refine_peak = made
    return Size(
        level,
        len(mesh.points),
        len(mesh.tets),
        len(inside),
        refine_seconds,
        refine_peak,
        filter_seconds,
        evaluation_seconds,
        peak,
        before,
        after,
    )


def qualities(mesh: TetMesh, inside: IntArray, moves: FloatArray) -> tuple[float, float]:
    """Smallest mean ratio of the cells that touch the moved nodes, before and after."""
    moved = np.zeros(len(mesh.points), dtype=bool)
    moved[inside] = True
    cells = mesh.tets[moved[mesh.tets].any(axis=1)]
    before = mean_ratio(mesh.points, cells).min()
    points = mesh.points.copy()
    points[inside] += moves
    return float(before), float(mean_ratio(points, cells).min())


def measured(action: Callable[[], T]) -> tuple[T, float, int]:
    """The action's result, its seconds and the process's peak memory in bytes meanwhile."""
    if RESET.exists():
        RESET.write_text("5", encoding="ascii")
    start = perf_counter()
    result = action()
    return result, perf_counter() - start, peak_bytes()


def table(sizes: list[Size]) -> str:
    """Markdown: one row for each mesh."""
    rows = [
        f"| {one.refinements} | {one.cells:,} | {one.points:,} | {one.inside:,} | {one.refine_seconds:.1f} "
        f"| {one.refine_peak_bytes / 1e9:.2f} | {one.filter_seconds:.3f} | {one.evaluation_seconds:.2f} "
        f"| {one.deform_seconds * 1e6 / one.points:.2f} | {one.deform_peak_bytes / 1e9:.2f} "
        f"| {one.quality_before:.3f} | {one.quality_after:.3f} |"
        for one in sizes
    ]
    growth = ""
    if len(sizes) > 1:
        power = exponent([one.points for one in sizes], [one.deform_seconds for one in sizes])
        growth = f" Deformation takes time as points to the power of {power:.2f}."
    return "\n".join(
        [
            "# Deformation against the size of the mesh",
            "",
            "The left tail turned by 12 degrees in nested meshes, each the uniform refinement of the one before with "
            "its boundary nodes put on the CAD. The centres are those chosen on the first mesh." + growth,
            "",
            f"On {machine()}. Peaks are the whole process's, the mesh included; Q is the smallest mean ratio of the "
            "cells in the hexahedron. After the deformation, nodes of the surface are where the interpolant takes "
            "them, within the tolerance of the adaptation, and not yet put on the turned CAD.",
            "",
            "| refined | cells | points | inside | refinement (s) | its peak (GB) | filter (s) | evaluation (s) "
            "| deformation (s per million points) | its peak (GB) | Q before | Q after |",
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
            *rows,
            "",
        ]
    )


def main() -> None:
    """Run the series; the files are rewritten after each mesh."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--refinements", type=int, default=3)
    parser.add_argument("--coarser", type=float, default=COARSER, help="sizes by those of the small scale")
    parser.add_argument("--json", type=Path, required=True, help="result; a .md table goes beside it")
    options = parser.parse_args()
    sizes: list[Size] = []
    for one in series(SCALES["small"].scaled(options.coarser), options.refinements):
        sizes.append(one)
        result = {"machine": machine(), "sizes": [asdict(each) for each in sizes]}
        options.json.write_text(json.dumps(result, indent=1) + "\n")
        options.json.with_suffix(".md").write_text(table(sizes))
        print(one, flush=True)


if __name__ == "__main__":
    main()
