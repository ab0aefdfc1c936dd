"""One adaptation problem in well-conditioned coordinates: what every solver of it shares."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from deform.duplicates import IndexArray
from deform.interpolant import Interpolant
from deform.kernels import FloatArray, Kernel
from deform.sites import DataSites
from deform.sums import kernel_sum
from deform.unitbox import UnitBox


class Coefficients(NamedTuple):
    """Coefficients for the scaled coordinates of a `Problem`, one row of beta for each chosen site."""

    alpha: FloatArray  # (q, k)
    beta: FloatArray  # (C, k)


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Data sites in the unit box, with the kernel and the polynomials that belong to it."""

    sites: DataSites
    kernel: Kernel  # in metres
    box: UnitBox
    points: FloatArray  # (N, 3) scaled
    polynomials: FloatArray  # (N, q)
    scaled_kernel: Kernel

    @classmethod
    def of(cls, sites: DataSites, kernel: Kernel) -> Self:
        """Scale `sites`."""
        box = UnitBox.around(sites.points)
        points = box.scaled(sites.points)
        return cls(sites, kernel, box, points, box.polynomials(points), kernel.rescaled(box.length).kernel)

    @property
    def values(self) -> FloatArray:
        """Displacements (N, k) at the sites."""
        return self.sites.values

    def errors(
        self, chosen: IndexArray, coefficients: Coefficients, rows: IndexArray | slice = slice(None)
    ) -> FloatArray:
        """Return interpolant minus value at the given rows of the sites, (R, k)."""
        alpha = np.vstack([coefficients.alpha[:1], self.box.axes.T @ coefficients.alpha[1:]])
        centers = self.points[chosen]
        s = kernel_sum(self.scaled_kernel, self.points[rows], centers, coefficients.beta, alpha)
        return s - self.values[rows]

    def interpolant(self, chosen: IndexArray, coefficients: Coefficients) -> Interpolant:
        """Return the interpolant in metres."""
        alpha, beta = self.box.in_metres(self.kernel, self.points[chosen], *coefficients)
        return Interpolant(self.kernel, self.sites.points[chosen], beta, alpha)
