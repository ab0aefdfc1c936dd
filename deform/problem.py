"""One adaptation problem in well-conditioned coordinates: what every solver of it shares."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.duplicates import IndexArray
from sdm_deflect.deform.interpolant import Interpolant
from sdm_deflect.deform.kernels import FloatArray, Kernel
from sdm_deflect.deform.sites import DataSites
from sdm_deflect.deform.sums import kernel_sum
from sdm_deflect.deform.unitbox import UnitBox

NEIGHBOURS = 80  # sites around a new centre where the residual may grow


class Coefficients(NamedTuple):
    """Coefficients for the scaled coordinates of a `Problem`, one row of beta for each chosen site."""

    alpha: FloatArray  # (4, k) of 1 and the scaled coordinates
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
    tree: cKDTree

    @classmethod
    def of(cls, sites: DataSites, kernel: Kernel) -> Self:
        """Scale `sites`."""
        box = UnitBox.around(sites.points)
        points = box.scaled(sites.points)
        scaled_kernel = kernel.rescaled(box.length).kernel
        return cls(sites, kernel, box, points, box.polynomials(points), scaled_kernel, cKDTree(points))

    @property
    def values(self) -> FloatArray:
        """Displacements (N, k) at the sites."""
        return self.sites.values

    def errors(
        self, chosen: IndexArray, trail: Sequence[Coefficients], rows: IndexArray | slice = slice(None)
    ) -> FloatArray:
        """Return interpolant minus value at rows of the sites, (T, R, k), for T interpolants in one pass.

        Each interpolant of `trail` has the first of the chosen sites as its centres, as many as it has coefficients.
        """
        alpha = np.hstack([coefficients.alpha for coefficients in trail])
        beta = np.zeros((len(chosen), alpha.shape[1]))
        k = self.values.shape[1]
        for t, coefficients in enumerate(trail):
            beta[: len(coefficients.beta), t * k : (t + 1) * k] = coefficients.beta
        s = kernel_sum(self.scaled_kernel, self.points[rows], self.points[chosen], beta, alpha)
        return s.reshape(len(s), len(trail), k).transpose(1, 0, 2) - self.values[rows]

    def neighbours(self, rows: IndexArray) -> IndexArray:
        """Return the rows of the sites nearest to each of the given ones, all in one."""
        count = min(NEIGHBOURS, len(self.points))
        return np.asarray(self.tree.query(self.points[rows], count)[1]).ravel()

    def interpolant(self, chosen: IndexArray, coefficients: Coefficients) -> Interpolant:
        """Return the interpolant in metres."""
        alpha, beta = self.box.in_metres(self.kernel, self.points[chosen], *coefficients)
        return Interpolant(self.kernel, self.sites.points[chosen], beta, alpha)
