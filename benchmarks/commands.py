"""Seconds and memory of whole commands: ``python -m benchmarks.commands [NAME ...]``.

Each run is a process of its own, in a folder of meshes that is made first. One round runs a command once for each
number of `--threads` and each checkout, in turn. `--beside FOLDER` is another checkout, run by this Python. Compiled
code comes from disk, except for the commands named `cold`. `--size` measures blocks of hexahedra of so many nodes,
without a repair, as in docs/large-meshes.md.
"""

import argparse
import hashlib
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from time import perf_counter, sleep

import numpy as np

from benchmarks.large_block import write_block, write_case
from benchmarks.mesh_formats import box_of_tets, triangles
from benchmarks.results import Result, show, write
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from studies.machine import machine

ROOT = Path(__file__).parents[1]
# Corners of the flap in the unit cube of tetrahedra; it is one box thick.
LOWER, UPPER = (0.4, 0.3, 0.5), (0.6, 0.7, 0.5)
# Boxes along an edge of the cube, of six tetrahedra each: 1.0 million tetrahedra.
BOXES = 55
# Nodes along an edge of the block of hexahedra: 2.1 million nodes.
EDGE = 128
# Words of the commands: README's half wing, the flap of a block, the flap of the cube.
WING = "naca.su2 --surface flap --fixed wing --hinge 0.7,0.6,0 0.7,1.4,0 --angle 15 --motion blended"
FLAP = "--surface flap --fixed wall"
TETS = (
    f"tets.su2 --surface flap --fixed side* --hinge {LOWER[0]},{LOWER[1]},{LOWER[2]} {LOWER[0]},{UPPER[1]},{LOWER[2]}"
)
# Seconds between two looks at a process: short beside the .02 s of the shortest command.
INTERVAL = 0.01
IMPORT = "import sdm_deflect.cases.run.deflect_file"


@dataclass(frozen=True, slots=True)
class Command:
    """A command that is measured: the words after `sdm`, or a program for Python; `cold` compiles everything."""

    words: str
    cold: bool = False
    program: bool = False


COMMANDS = {
    "import": Command(IMPORT, program=True),
    "wing-cold": Command(f"deflect {WING} --out OUT.su2", cold=True),
    "wing": Command(f"deflect {WING} --out OUT.su2"),
    "wing-no-report": Command(f"deflect {WING} --no-report --out OUT.su2"),
    "case-cold": Command("run aileron --scale small --out OUT.run", cold=True),
    "case": Command("run aileron --scale small --out OUT.run"),
    "fighter": Command("deflect fighter.su2 --config fighter.toml --no-report --out OUT.su2"),
    "tetrahedra": Command(f"deflect {TETS} --angle 10 --no-report --repair off --out OUT.su2"),
    "block": Command(f"deflect block.cgns {FLAP} --table block.npz --margin 0.45 --no-report --out OUT.cgns"),
}


@dataclass(frozen=True, slots=True)
class Version:
    """A checkout and a number of threads."""

    folder: Path
    threads: int

    def run(self, command: Command, meshes: Path, cache: Path) -> "Run":
        """Run a command in a folder of meshes.

        Raises RuntimeError if it ends with another code than 0, with the last line of what it said.
        """
        with tempfile.TemporaryDirectory(dir=meshes) as scratch:
            out = Path(scratch) / "out"
            first = ["-c"] if command.program else ["-m", "sdm_deflect"]
            words = [command.words] if command.program else shlex.split(command.words.replace("OUT", str(out)))
            folder = Path(scratch) / "cache" if command.cold else cache
            own = {
                "PYTHONPATH": str(self.folder),
                "SDM_DEFLECT_CACHE": str(folder),
                "NUMBA_NUM_THREADS": str(self.threads),
                "PYTHONDONTWRITEBYTECODE": "",  # as on a user's machine
            }
            with (Path(scratch) / "said").open("w+", encoding="utf-8") as said:
                process = subprocess.Popen(
                    [sys.executable, *first, *words], cwd=meshes, env=os.environ | own, stdout=said, stderr=said
                )
                spent = _watched(process)
                said.seek(0)
                if process.returncode:
                    last = " ".join(said.read().strip().splitlines()[-1:])
                    raise RuntimeError(f"{command.words} in {self.folder} ended with {process.returncode}: {last}")
            written = [path for path in Path(scratch).glob("out.*") if path.is_file()]
            content = b"".join(path.read_bytes() for path in sorted(written))
            digest = hashlib.sha256(content).hexdigest() if written else ""
            return Run(*spent, digest)


@dataclass(frozen=True, slots=True)
class Run:
    """Wall-clock and processor seconds of one run, its largest memory in bytes, and a digest of its mesh, if any."""

    seconds: float
    processor: float
    peak: float
    digest: str = field(repr=False)


def _watched(process: subprocess.Popen[bytes]) -> tuple[float, float, float]:
    """Wait for a process; return its wall-clock and processor seconds and its largest memory in bytes."""
    start, peak, done = perf_counter(), 0.0, 0
    while not done:
        peak = max(peak, _peak(process.pid))
        sleep(INTERVAL)
        done, status, usage = os.wait4(process.pid, os.WNOHANG)
    process.returncode = os.waitstatus_to_exitcode(status)
    return perf_counter() - start, usage.ru_utime + usage.ru_stime, peak


def _peak(process: int) -> float:
    """Return the largest memory of a process so far in bytes; 0 if it has ended.

    The system's `ru_maxrss` counts the memory of the process that started it, too.
    """
    try:
        lines = Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0.0
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith("VmHWM")), 0.0)


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


def make_meshes(folder: Path, words: str) -> None:
    """Write those meshes that are named in the words of commands and do not exist yet."""
    if "naca.su2" in words and not (folder / "naca.su2").exists():
        subprocess.run([sys.executable, "-m", "sdm_deflect", "example"], cwd=folder, check=True, capture_output=True)
    if "fighter.su2" in words and not (folder / "fighter.su2").exists():
        command = [sys.executable, "-m", "sdm_deflect", "example", "--fighter"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
    if "tets.su2" in words and not (folder / "tets.su2").exists():
        FORMATS["su2"].write(block_with_flap(BOXES), folder / "tets.su2")
    if "block.cgns" in words and not (folder / "block.cgns").exists():
        write_block(folder / "block.cgns", EDGE)


def large_blocks(
    folder: Path, sizes: Sequence[float], margin: float, formats: Sequence[str]
) -> Iterator[tuple[str, Command]]:
    """Write a block of hexahedra for each number of nodes and each format; yield the commands that deflect them."""
    for size in sizes:
        edge = round(size ** (1.0 / 3.0))
        for form in formats:
            mesh = f"block{edge}" + (".cgns" if form == "cgns" else "")
            if not (folder / mesh).exists():
                (write_block if form == "cgns" else write_case)(folder / mesh, edge)
            out = "OUT.cgns" if form == "cgns" else "OUT"
            table = f"--table block{edge}.npz --margin {margin:g}"
            yield (
                f"{edge**3:.2g} nodes, {form}",
                Command(f"deflect {mesh} {FLAP} {table} --no-report --repair off --out {out}"),
            )


def measured(
    commands: Mapping[str, Command], versions: Mapping[str, Version], rounds: int, folder: Path
) -> Iterator[Result]:
    """Run each command by all versions in turn, first once untimed; yield seconds, and ratios to the first version."""
    for name, command in commands.items():
        runs: dict[str, list[Run]] = {version: [] for version in versions}
        for turn in range(rounds + (not command.cold)):
            order = list(versions.items())
            for which, version in order if turn % 2 else reversed(order):
                runs[which].append(version.run(command, folder, folder / "cache"))
        kept = {which: some[not command.cold :] for which, some in runs.items()}
        first = next(iter(kept.values()))
        for which, some in kept.items():
            wall, processor = (median(getattr(run, part) for run in some) for part in ("seconds", "processor"))
            same = "" if some is first else f", the first takes {_ratio(first, some):.2f} times as long"
            equal = ", equal bytes" if _equal(first, some) else ", OTHER BYTES"
            equal = equal if some[0].digest else ""
            peak = max(run.peak for run in some) / 1e6
            note = f"processor {processor:.2f} s, {peak:.0f} MB{same}{equal}"
            yield Result(f"{name}, {which}" if len(versions) > 1 else name, wall, "s", rounds, note)


def _ratio(one: Sequence[Run], other: Sequence[Run]) -> float:
    """Return the median over the rounds of the first runs' seconds over the others'."""
    return median(a.seconds / b.seconds for a, b in zip(one, other, strict=True))


def _equal(one: Sequence[Run], other: Sequence[Run]) -> bool:
    return len({run.digest for run in (*one, *other)}) == 1


def _possible(name: str) -> bool:
    """Return whether a command's libraries are installed: the cases need the aircraft's CAD."""
    return not name.startswith("case") or find_spec("cadquery") is not None


def main() -> None:
    """Measure commands and print one table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.commands", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(COMMANDS)}; by default all that can run")
    parser.add_argument("--beside", type=Path, metavar="FOLDER", help="another checkout")
    parser.add_argument("--threads", type=int, nargs="+", default=[], help="numbers of threads; by default all")
    parser.add_argument("--size", type=float, nargs="+", default=[], help="nodes of blocks, such as 1e7, and no others")
    parser.add_argument("--formats", nargs="+", choices=("cgns", "openfoam"), default=["cgns", "openfoam"])
    parser.add_argument("--margin", type=float, default=0.17, help="of their boxes")
    parser.add_argument(
        "--command", nargs=2, action="append", default=[], metavar=("NAME", "WORDS"), help="another one"
    )
    parser.add_argument("--folder", type=Path, help="for meshes, which stay there")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=Path, metavar="FILE")
    given = parser.parse_args()
    if unknown := set(given.names) - set(COMMANDS):
        parser.error(f"no command {', '.join(sorted(unknown))}; there are {', '.join(COMMANDS)}")
    with tempfile.TemporaryDirectory() as scratch:
        folder = (given.folder or Path(scratch)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        own = {name: Command(words) for name, words in given.command}
        if given.size:
            own |= dict(large_blocks(folder, given.size, given.margin, given.formats))
        names = given.names or ([] if own else [name for name in COMMANDS if _possible(name)])
        commands = {name: COMMANDS[name] for name in names} | own
        make_meshes(folder, " ".join(command.words for command in commands.values()))
        checkouts = {"beside": given.beside.resolve(), "here": ROOT} if given.beside else {"": ROOT}
        cores = [len(os.sched_getaffinity(0))] if hasattr(os, "sched_getaffinity") else [os.cpu_count() or 1]
        versions = {
            f"{name} {count} {'thread' if count == 1 else 'threads'}".strip(): Version(checkout, count)
            for name, checkout in checkouts.items()
            for count in given.threads or cores
        }
        results = list(measured(commands, versions, given.rounds, folder))
    show(f"whole commands; {machine()}", results)
    if given.json is not None:
        write(given.json, results)


if __name__ == "__main__":
    main()
