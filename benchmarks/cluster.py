"""Workers of Dask on this machine: what the sums gain by a second one, kills, and little memory.

``python -m benchmarks.cluster sums`` : a kernel sum as of an unconfined deflection, by one worker and by two in turn.
``python -m benchmarks.cluster kills --edge 120 --kills 10`` : as many runs, in each of which a worker is killed.
``python -m benchmarks.cluster memory --edge 464 --memory 1.5GB`` : one run by two workers; 464 are 1e8 nodes, 14 GB of
disk in ``--folder`` for the mesh and its copy. The largest memory of every process is written beside its limit.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from filecmp import cmp
from pathlib import Path

import numpy as np

from benchmarks.large_block import write_block
from benchmarks.measure import side_by_side
from sdm_deflect.cases.run.cluster import workers
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.volume.step import evaluate

OPTIONS = ("--surface", "flap", "--fixed", "wall", "--margin", "0.17", "--no-report", "--repair", "off")
WARM = 500_000


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.cluster", description=__doc__)
    parser.add_argument("what", choices=("sums", "kills", "memory"))
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()), help="for meshes, which stay there")
    parser.add_argument("--edge", type=int, default=120, help="nodes along an edge of the block")
    parser.add_argument("--points", type=float, default=1e7)
    parser.add_argument("--centers", type=int, default=2_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--memory", default="1.5GB", help="limit of each worker")
    given = parser.parse_args()
    if given.what == "sums":
        sums(int(given.points), given.centers, given.rounds)
    elif given.what == "kills":
        kills(_block(given.folder, given.edge), given.kills)
    else:
        memory(_block(given.folder, given.edge), given.memory)


def sums(count: int, centers: int, rounds: int) -> None:
    """Let one worker and two evaluate the same sums in turn."""
    rng = np.random.default_rng(0)
    beta = rng.normal(size=(centers, 3))
    interpolant = Interpolant(ThinPlateSpline(), rng.random((centers, 3)), beta, np.zeros((4, 3)))
    points, here = rng.random((count, 3)), Path.cwd()
    with ExitStack() as stack:
        one, two = (stack.enter_context(workers(Stopwatch(), here, here, count=number)) for number in (1, 2))
        for runner in (one, two):
            same = np.array_equal(evaluate(interpolant, points[:WARM], runner), interpolant(points[:WARM]))
            print(f"same bits as without workers: {same}")
        actions = {
            "one": lambda: evaluate(interpolant, points, one),
            "two": lambda: evaluate(interpolant, points, two),
            "one thread": lambda: interpolant(points, threads=1),
            "two threads": lambda: interpolant(points, threads=2),
        }
        times = side_by_side(actions, rounds)
    for name in actions:
        print(f"{name:12} {times.median(name):8.2f} s  (least {times.of(name).min():.2f} s)")
    for first, second, what in (("one", "two", "worker"), ("one thread", "two threads", "thread")):
        best = times.of(first).min() / times.of(second).min()
        print(f"one {what}'s time over two's: {times.ratio(first, second):.2f} (median), {best:.2f} (least of each)")


def kills(source: Path, count: int) -> None:
    """Kill a worker at a random moment of each run, and compare the bytes with those of an undisturbed one."""
    whole, out = source.with_name("whole.cgns"), source.with_name("killed.cgns")
    start = time.perf_counter()
    with _started(source, whole, "--workers", "2") as process:
        process.wait()
    seconds = time.perf_counter() - start
    done = 0
    while done < count:
        out.unlink(missing_ok=True)
        with _started(source, out, "--workers", "2") as process:
            found: list[int] = []
            while len(found) < 2 and process.poll() is None:
                time.sleep(0.05)
                found = _workers(process.pid)
            time.sleep(random.uniform(0.0, 0.8 * seconds))
            found = _workers(process.pid)
            if found and process.poll() is None:
                done += 1
                os.kill(random.choice(found), signal.SIGKILL)
            else:
                found = []
            code = process.wait()
        if found:
            print(f"{done:3}: code {code}, same bytes {out.exists() and cmp(whole, out, shallow=False)}", flush=True)


def memory(source: Path, limit: str) -> None:
    """Deflect by two workers of so much memory; print the seconds, and the largest memory of each process."""
    out, most, start = source.with_name("limited.cgns"), dict[int, int](), time.perf_counter()
    with _started(source, out, "--workers", "2", "--worker-memory", limit) as process:
        while process.poll() is None:
            helpers = _workers(process.pid)
            for one in (*helpers, *_below(process.pid)):
                most[one] = max(most.get(one, 0), _peak(one))
            time.sleep(0.2)
    print(f"code {process.returncode}, {time.perf_counter() - start:.1f} s, limit of a worker {limit}")
    for one, peak in most.items():
        print(f"process {one}: {peak / 1e9:.2f} GB")
    print("more processes than two workers, one command and their watchers mean that workers were killed")


def _block(folder: Path, edge: int) -> Path:
    """Return a block with so many nodes along an edge, written if it is not there."""
    path = folder / f"block{edge}.cgns"
    if not path.with_suffix(".npz").exists():
        write_block(path, edge)
    return path


def _started(source: Path, out: Path, *more: str) -> "subprocess.Popen[bytes]":
    words = ["deflect", source, *OPTIONS, "--table", source.with_suffix(".npz"), "--out", out, *more]
    command = [sys.executable, "-m", "sdm_deflect", *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def _workers(process: int) -> list[int]:
    """Return the processes below one that were spawned as workers."""
    found = []
    for own in _below(process):
        with suppress(OSError):
            if b"spawn_main" in Path(f"/proc/{own}/cmdline").read_bytes():
                found.append(own)
    return found


def _below(process: int) -> Iterator[int]:
    with suppress(OSError):
        for task in Path(f"/proc/{process}/task").iterdir():
            for own in map(int, (task / "children").read_text().split()):
                yield own
                yield from _below(own)


def _peak(process: int) -> int:
    """Return the largest memory of a process so far, in bytes."""
    with suppress(OSError, StopIteration):
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
        return 1024 * int(next(line.split()[1] for line in lines if line.startswith("VmHWM")))
    return 0


if __name__ == "__main__":
    main()
