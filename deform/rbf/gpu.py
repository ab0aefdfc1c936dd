"""The kernel sum on a CUDA card, which numba-cuda compiles from the formulas of the kernels."""

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
from numba import config, cuda, float64
from numba.core.errors import NumbaError

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import Progress, silent

from .kernels import Kernel

# Threads in a block, and centres that it holds in shared memory at a time: 12 kB with their weights.
TILE = 256
# Columns that one pass sums.
WIDTH = 3
# Points on the card at a time: 0.8 GB with their sums.
POINTS = 1 << 24


def check_card() -> None:
    """Raise InputError if this machine has no CUDA card, or no compiler for it."""
    if config.ENABLE_CUDASIM:
        return
    if find_spec("numba_cuda") is None:
        raise InputError("processor = gpu needs numba-cuda: in your clone, pip install '.[gpu]'")
    try:
        from numba.cuda.np import arrayobj  # noqa: F401 - fails if NumPy is too new for numba-cuda
    except ImportError as error:
        raise InputError(f"processor = gpu: numba-cuda cannot be loaded ({error}); pip install '.[gpu]'") from error
    if not cuda.is_available():
        raise InputError("processor = gpu: there is no CUDA card, or no driver; use processor = cpu")


def sum_on_card(
    kernel: Kernel, points: FloatArray, centers: FloatArray, beta: FloatArray, alpha: FloatArray,
    progress: Progress = silent,
) -> FloatArray:  # fmt: skip
    """Return what `kernel_sum` returns, (N, k); the last digits differ, because sums have another order."""
    check_card()
    out = np.empty((len(points), beta.shape[1]))
    loop = _loop(kernel.formula, kernel.code())
    c = cuda.to_device(np.ascontiguousarray(centers, dtype=np.float64))
    for column in range(0, beta.shape[1], WIDTH):
        part = slice(column, column + WIDTH)
        missing = (0, 0), (0, WIDTH - out[:, part].shape[1])
        b, a = (cuda.to_device(np.pad(rows[:, part], missing)) for rows in (kernel.unit * beta, alpha))
        for start in range(0, len(points), POINTS):
            x = cuda.to_device(np.ascontiguousarray(points[start : start + POINTS], dtype=np.float64))
            sums = cuda.device_array((len(x), WIDTH))
            try:
                loop[-(-len(x) // TILE), TILE](x, c, b, a, sums)
            except NumbaError as error:
                text = f"processor = gpu: {type(kernel).__name__}.formula does not compile; use math in place of NumPy"
                raise InputError(text) from error
            out[start : start + POINTS, part] = sums.copy_to_host()[:, : out[:, part].shape[1]]
            progress("kernel sums", (start + len(x)) / len(points))
    return out


@cache
def _loop(formula: Callable[[Any, Any], Any], code: Any) -> Any:
    """Compile the sum for a kernel's formula and numbers; each thread sums over a tile's centres for one point."""
    phi = cuda.jit(device=True, fastmath=True)(formula)

    def loop(x: Any, c: Any, b: Any, a: Any, out: Any) -> None:  # pragma: no cover - machine code
        tile, i, t = cuda.shared.array((TILE, 6), float64), cuda.grid(1), cuda.threadIdx.x
        row, s0, s1, s2 = min(i, len(x) - 1), 0.0, 0.0, 0.0
        x0, x1, x2 = x[row, 0], x[row, 1], x[row, 2]
        for first in range(0, len(c), TILE):
            if first + t < len(c):
                for k in range(3):
                    tile[t, k], tile[t, 3 + k] = c[first + t, k], b[first + t, k]
            cuda.syncthreads()
            for j in range(min(TILE, len(c) - first)):
                d0, d1, d2 = x0 - tile[j, 0], x1 - tile[j, 1], x2 - tile[j, 2]
                p = phi(code, d0 * d0 + d1 * d1 + d2 * d2)
                s0, s1, s2 = s0 + tile[j, 3] * p, s1 + tile[j, 4] * p, s2 + tile[j, 5] * p
            cuda.syncthreads()
        if i < len(x):
            sums = s0, s1, s2
            for k in range(3):
                out[i, k] = sums[k] + (a[0, k] + a[1, k] * x0 + a[2, k] * x1 + a[3, k] * x2)

    return cuda.jit(fastmath=True)(loop)
