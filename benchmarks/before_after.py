"""Two versions of the program side by side: ``python -m benchmarks.before_after --before FOLDER COMMAND --after ...``.

FOLDER is a checkout, COMMAND its command line, such as ``/path/to/python -m sdm_deflect``; the first word is the
interpreter of its environment. Both do the same in turn, the first turn untimed: a run of the tail from the mesh cache,
the deflection of a block of tetrahedra in a SU2 file, and the adaptations of `benchmarks.adaptation`. Every run is a
process of its own. Wall-clock seconds are what a user waits; processor seconds suffer less from others on the machine.
"""

import argparse
import json
import os
import shlex
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np

from benchmarks.mesh_formats import box_of_tets, triangles
from benchmarks.results import Result, show, write
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from studies.machine import machine

# Corners of the flap in the unit cube; it is one box thick.
LOWER, UPPER = (0.4, 0.3, 0.5), (0.6, 0.7, 0.5)
TETS = 3_000_000
ANGLE = 10.0
# What a version says of its own adaptations: the second smallest of four times, the first of which loads code.
ADAPTATIONS = """
import json
from time import perf_counter
from benchmarks import adaptation as its
from benchmarks.workloads import aileron, chimera, tail
def options(n_add, centers=10_000, tol=1e-12):
    return its.GreedyOptions(n_add=n_add, tol_add=tol, tol_stop=tol, max_centers=centers)
several = {
    "adaptation_aileron": its.Runs(aileron()).grown("", options(1, 348), its.Worst()),
    "adaptation_chimera": its.Runs(chimera()).grown("", options(8, tol=8e-5), its.Worst()),
    "adaptation_chimera_lean": its.Runs(chimera()).grown("", options(8, tol=8e-5), its.Separated()),
    "adaptation_tail": its.Runs(tail()).grown("", options(12, 2_200), its.Worst()),
    "adaptation_tail_lean": its.Runs(tail()).grown("", options(12, 1_900), its.Separated()),
}
def seconds(action):
    start = perf_counter()
    action()
    return perf_counter() - start
print(json.dumps({name: sorted(seconds(adapt) for _ in range(4))[1] for name, adapt in several.items()}))
"""

# Seconds by the name of the figure.
Taken = dict[str, float]


@dataclass(frozen=True, slots=True)
class Version:
    """A checkout and how its command is called."""

    folder: Path
    command: tuple[str, ...]
    cache: Path

    def timed(self, words: Sequence[str]) -> tuple[str, float, float]:
        """Run words of the interpreter's or the command's; return its output, wall-clock and processor seconds.

        Raises
        ------
        RuntimeError
            If it ends with another code than 0; the last line of what it said is in the message.
        """
        own = {"PYTHONPATH": str(self.folder), "SDM_DEFLECT_CACHE": str(self.cache)}
        spent, start = _children(), perf_counter()
        done = subprocess.run(words, cwd=self.folder, env=os.environ | own, capture_output=True, text=True, check=False)
        seconds = perf_counter() - start
        if done.returncode:
            said = (done.stderr or done.stdout).strip().splitlines()[-1:]
            raise RuntimeError(f"{shlex.join(words)} in {self.folder} ended with {done.returncode}: {' '.join(said)}")
        return done.stdout, seconds, _children() - spent

    def taken(self, mesh: Path) -> Taken:
        """Do everything once."""
        found: Taken = {}
        with tempfile.TemporaryDirectory() as scratch:
            works = {"run_tail": ["run", "tail", "--out", f"{scratch}/run"], "deflect": deflection(mesh, Path(scratch))}
            known = self.timed([*self.command, "deflect", "--help"])[0]
            for words in (["--no-report"], ["--repair", "off"]):  # as the versions without reports and repairs
                works["deflect"] += words if words[0] in known else []
            for name, words in works.items():
                _, found[name], found[f"{name}_processor"] = self.timed([*self.command, *words, "--quiet"])
        output, _, _ = self.timed([self.command[0], "-c", ADAPTATIONS])
        adapted: Taken = json.loads(output)
        return found | adapted


def block_with_flap(cells: int) -> Mesh:
    """Cut a thin plate, the patch ``flap``, out of the unit cube of cells^3 boxes of six tetrahedra each."""
    whole, n = box_of_tets(cells), cells + 1
    low = (cells * np.array(LOWER)).astype(int)
    high = np.maximum((cells * np.array(UPPER)).astype(int), low + 1)
    index = np.arange(n**3).reshape(n, n, n)
    boxes = np.zeros((cells, cells, cells), dtype=bool)
    slices = [slice(a, b) for a, b in zip(low, high, strict=True)]
    boxes[tuple(slices)] = True
    plate = index[tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))]
    faces = [triangles(np.take(plate, end, axis)) for axis in range(3) for end in (0, -1)]
    flap = Patch("flap", (Cells("triangle", np.concatenate(faces)),))
    tets = whole.cells[0].nodes[~np.tile(boxes.ravel(), 6)]  # type: ignore[union-attr]
    return Mesh(whole.points, (Cells("tetra", tets),), (*whole.patches, flap))


def deflection(mesh: Path, out: Path) -> list[str]:
    """Return the words of the command that turns the flap about its forward edge."""
    x, z = LOWER[0], LOWER[2]
    hinge = [f"{x},{y},{z}" for y in (LOWER[1], UPPER[1])]
    moving = ["--surface", "flap", "--fixed", "side*", "--hinge", *hinge, "--angle", f"{ANGLE:g}"]
    return ["deflect", str(mesh), *moving, "--out", str(out / mesh.name)]


def compared(before: Version, after: Version, mesh: Path, rounds: int) -> Iterator[Result]:
    """Yield how long the one takes over the other: above 1 the version after is faster."""
    taken: tuple[list[Taken], list[Taken]] = ([], [])
    for turn in range(rounds + 1):
        both = list(zip((before, after), taken, strict=True))
        for version, of_it in both if turn % 2 else reversed(both):
            of_it.append(version.taken(mesh))
    for name in taken[1][0]:
        old, new = (np.array([one[name] for one in of_it[1:]]) for of_it in taken)
        note = f"{median(old):.3f} s before, {median(new):.3f} s after"
        yield Result(name, float(np.median(old / new)), "before / after", rounds, note)


def main() -> None:
    """Compare two versions and print one table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.before_after", description=__doc__)
    for which in ("before", "after"):
        parser.add_argument(f"--{which}", nargs=2, required=True, metavar=("FOLDER", "COMMAND"))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--tets", type=int, default=TETS, help="of the block")
    parser.add_argument("--json", type=Path, metavar="FILE")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        mesh, cache = Path(scratch) / "block.su2", Path(scratch) / "cache"
        FORMATS["su2"].write(block_with_flap(round((given.tets / 6) ** (1 / 3))), mesh)
        before, after = (
            Version(Path(folder).resolve(), tuple(shlex.split(command)), cache)
            for folder, command in (given.before, given.after)
        )
        results = list(compared(before, after, mesh, given.rounds))
    show(f"{given.before[0]} against {given.after[0]}; {machine()}", results)
    if given.json is not None:
        write(given.json, results)


def _children() -> float:
    """Return the processor seconds of all processes that this one has waited for."""
    times = os.times()
    return times.children_user + times.children_system


if __name__ == "__main__":
    main()
