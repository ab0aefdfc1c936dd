"""Compiled kernel sums and kernel matrices: the inner loop of everything (paper eq. 7).

The logarithm is the cost of a (point, centre) pair, so it is taken once and used for all columns. A point's
value depends on nothing but that point: it has the same bits whatever the number of threads.
"""

from typing import Any

import numpy as np

from deform.compiled import compiled
from deform.kernels import FloatArray, Kernel, phi
from deform.progress import Progress, silent
from deform.threads import in_chunks

COLUMNS = 4  # columns that share one pass; missing ones are filled with zeros, which cost next to nothing
PADDING = 32  # centres are filled up to a multiple of this with weight zero: whole vectors, no remainder loop


def kernel_sum(
    kernel: Kernel,
    points: FloatArray,
    centers: FloatArray,
    beta: FloatArray,
    alpha: FloatArray,
    *,
    threads: int | None = None,
    progress: Progress = silent,
) -> FloatArray:
    """Evaluate alpha . [1, p] + sum_j beta_j phi(|p - c_j|) for all columns at once.

    Parameters
    ----------
    kernel
        The radial function, in the units of the coordinates.
    points
        (N, 3) where to evaluate.
    centers, beta, alpha
        (C, 3), (C, k) and (4, k): centres, kernel and polynomial coefficients.
    threads
        Number of threads; by default all that Numba may use. The result does not depend on it.

    Returns
    -------
    (N, k) values.
    """
    x = np.ascontiguousarray(points, dtype=np.float64)
    out = np.empty((len(x), beta.shape[1]))
    code = kernel.compiled()
    c = _padded(centers.T, 3)

    def pass_over(part: slice) -> None:
        b, a = _padded(beta[:, part].T, COLUMNS), np.ascontiguousarray(alpha[:, part].T)

        def chunk(low: int, high: int) -> None:
            _sum_rows(code, x[low:high], c, b, a, out[low:high, part])

        in_chunks(chunk, len(x), c.shape[1], threads, progress)

    for k in range(0, beta.shape[1], COLUMNS):
        pass_over(slice(k, k + COLUMNS))
    return out


def kernel_matrix(kernel: Kernel, a: FloatArray, b: FloatArray) -> FloatArray:
    """Return phi(|a_i - b_j|) as (M, N) for a (M, 3) and b (N, 3)."""
    out = np.empty((len(a), len(b)))
    x, y = np.ascontiguousarray(a), np.ascontiguousarray(b.T)
    code = kernel.compiled()

    def chunk(low: int, high: int) -> None:
        _matrix_rows(code, x[low:high], y, out[low:high])

    in_chunks(chunk, len(a), len(b))
    return out


def _padded(rows: FloatArray, count: int) -> FloatArray:
    """Fill rows (k, C) with zeros up to `count` rows and a multiple of `PADDING` columns."""
    out = np.zeros((count, -(-rows.shape[1] // PADDING) * PADDING))
    out[: len(rows), : rows.shape[1]] = rows
    return out


@compiled
def _sum_rows(
    code: Any, x: FloatArray, c: FloatArray, b: FloatArray, a: FloatArray, out: FloatArray
) -> None:  # pragma: no cover - machine code
    """Sum at x (N, 3) over centres c (3, C) with weights b (4, C), add polynomials a (k, 4): out (N, k)."""
    for i in range(len(x)):
        x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
        s0 = s1 = s2 = s3 = 0.0
        for j in range(c.shape[1]):
            d0, d1, d2 = x0 - c[0, j], x1 - c[1, j], x2 - c[2, j]
            p = phi(code, d0 * d0 + d1 * d1 + d2 * d2)
            s0 += b[0, j] * p
            s1 += b[1, j] * p
            s2 += b[2, j] * p
            s3 += b[3, j] * p
        s = (s0, s1, s2, s3)
        for k in range(len(a)):
            out[i, k] = s[k] + (a[k, 0] + a[k, 1] * x0 + a[k, 2] * x1 + a[k, 3] * x2)


@compiled
def _matrix_rows(code: Any, x: FloatArray, y: FloatArray, out: FloatArray) -> None:  # pragma: no cover - machine code
    """Write phi between x (M, 3) and y (3, N) to out (M, N)."""
    for i in range(len(x)):
        x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
        for j in range(y.shape[1]):
            d0, d1, d2 = x0 - y[0, j], x1 - y[1, j], x2 - y[2, j]
            out[i, j] = phi(code, d0 * d0 + d1 * d1 + d2 * d2)
