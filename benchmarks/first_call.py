"""What compilation costs: the first evaluation in a new process, with and without machine code on disk."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator

from benchmarks.results import Result

PROGRAM = """
from time import perf_counter
start = perf_counter()
import numpy as np
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
imported = perf_counter()
x = np.zeros((5, 3))
Interpolant(ThinPlateSpline(), x, np.zeros((5, 3)), np.zeros((4, 3)))(x)
print(imported - start, perf_counter() - imported)
"""


def first_call() -> Iterator[Result]:
    """Yield seconds of import and first evaluation."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder}
        for name, note in (("first_call_compiled", "no machine code on disk"), ("first_call_cached", "from disk")):
            command = [sys.executable, "-c", PROGRAM]
            done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
            imported, called = map(float, done.stdout.split())
            yield Result(name, called, "s", 1, f"{note}; import {imported:.2f} s")
