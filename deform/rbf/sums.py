"""Kernel sums and matrices, compiled (paper eqs. 6 and 7)."""

from typing import Any

import numpy as np
from numba.cpython.unsafe.tuple import tuple_setitem

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.compiled import compiled, for_code, prefer_wide_vectors
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.base.threads import in_chunks
from sdm_deflect.deform.rbf.kernels import Kernel, phi

WIDTHS = (1, 3, 8)  # columns of one pass: one machine code for each, the narrowest that fits is taken
PADDING = 32  # centres are filled up to a multiple of this with weight zero: whole vectors, no remainder loop
BLOCK = 8_192  # centres summed over before the next: as many as a core's own cache holds with their weights


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
    """Return alpha . [1, p] + sum_j beta_j phi(|p - c_j|), (N, k), for all columns at once.

    Parameters
    ----------
    kernel : The radial function, in the units of the coordinates.
    points : (N, 3) where to evaluate.
    centers, beta, alpha : (C, 3), (C, k) and (4, k): centres, kernel and polynomial coefficients.
    threads : Number of threads; by default all that Numba may use. The result does not depend on it.
    """
    check_points(points=points, centers=centers)
    x = np.ascontiguousarray(points, dtype=np.float64)
    out = np.zeros((len(x), beta.shape[1]))
    code, b = kernel.compiled(), kernel.unit * beta.T
    sum_rows = for_code(_sum_rows, code)
    cuts = [slice(j, j + BLOCK) for j in range(0, max(1, len(centers)), BLOCK)]
    blocks = [_padded(centers[cut].T) for cut in cuts]

    def pass_over(part: slice) -> None:
        width = next(w for w in WIDTHS if w >= min(beta.shape[1] - part.start, WIDTHS[-1]))
        weights = [_padded(b[part, cut], width) for cut in cuts]
        a = np.ascontiguousarray(alpha[:, part].T)
        polynomials = [a, *(np.zeros_like(a) for _ in cuts[1:])]

        def chunk(low: int, high: int) -> None:
            for c, w, a in zip(blocks, weights, polynomials, strict=True):
                sum_rows(code, x[low:high], c, w, (0.0,) * width, a, out[low:high, part])

        in_chunks(chunk, len(x), len(centers), threads, progress)

    for k in range(0, beta.shape[1], WIDTHS[-1]):
        pass_over(slice(k, k + WIDTHS[-1]))
    return out


def kernel_matrix(kernel: Kernel, a: FloatArray, b: FloatArray) -> FloatArray:
    """Return phi(|a_i - b_j|) as (M, N) for a (M, 3) and b (N, 3)."""
    check_points(a=a, b=b)
    out = np.empty((len(a), len(b)))
    x, y = np.ascontiguousarray(a), np.ascontiguousarray(b.T)
    code, unit = kernel.compiled(), kernel.unit
    matrix_rows = for_code(_matrix_rows, code)

    def chunk(low: int, high: int) -> None:
        matrix_rows(code, unit, x[low:high], y, out[low:high])

    in_chunks(chunk, len(a), len(b))
    return out


def check_points(**arrays: FloatArray) -> None:
    """Raise a ValueError that names the first array that is not (N, 3): compiled loops do not look."""
    for name, array in arrays.items():
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"{name} {array.shape} must be (N, 3)")


def _padded(rows: FloatArray, count: int = 3) -> FloatArray:
    """Fill rows (k, C) with zeros up to `count` rows and a multiple of `PADDING` columns."""
    out = np.zeros((count, -(-rows.shape[1] // PADDING) * PADDING))
    out[: len(rows), : rows.shape[1]] = rows
    return out


@compiled
def _sum_rows(
    code: Any, x: FloatArray, c: FloatArray, b: FloatArray, zeros: tuple[float, ...], a: FloatArray, out: FloatArray
) -> None:  # pragma: no cover - machine code
    """Sum at x (N, 3) over centres c (3, C) with weights b (w, C) and add it, and polynomials a (k, 4), to out (N, k).

    The w sums of a point are kept in a tuple, which LLVM keeps in registers; it interleaves the loop over the centres
    by itself.
    """
    prefer_wide_vectors()
    for i in range(len(x)):
        x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
        s = zeros
        for j in range(c.shape[1]):
            d0, d1, d2 = x0 - c[0, j], x1 - c[1, j], x2 - c[2, j]
            p = phi(code, d0 * d0 + d1 * d1 + d2 * d2)
            for k in range(len(zeros)):
                s = tuple_setitem(s, k, s[k] + b[k, j] * p)
        for k in range(len(a)):
            out[i, k] += s[k] + (a[k, 0] + a[k, 1] * x0 + a[k, 2] * x1 + a[k, 3] * x2)


@compiled
def _matrix_rows(
    code: Any, unit: float, x: FloatArray, y: FloatArray, out: FloatArray
) -> None:  # pragma: no cover - machine code
    """Write phi between x (M, 3) and y (3, N) to out (M, N)."""
    prefer_wide_vectors()
    for i in range(len(x)):
        x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
        for j in range(y.shape[1]):
            d0, d1, d2 = x0 - y[0, j], x1 - y[1, j], x2 - y[2, j]
            out[i, j] = unit * phi(code, d0 * d0 + d1 * d1 + d2 * d2)
