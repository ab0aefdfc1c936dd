"""Coordinates in which the interpolation systems are well conditioned."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from sdm_deflect.deform.kernels import FloatArray, Kernel

FLAT = 1e-9  # an extent below this share of the largest counts as none


@dataclass(frozen=True, slots=True, eq=False)
class UnitBox:
    """A shift and a scale that bring points into the box [-1, 1]**3, and the polynomials on them.

    The interpolant does not depend on either, but the condition of its system does: with r in metres, r**2
    log r and the polynomial differ by orders of magnitude.
    """

    origin: FloatArray  # (3,) m
    length: float  # m
    axes: FloatArray  # (q - 1, 3) orthonormal: the directions in which the points extend

    @classmethod
    def around(cls, points: FloatArray) -> Self:
        """Fit the box to points (N, 3); points of a plane or a line give fewer than three axes."""
        low, high = points.min(axis=0), points.max(axis=0)
        origin = 0.5 * (low + high)
        length = float(0.5 * (high - low).max()) or 1.0
        scaled = (points - origin) / length
        centered = scaled - scaled.mean(axis=0)
        spread, axes = np.linalg.svd(centered, full_matrices=False)[1:]
        extended = spread > FLAT * max(spread[0], FLAT)
        return cls(origin, length, np.eye(3) if extended.sum() == 3 else axes[extended])

    def scaled(self, points: FloatArray) -> FloatArray:
        """Return points (N, 3) in units of the box."""
        return np.asarray((points - self.origin) / self.length)

    def polynomials(self, scaled: FloatArray) -> FloatArray:
        """Return [1, coordinates along the axes] at scaled points (N, 3): the matrix Q (N, q) of eq. 6."""
        return np.column_stack([np.ones(len(scaled)), scaled @ self.axes.T])

    def complete(self, alpha: FloatArray) -> FloatArray:
        """Turn coefficients (q, k) of these polynomials into those (4, k) of 1 and the scaled coordinates."""
        return np.vstack([alpha[:1], self.axes.T @ alpha[1:]])

    def in_metres(
        self, kernel: Kernel, centers: FloatArray, alpha: FloatArray, beta: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Turn coefficients for scaled coordinates into those for metres.

        Parameters
        ----------
        kernel
            The kernel in metres.
        centers
            (C, 3) scaled centres.
        alpha, beta
            (4, k) and (C, k) coefficients for `kernel.rescaled(length).kernel`.

        Returns
        -------
        alpha (4, k), beta (C, k)

        Notes
        -----
        phi(length rho) = factor phi'(rho) + square rho**2. By the side conditions (eq. 4) the sum of
        beta_j |y - c_j|**2 over j is the constant sum of beta_j |c_j|**2, which moves into alpha.
        """
        _, factor, square = kernel.rescaled(self.length)
        metres = beta / factor
        slope = alpha[1:] / self.length
        constant = alpha[0] - self.origin @ slope - square * (np.sum(centers**2, axis=1) @ metres)
        return np.vstack([constant, slope]), metres
