"""Bases of growing centres that serve again for other values."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.points import IndexArray
from sdm_deflect.deform.rbf.factor import CholeskyBasis
from sdm_deflect.deform.rbf.problem import Coefficients
from sdm_deflect.deform.rbf.sites import DataSites


def with_values(grown: CholeskyBasis, values: FloatArray) -> CholeskyBasis:
    """Return a basis on the same sites and centres for other values (N, k) at the sites.

    Costs one forward solve, C**2 for each column, instead of the factorisation's C**3.
    """
    kernel, problem = grown.kernel, grown.kernel.problem
    sites = DataSites(problem.sites.points, values, problem.sites.components)
    reduced = values - kernel.lagrange @ values[kernel.anchors]
    other = replace(kernel, problem=replace(problem, sites=sites), values=reduced)
    z = grown.factor.forward(reduced[grown.chosen[grown.beside]])
    return replace(grown, kernel=other, z=z)


@dataclass(frozen=True, slots=True, eq=False)
class RecordingBasis:
    """A basis that hands its final self to `keep`, so that the factor can serve again."""

    grown: CholeskyBasis
    keep: Callable[[CholeskyBasis], None]

    @property
    def chosen(self) -> IndexArray:
        """Rows (C,) of the sites: the centres."""
        return self.grown.chosen

    def extended(self, block: IndexArray) -> Self:
        """Return the basis with these rows of the sites as further centres."""
        return replace(self, grown=self.grown.extended(block))

    def coefficients(self) -> Coefficients:
        """Return the coefficients on the chosen centres."""
        return self.grown.coefficients()

    def refined(self) -> Coefficients:
        """Return the final coefficients, and keep the basis."""
        self.keep(self.grown)
        return self.grown.refined()
