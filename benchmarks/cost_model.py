"""What a deflection of a large mesh costs: seconds and bytes, measured, fitted and extrapolated to 1e9 nodes.

``python -m benchmarks.cost_model FOLDER cost_model.md`` makes blocks of 1e6, 1e7 and 1e8 nodes (`large_block`; 6.3
GB of CGNS, and as much again for what is written) in a folder, deflects them with several boxes, and fits

    seconds = start + scan x bytes of the file + near x nodes inside + sum x nodes inside x centres
    memory = start + border x nodes on patches + near x nodes inside + held x nodes of meshes that are held in memory

Each size is also predicted from the others alone: that error is the model's.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.optimize import nnls

from benchmarks.large_block import DEGREES, write_block
from benchmarks.measure import FloatArray
from benchmarks.results import machine
from sdm_deflect.deform.base.threads import LIMITS

EDGES = 100, 216, 464
"""Nodes along an edge."""
VARIANTS = ((0.05, 0.01), (0.17, 0.01), (0.17, 0.001), (0.25, 0.01))
"""Margin of the box, and tolerance in mean edges of the mesh."""
SECONDS = ("start", "scan", "near", "sum")
BYTES = ("start", "border", "near", "held")
ASKED = ((10**9, 0.01, 500), (10**9, 0.05, 500), (10**9, 0.05, 2000))
"""Nodes, share of them inside, centres."""
SIDE = 6
"""Sides of a block."""


@dataclass(frozen=True, slots=True)
class Run:
    """One deflection: what it had to do, and what that took."""

    nodes: int
    size: int
    inside: int
    centers: int
    seconds: float
    memory: float
    copy: float

    @property
    def work(self) -> list[float]:
        """What seconds are proportional to."""
        return [1.0, self.size, self.inside, self.inside * self.centers]

    @property
    def room(self) -> list[float]:
        """What memory is proportional to."""
        return [1.0, SIDE * self.nodes ** (2 / 3), self.inside, self.nodes * (self.nodes <= LIMITS.held)]


def run(source: Path, edge: int, margin: float, tolerance: float) -> Run:
    """Deflect a block, in a process of its own, and copy the file beside it."""
    out = source.with_name("deflected.cgns")
    command = [
        *(sys.executable, "-m", "sdm_deflect", "deflect", source, "--surface", "flap", "--fixed", "wall"),
        *("--table", source.with_suffix(".npz"), "--margin", str(margin), "--tolerance", str(tolerance / edge)),
        *("--repair", "off", "--no-report", "--json", "--out", out),
    ]
    begin = perf_counter()
    with tempfile.TemporaryFile() as figures:
        process = subprocess.Popen(list(map(str, command)), stdout=figures, stderr=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        seconds = perf_counter() - begin
        if status:
            raise RuntimeError(f"{' '.join(map(str, command))} ended with {status}")
        figures.seek(0)
        (found,) = json.load(figures)["angles"]
    out.unlink()
    begin = perf_counter()
    subprocess.run(["cp", source, out], check=True)
    copy = perf_counter() - begin
    out.unlink()
    centers = max(one["centers"] for one in found["adaptation"].values())
    return Run(
        edge**3, source.stat().st_size, found["confinement"]["inside"], centers, seconds, 1024.0 * used.ru_maxrss, copy
    )


def fitted(rows: Sequence[Sequence[float]], values: Sequence[float]) -> FloatArray:
    """Return the coefficients, none negative, with the least sum of squared relative errors."""
    relative = np.array(rows, dtype=np.float64) / np.array(values)[:, None]
    scale = np.maximum(relative.max(axis=0), np.finfo(np.float64).tiny)
    return np.asarray(nnls(relative / scale, np.ones(len(values)))[0] / scale)


def worst(rows: Sequence[Sequence[float]], values: Sequence[float], sizes: Sequence[int]) -> dict[int, float]:
    """Return, for each size, the largest relative error of a model fitted to the runs of the other sizes."""
    errors = {}
    for size in sorted(set(sizes)):
        others = [i for i, own in enumerate(sizes) if own != size]
        model = fitted([rows[i] for i in others], [values[i] for i in others])
        own = [i for i, one in enumerate(sizes) if one == size]
        errors[size] = max(abs(float(np.dot(rows[i], model)) / values[i] - 1.0) for i in own)
    return errors


def report(runs: Sequence[Run]) -> str:
    """Return the measurements, the models and what they say of 1e9 nodes, as a page."""
    sizes = [one.nodes for one in runs]
    works, seconds = [one.work for one in runs], [one.seconds for one in runs]
    rooms, memory = [one.room for one in runs], [one.memory for one in runs]
    time, room = fitted(works, seconds), fitted(rooms, memory)
    lines = [
        "# What a deflection of a large mesh costs",
        "",
        f"`python -m benchmarks.cost_model`: {machine()}. Blocks of hexahedra in CGNS, a flap by {DEGREES:g} degrees, "
        "without repair and report; one process of two threads.",
        "",
        "| nodes | file, GB | inside | centres | seconds | model | `cp`, s | ratio | peak, GB | model |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {one.nodes:.3g} | {one.size / 1e9:.2f} | {one.inside:,} | {one.centers} | {one.seconds:.1f} | "
        f"{np.dot(one.work, time):.1f} | {one.copy:.1f} | {one.seconds / one.copy:.1f} | {one.memory / 1e9:.2f} | "
        f"{np.dot(one.room, room) / 1e9:.2f} |"
        for one in runs
    ]
    scales = (("s", 1.0), ("s/GB", 1e9), ("s per million nodes", 1e6), ("s per million nodes and 1,000 centres", 1e9))
    shown = [
        f"{name} {value * factor:.3g} {unit}" for name, value, (unit, factor) in zip(SECONDS, time, scales, strict=True)
    ]
    lines += ["", f"Seconds: {', '.join(shown)}."]
    units = (("MB", 1e-6), ("bytes a node on a patch", 1.0), ("bytes a node inside", 1.0), ("bytes a node held", 1.0))
    shown = [
        f"{name} {value * factor:.4g} {unit}" for name, value, (unit, factor) in zip(BYTES, room, units, strict=True)
    ]
    lines += [f"Memory: {', '.join(shown)}.", ""]
    for what, errors in (("seconds", worst(works, seconds, sizes)), ("memory", worst(rooms, memory, sizes))):
        said = ", ".join(f"{error:.0%} at {size:.3g}" for size, error in errors.items())
        lines.append(f"Each size predicted from the other two, largest error of {what}: {said}.")
    lines += ["", "| nodes | share inside | centres | seconds | memory, GB |", "| --- | --- | --- | --- | --- |"]
    for nodes, share, centers in ASKED:
        one = Run(nodes, round(56 * nodes), round(share * nodes), centers, 0.0, 0.0, 0.0)
        lines.append(
            f"| {nodes:.3g} | {share:.0%} | {centers:,} | {np.dot(one.work, time):.0f} | "
            f"{np.dot(one.room, room) / 1e9:.1f} |"
        )
    return "\n".join([*lines, ""])


def main(folder: Path, page: Path) -> None:
    """Measure everything and write the page."""
    runs = []
    for edge in EDGES:
        source = folder / f"block{edge}.cgns"
        if not source.exists():
            write_block(source, edge)
        for margin, tolerance in VARIANTS:
            runs.append(run(source, edge, margin, tolerance))
            print(runs[-1], flush=True)
    page.write_text(report(runs), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
