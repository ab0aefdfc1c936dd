"""The paper's method, in its order: displacements in a hexahedron, by radial basis functions on adaptive centres.

Section numbers are the paper's. What the product adds to the method is in `deform.around`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.base.arrays import FloatArray, IntArray, farthest
from sdm_deflect.deform.base.threads import Progress, silent, single_threaded_blas
from sdm_deflect.deform.box.hexahedron import Hexahedron

from .rbf.factor import CholeskyBasis
from .rbf.fitting import RuleName, Strategy
from .rbf.greedy import Adaptation, adapt, fused
from .rbf.interpolant import Interpolant
from .rbf.kernels import Kernel
from .rbf.problem import DIRECTIONS, DataSites, multivariate, univariate
from .rbf.rules import GreedyOptions, Rule, Separated, Worst

APART = 0.5
"""Least distance of a zero site from a node of known displacement, as a share of the distance between zero sites."""
GROUPINGS: dict[Strategy, Callable[[Sequence[DataSites]], tuple[DataSites, ...]]] = {
    "squv": univariate,
    "mv": multivariate,
}
RULES: dict[RuleName, Rule] = {"separated": Separated(), "worst": Worst()}


# Section 3: only nodes in the hexahedron move; zero sites on its faces hold all others.


def inside(hexahedron: Hexahedron, points: FloatArray) -> IntArray:
    """Return the rows (M,) of points (N, 3) in the hexahedron."""
    return np.flatnonzero(hexahedron.contains(points))


def zero_sites(on_faces: FloatArray, known: FloatArray, spacing: float) -> FloatArray:
    """Return the points (P, 3) on the faces that keep `APART` spacings from nodes of known displacement (K, 3)."""
    nearest, _ = cKDTree(known).query(on_faces)
    return np.ascontiguousarray(on_faces[nearest >= APART * spacing])


# Section 4: centres for each direction (SQUV) or for all (MV) are added until all sites are within the tolerance.


@dataclass(frozen=True, slots=True)
class Choice:
    """How centres are chosen; `initial` is their number at the start, on the moving surface and on all other sites."""

    kernel: Kernel
    strategy: Strategy
    rule: RuleName
    initial: tuple[int, int]
    options: GreedyOptions

    def adapted(
        self, group: DataSites, surface: int, earlier: CholeskyBasis | None, progress: Progress = silent
    ) -> Adaptation:
        """Fit one group of directions; the centres of an earlier fit come first, and every site is checked."""
        initial = earlier.chosen if earlier else initial_centers(group, surface, self.initial)
        basis = (lambda problem, _: earlier.with_values(problem.values)) if earlier else CholeskyBasis.of
        names = "".join(DIRECTIONS[c] for c in group.components)

        def told(text: str, share: float) -> None:
            progress(f"{names}: {text}", share)

        return adapt(group, self.kernel, initial, self.options, rule=RULES[self.rule], basis=basis, progress=told)


def initial_centers(group: DataSites, surface: int, count: tuple[int, int]) -> IntArray:
    """Return the rows of the initial centres: so many of the first `surface` sites, and of the others."""
    moving, others = group.points[:surface], group.points[surface:]
    return np.concatenate([farthest(moving, count[0]), surface + farthest(others, count[1])])


# Section 2: the displacement interpolates the sites (eqs. 2 to 6), and is evaluated at the nodes inside (eq. 7).


@dataclass(frozen=True, slots=True, eq=False)
class Confined:
    """The displacement in the hexahedron: a fit for each group of directions, and one interpolant of them all."""

    adaptations: tuple[Adaptation, ...]
    interpolant: Interpolant = field(repr=False)

    @classmethod
    def fit(
        cls, sites: Sequence[DataSites], surface: int, how: Choice, earlier: "Confined | None" = None,
        progress: Progress = silent,
    ) -> "Confined":  # fmt: skip
        """Interpolate at the sites, of which the first `surface` are on the moving surface; SolveError if singular."""
        groups = GROUPINGS[how.strategy](sites)
        pairs = zip(groups, earlier.factors if earlier else (None,) * len(groups), strict=True)
        fits = tuple(how.adapted(group, surface, known, progress) for group, known in pairs)
        return cls(fits, fused(fits))

    def refit(self, sites: Sequence[DataSites], strategy: Strategy) -> "Confined":
        """Interpolate other values at the same sites, on the same centres."""
        with single_threaded_blas():
            groups = zip(GROUPINGS[strategy](sites), self.factors, self.adaptations, strict=True)
            fits = tuple(Adaptation.on(factor.with_values(one.values), fit.stop) for one, factor, fit in groups)
        return type(self)(fits, fused(fits))

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the displacement (M, 3) at points (M, 3)."""
        return self.interpolant(points)

    @property
    def factors(self) -> tuple[CholeskyBasis, ...]:
        """The factor of each fit."""
        return tuple(fit.basis for fit in self.adaptations if isinstance(fit.basis, CholeskyBasis))

    @property
    def error(self) -> float:
        """Largest error at any data site."""
        return max(fit.max_error for fit in self.adaptations)
