"""Peak memory, each in a process of its own."""

import json
import resource
import subprocess
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline

DIRECTIONS = 3
RESET = Path("/proc/self/clear_refs")
# Bytes in the unit of ru_maxrss.
UNIT = 1024 if sys.platform.startswith("linux") else 1


def peak_above_arrays(points: int, centers: int) -> float:
    """Return the bytes that an evaluation needs beside its points and its result."""
    return _measured(points, centers)["above"]


def seconds_and_peak(points: int, centers: int) -> tuple[float, float]:
    """Return the seconds of an evaluation and the peak memory of its process in bytes."""
    found = _measured(points, centers)
    return found["seconds"], found["peak"]


def _measured(points: int, centers: int) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.memory", str(points), str(centers)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def reset_peak() -> None:
    """Let the peak start from the memory in use, where the system can (Linux)."""
    if RESET.exists():
        RESET.write_text("5", encoding="ascii")


def peak() -> float:
    """Return the largest memory in use since the start or the last reset, in bytes."""
    if RESET.exists():
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * UNIT


def main(points: int, centers: int) -> dict[str, float]:
    """Evaluate once and measure this process."""
    rng = np.random.default_rng(0)
    c, beta = rng.random((centers, 3)), rng.normal(size=(centers, DIRECTIONS))
    s = Interpolant(ThinPlateSpline(), c, beta, np.zeros((4, DIRECTIONS)))
    s(rng.random((50_000, 3)))  # loads the machine code and starts the threads
    x = np.empty((points, 3))
    for axis in range(3):
        x[:, axis] = np.linspace(0.0, 1.0 + axis, points)
    reset_peak()
    before, start = peak(), perf_counter()
    values = s(x)
    seconds = perf_counter() - start
    return {"seconds": seconds, "peak": peak(), "above": max(0.0, peak() - before - values.nbytes)}


if __name__ == "__main__":
    print(json.dumps(main(int(sys.argv[1]), int(sys.argv[2]))))
