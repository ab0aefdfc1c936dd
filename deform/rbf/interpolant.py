"""Fit and evaluation of s(p) = alpha . [1, p] + sum_j beta_j phi(|p - c_j|) (paper eqs. 2 to 7)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.linalg.lapack import dsysv

from sdm_deflect.base.arrays import FloatArray, first_coincident
from sdm_deflect.base.threads import Progress, silent, single_threaded_blas

from .fitting import Polynomial, Processor
from .kernels import Kernel, kernel_matrix, kernel_sum

# An extent below this share of the largest one counts as zero.
FLAT = 1e-9
# Maps a symmetric matrix (n, n) and right-hand sides (n, k) to solutions (n, k).
Solve = Callable[[FloatArray, FloatArray], FloatArray]
# Block size of the factorisation; without work space for it LAPACK uses a method five times as slow.
BLOCK = 64


@dataclass(frozen=True, slots=True, eq=False)
class UnitBox:
    """Shift and scale that bring points into the box [-1, 1]**3, with the polynomials there.

    The interpolant does not depend on them, but the condition number does: in metres, r**2 log r and the polynomial
    differ by orders of magnitude.
    """

    origin: FloatArray  # (3,) m
    length: float  # m
    axes: FloatArray  # (., 3) orthonormal directions in which the points extend and the polynomial has a slope
    constant: bool = True  # whether the polynomial has a constant

    @classmethod
    def around(cls, points: FloatArray, polynomial: Polynomial = "linear", thin: float = FLAT) -> Self:
        """Return the box of points (N, 3); points in a plane or on a line give fewer than three axes.

        They are so if their extent across it is below the share `thin` of the largest.
        """
        low, high = points.min(axis=0), points.max(axis=0)
        origin = 0.5 * (low + high)
        length = float(0.5 * (high - low).max()) or 1.0
        scaled = (points - origin) / length
        centered = scaled - scaled.mean(axis=0)
        spread, axes = np.linalg.svd(centered, full_matrices=False)[1:]
        extended = spread > thin * max(spread[0], thin)
        slopes = np.eye(3) if extended.sum() == 3 else axes[extended]
        return cls(origin, length, slopes if polynomial == "linear" else slopes[:0], polynomial != "none")

    def scaled(self, points: FloatArray) -> FloatArray:
        """Return points (N, 3) in the coordinates of the box."""
        return np.asarray((points - self.origin) / self.length)

    def polynomials(self, scaled: FloatArray) -> FloatArray:
        """Return [1, coordinates along the axes] at scaled points (N, 3): the matrix Q (N, q) of eq. 6."""
        return np.column_stack([np.ones((len(scaled), int(self.constant))), scaled @ self.axes.T])

    def complete(self, alpha: FloatArray) -> FloatArray:
        """Convert coefficients (q, k) of these polynomials to those (4, k) of 1 and the scaled coordinates."""
        slopes = self.axes.T @ alpha[int(self.constant) :]
        return np.vstack([alpha[:1] if self.constant else np.zeros((1, alpha.shape[1])), slopes])

    def in_metres(
        self, kernel: Kernel, centers: FloatArray, alpha: FloatArray, beta: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Convert coefficients for scaled coordinates to coefficients for metres.

        Parameters
        ----------
        kernel : The kernel in metres.
        centers : (C, 3) scaled centres.
        alpha, beta : (4, k) and (C, k) coefficients for `kernel.rescaled(length).kernel`.

        Returns
        -------
        alpha (4, k), beta (C, k)

        Notes
        -----
        phi(length rho) = factor phi'(rho) + square rho**2. By the side conditions (eq. 4) the sum of
        beta_j |y - c_j|**2 over j is the constant sum of beta_j |c_j|**2, which is added to alpha.
        """
        _, factor, square = kernel.rescaled(self.length)
        metres = beta / factor
        slope = alpha[1:] / self.length
        constant = alpha[0] - self.origin @ slope - square * (np.sum(centers**2, axis=1) @ metres)
        return np.vstack([constant, slope]), metres


class SolveError(RuntimeError):
    """The interpolation system cannot be solved."""


@dataclass(frozen=True, slots=True, eq=False)
class Interpolant:
    """A fitted map from points (M, 3) in metres to values (M, k); `processor` evaluates it."""

    kernel: Kernel
    centers: FloatArray  # (C, 3) m
    beta: FloatArray  # (C, k) kernel coefficients
    alpha: FloatArray  # (4, k) coefficients of 1, x, y, z
    processor: Processor = "cpu"

    def __post_init__(self) -> None:
        count, columns = self.beta.shape
        if self.centers.shape != (count, 3) or self.alpha.shape != (4, columns):
            raise ValueError(
                f"centers {self.centers.shape}, beta {self.beta.shape} and alpha {self.alpha.shape} "
                "must be (C, 3), (C, k) and (4, k)"
            )

    def __call__(self, points: FloatArray, *, threads: int | None = None, progress: Progress = silent) -> FloatArray:
        """Evaluate at points (M, 3) without forming the matrix of eq. 7."""
        terms = self.kernel, points, self.centers, self.beta, self.alpha
        if self.processor == "gpu":
            from .gpu import sum_on_card

            return sum_on_card(*terms, progress)
        return kernel_sum(*terms, threads=threads, progress=progress)


def direct(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve with LAPACK's factorisation of a symmetric indefinite matrix."""
    _, _, solution, info = dsysv(matrix, right, lower=1, lwork=len(matrix) * BLOCK)
    if info != 0:
        raise SolveError(
            f"the system of {len(matrix)} unknowns is singular: are centres closer than the coordinates resolve?"
        )
    return np.asarray(solution)


def fit(
    kernel: Kernel, centers: FloatArray, values: FloatArray, solve: Solve = direct, thin: float = FLAT
) -> Interpolant:
    """Interpolate values (C, k) at centers (C, 3) (eqs. 5 and 6).

    Centres may lie in a plane or on a line, to the share `thin` of their extent; the polynomial then has no slope
    across it.

    Raises
    ------
    ValueError
        If shapes differ, a number is not finite, or centres coincide.
    SolveError
        If the system is singular to rounding error, or `solve` fails.
    """
    check_finite(centers=centers, values=values)
    if centers.ndim != 2 or values.ndim != 2 or centers.shape != (len(values), 3) or not len(values):
        raise ValueError(f"centers {centers.shape} and values {values.shape} must be (C, 3) and (C, k)")
    twice = np.flatnonzero(first_coincident(centers) != np.arange(len(centers)))
    if len(twice):
        raise ValueError(f"{len(twice)} centers coincide with another, such as row {twice[0]}: {centers[twice[0]]}")
    with single_threaded_blas():
        box = UnitBox.around(centers, thin=thin)
        scaled = box.scaled(centers)
        matrix = coefficient_matrix(box.polynomials(scaled), kernel.rescaled(box.length).kernel, scaled)
        q = len(matrix) - len(values)
        solution = solve(matrix, np.vstack([np.zeros((q, values.shape[1])), values]))
        alpha, beta = box.in_metres(kernel, scaled, box.complete(solution[:q]), solution[q:])
    return Interpolant(kernel, np.array(centers, dtype=np.float64), beta, alpha)


def check_finite(**arrays: FloatArray) -> None:
    """Raise a ValueError for the first array with a number that is not finite."""
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            row = int(np.flatnonzero(~np.isfinite(array).reshape(len(array), -1).all(axis=1))[0])
            raise ValueError(f"{name} has a number that is not finite in row {row}: {array[row]}")


def coefficient_matrix(q: FloatArray, kernel: Kernel, points: FloatArray) -> FloatArray:
    """Return the matrix A of eq. 6."""
    zero = np.zeros((q.shape[1], q.shape[1]))
    return np.block([[zero, q.T], [q, kernel_matrix(kernel, points, points)]])
