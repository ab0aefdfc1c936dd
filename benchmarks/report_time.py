"""Processor time that a report adds to a deflection: ``python -m benchmarks.report_time FOLDER report_time.md``.

FOLDER takes the meshes (0.5 GB): 64,000 quads around an airfoil, 0.9 million polyhedra, 3.3 million tetrahedra. Each is
deflected without and with a report, in turn, in processes of their own. Processor time depends on what else a machine
does, so that beside the seconds stands their ratio to those of ``import matplotlib.figure`` in the same run.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.large_block import DEGREES, HIGH, LOW, SIDE, write_case
from benchmarks.mesh_formats import box_of_tets
from benchmarks.results import machine
from sdm_deflect.deform.mesh.cells import Cells, Patch
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.deform.paired import section

ROUNDS = 3
AROUND, OUTWARDS = 320, 200
EDGES = 97
"""Nodes along an edge of the block of polyhedra."""
LAYERS = 82
"""Boxes of six tetrahedra along an edge."""
FLOOR = "side 20"
TABLE = ("--surface", "flap", "--fixed", "wall", "--table")
REFERENCE = (sys.executable, "-c", "import matplotlib.figure")


@dataclass(frozen=True, slots=True)
class Example:
    """A mesh: what it is, its file, how it is made, the options that deflect it, and the most seconds allowed."""

    name: str
    file: str
    write: Callable[[Path], None]
    options: tuple[str, ...]
    limit: float


def write_airfoil(path: Path) -> None:
    """Write an airfoil of chord 1 whose rear 30 % are the flap, in a plane."""
    flat, quads = section(AROUND, OUTWARDS)
    first = np.arange(AROUND)
    lines = np.column_stack([first, (first + 1) % AROUND])
    behind = flat[lines, 0].mean(axis=1) > 0.7
    far = lines[:, ::-1] + OUTWARDS * AROUND
    named = {"wing": lines[~behind], "flap": lines[behind], "far": far}
    patches = tuple(Patch(name, (Cells("line", own),)) for name, own in named.items())
    mesh = Mesh(np.column_stack([flat, np.zeros(len(flat))]), (Cells("quad", quads),), patches)
    FORMATS["su2"].write(mesh, path)


def write_polyhedra(path: Path) -> None:
    """Write a block of cubes with a flap in its floor."""
    write_case(path, EDGES)


def write_tetrahedra(path: Path) -> None:
    """Write a block of tetrahedra with a flap in its floor, and the flap's displacements."""
    mesh = box_of_tets(LAYERS)
    floor = mesh.faces_of([FLOOR])[0].nodes
    middle = mesh.points[floor].mean(axis=1)[:, :2]
    on = ((middle > LOW) & (middle < HIGH)).all(axis=1)
    rest = tuple(patch for patch in mesh.patches if patch.name != FLOOR)
    own = (Patch("flap", (Cells("triangle", floor[on]),)), Patch("wall", (Cells("triangle", floor[~on]),)))
    FORMATS["cgns"].write(replace(mesh, patches=(*own, *rest)), path)
    nodes = np.unique(floor[on])
    flap = mesh.points[nodes]
    arm, edge = flap[:, 0] - flap[:, 0].min(), np.minimum(flap - flap.min(axis=0), flap.max(axis=0) - flap)[:, :2]
    share = np.clip(edge / SIDE, 0.0, 1.0).prod(axis=1) * ~np.isin(nodes, floor[~on])
    turned = np.column_stack([arm * (np.cos(np.radians(DEGREES)) - 1.0), 0.0 * arm, arm * np.sin(np.radians(DEGREES))])
    np.savez(path.with_suffix(".npz"), points=flap, vectors=share[:, None] * turned)


HINGED = ("--surface", "flap", "--fixed", "wing", "--motion", "blended", "--hinge", "0.7,0", "--angle", "5")
EXAMPLES = (
    Example("64,000 quads around an airfoil, SU2", "airfoil.su2", write_airfoil, HINGED, 2.0),
    Example("0.9 million polyhedra, OpenFOAM", "block", write_polyhedra, (*TABLE, "block.npz"), 2.0),
    Example("3.3 million tetrahedra, CGNS", "tetrahedra.cgns", write_tetrahedra, (*TABLE, "tetrahedra.npz"), 3.0),
)


def processor_seconds(command: tuple[str, ...], folder: Path) -> float:
    """Return the processor time of a command and of all processes that it waits for."""
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if status:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
    return used.ru_utime + used.ru_stime


def measured(one: Example, folder: Path) -> tuple[float, float, float]:
    """Return the seconds of a deflection without report, with it, and of the reference; medians of some rounds."""
    if not (folder / one.file).exists():
        one.write(folder / one.file)
    words = (sys.executable, "-m", "sdm_deflect", "deflect", one.file, *one.options, "--quiet")
    outs = [(*words, "--out", f"{kind}-{one.file}", *more) for kind, more in (("bare", ("--no-report",)), ("full", ()))]
    rounds = []
    for _ in range(ROUNDS + 1):  # the first compiles
        for old in folder.glob("*-block"):  # a folder is not replaced
            subprocess.run(["rm", "-r", old], check=True)
        rounds.append([processor_seconds(command, folder) for command in (*outs, REFERENCE)])
    bare, full, reference = (median(column) for column in zip(*rounds[1:], strict=True))
    return bare, full, reference


def page(folder: Path) -> Iterator[str]:
    """Yield the lines of the page."""
    yield from ("# What a report costs", "", f"`python -m benchmarks.report_time`: {machine()}. Processor seconds,")
    yield f"medians of {ROUNDS} rounds in turn; the last column is the report over `import matplotlib.figure`."
    yield from ("", "| mesh | deflection | with report | report | limit | report over import |", "|" + " --- |" * 6)
    for one in EXAMPLES:
        bare, full, reference = measured(one, folder)
        yield (
            f"| {one.name} | {bare:.1f} | {full:.1f} | {full - bare:.1f} | {one.limit:g} | "
            f"{(full - bare) / reference:.1f} |"
        )


if __name__ == "__main__":
    place = Path(sys.argv[1])
    place.mkdir(parents=True, exist_ok=True)
    lines = []
    for line in page(place):
        print(line, flush=True)
        lines.append(line)
    Path(sys.argv[2]).write_text("\n".join([*lines, ""]), encoding="utf-8")
