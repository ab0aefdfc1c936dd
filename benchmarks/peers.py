"""Others' evaluations of the same kernel sum; each says why it cannot run where it cannot."""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from scipy.interpolate import RBFInterpolator

from benchmarks.measure import Action, FloatArray

C_SOURCE = """
#include <math.h>
#include <stddef.h>
void kernel_sum(const double *x, const double *y, const double *z, size_t n, const double *cx, const double *cy,
                const double *cz, const double *w, size_t m, double *out) {
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < n; i++) {
        double s = 0;
#pragma omp simd reduction(+ : s)
        for (size_t j = 0; j < m; j++) {
            double dx = x[i] - cx[j], dy = y[i] - cy[j], dz = z[i] - cz[j];
            double r2 = dx * dx + dy * dy + dz * dz + 1e-300;
            s += w[j] * r2 * log(r2);
        }
        out[i] = 0.5 * s;
    }
}
"""
C_FLAGS = ("-O3", "-march=native", "-ffast-math", "-fopenmp", "-fPIC", "-c")
# Without -ffast-math: linked in, it switches off subnormals at load.
LINK_FLAGS = ("-shared", "-fopenmp", "-lmvec", "-lm")
# Rows of NumPy's blocks: phi stays in the cache.
BLOCK = 256


@dataclass(frozen=True, slots=True, eq=False)
class Sum:
    """A thin plate spline sum: the arguments that all peers are given."""

    points: FloatArray  # (N, 3)
    centers: FloatArray  # (C, 3)
    beta: FloatArray  # (C, k)


class UnavailableError(RuntimeError):
    """A peer is not installed here."""


@cache
def compiled(code: str) -> ctypes.CDLL:
    """Compile C, with OpenMP and the system's vector functions."""
    gcc = shutil.which("gcc")
    if gcc is None:
        raise UnavailableError("no gcc")
    with tempfile.TemporaryDirectory() as folder:
        source, compiled, library = (str(Path(folder, f"kernel_sum{suffix}")) for suffix in (".c", ".o", ".so"))
        Path(source).write_text(code)
        for command in ([gcc, *C_FLAGS, source, "-o", compiled], [gcc, compiled, *LINK_FLAGS, "-o", library]):
            if subprocess.run(command, check=False, capture_output=True).returncode:
                raise UnavailableError("gcc failed")
        return ctypes.CDLL(library)


def c_one_direction(task: Sum) -> Action:
    """C with OpenMP and the vector logarithm, for the first direction alone."""
    function = compiled(C_SOURCE).kernel_sum
    x, c = np.ascontiguousarray(task.points.T), np.ascontiguousarray(task.centers.T)
    w, out = np.ascontiguousarray(task.beta[:, 0]), np.empty(len(task.points))

    def pointer(a: FloatArray) -> ctypes.c_void_p:
        return ctypes.c_void_p(a.ctypes.data)

    def run() -> FloatArray:
        arguments = [*map(pointer, x), ctypes.c_size_t(len(out)), *map(pointer, c), pointer(w)]
        function(*arguments, ctypes.c_size_t(len(w)), pointer(out))
        return out

    return run


def numpy_blocks(task: Sum) -> Action:
    """NumPy in blocks that fit the cache, all directions."""

    def run() -> FloatArray:
        out = np.empty((len(task.points), task.beta.shape[1]))
        for i in range(0, len(out), BLOCK):
            part = task.points[i : i + BLOCK]
            r2 = np.full((len(part), len(task.centers)), 1e-300)
            for axis in range(3):
                r2 += (part[:, axis, None] - task.centers[:, axis]) ** 2
            out[i : i + BLOCK] = (0.5 * r2 * np.log(r2)) @ task.beta
        return out

    return run


def scipy_interpolator(task: Sum) -> Action:
    """SciPy's RBFInterpolator, all directions; its fit is not part of the time."""
    interpolator = RBFInterpolator(task.centers, task.beta, kernel="thin_plate_spline", degree=1)
    return lambda: interpolator(task.points)


def treverhines(task: Sum) -> Action:
    """The package treverhines-rbf, one direction; its fit is not part of the time."""
    if find_spec("rbf") is None:
        raise UnavailableError("treverhines-rbf is not installed")
    interpolant = import_module("rbf.interpolate").RBFInterpolant(task.centers, task.beta[:, 0], phi="phs2", order=1)
    return lambda: interpolant(task.points)


def keops(task: Sum) -> Action:
    """KeOps on the CPU, all directions; its compilation is not part of the time."""
    if find_spec("pykeops") is None:
        raise UnavailableError("pykeops is not installed")
    lazy = import_module("pykeops.numpy").LazyTensor

    def run() -> FloatArray:
        x, c = lazy(task.points[:, None, :]), lazy(task.centers[None, :, :])
        r2 = ((x - c) ** 2).sum(-1) + 1e-300
        return np.asarray((0.5 * r2 * r2.log()) @ task.beta)

    return run


MAIN_PEERS = ("C, one direction", "SciPy RBFInterpolator")
PEERS: dict[str, Callable[[Sum], Action]] = {
    "C, one direction": c_one_direction,
    "NumPy in blocks": numpy_blocks,
    "SciPy RBFInterpolator": scipy_interpolator,
    "treverhines-rbf, one direction": treverhines,
    "KeOps": keops,
}


def available(task: Sum, names: Iterable[str]) -> tuple[dict[str, Action], dict[str, str]]:
    """Return the named peers that run here, and why the others do not."""
    actions, missing = {}, {}
    for name in names:
        build = PEERS[name]
        try:
            actions[name] = build(task)
        except UnavailableError as reason:
            missing[name] = str(reason)
    return actions, missing
