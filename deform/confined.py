"""The paper's method in its order: interpolate displacements in a hexahedron by radial basis functions.

Section numbers are the paper's. `deform.around` holds what we add to the method.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import FloatArray, IntArray, farthest
from sdm_deflect.base.threads import Progress, silent, single_threaded_blas
from sdm_deflect.base.ties import clearly_less

from .box.hexahedron import Hexahedron
from .rbf.data_sites import DIRECTIONS, DataSites, multivariate, univariate
from .rbf.factor import CholeskyBasis
from .rbf.fitting import Processor, RuleName, Strategy
from .rbf.greedy import Adaptation, adapt, fuse
from .rbf.interpolant import Interpolant
from .rbf.kernels import Kernel, kernel_sum
from .rbf.problem import Coefficients
from .rbf.rules import GreedyOptions, Rule, Separated, Worst

# Least distance of a zero site from a known node, as a share of the spacing of zero sites.
APART = 0.5
GROUPINGS: dict[Strategy, Callable[[Sequence[DataSites]], tuple[DataSites, ...]]] = {
    "squv": univariate,
    "mv": multivariate,
}
RULES: dict[RuleName, Rule] = {"separated": Separated(), "worst": Worst()}


# Section 3: only nodes in the hexahedron move; zero sites on its faces hold the mesh there.


def inside(hexahedron: Hexahedron, points: FloatArray) -> IntArray:
    """Return the rows (M,) of points (N, 3) in the hexahedron."""
    return np.flatnonzero(hexahedron.contains(points))


def zero_sites(on_faces: FloatArray, known: FloatArray, spacing: float) -> FloatArray:
    """Return the points (P, 3) on the faces that are at least `APART` spacings from every known node (K, 3)."""
    nearest, _ = cKDTree(known).query(on_faces)
    return np.ascontiguousarray(on_faces[~clearly_less(nearest, APART * spacing)])


# Section 4: add centres, for each direction (SQUV) or jointly (MV), until every site is within the tolerance.


@dataclass(frozen=True, slots=True)
class Choice:
    """How centres are chosen; `initial` counts those at the start: on the moving surface, and elsewhere.

    `processor` evaluates the interpolant.
    """

    kernel: Kernel
    strategy: Strategy
    rule: RuleName
    initial: tuple[int, int]
    options: GreedyOptions
    processor: Processor = "cpu"

    def adapt(
        self, group: DataSites, surface: int, earlier: CholeskyBasis | None, progress: Progress = silent
    ) -> Adaptation:
        """Fit one group of directions; start from the centres of an earlier fit, if given, and check every site."""
        initial = earlier.chosen if earlier else initial_centers(group, surface, self.initial)
        basis = (lambda problem, _: earlier.with_values(problem.values)) if earlier else CholeskyBasis.of
        names = "".join(DIRECTIONS[c] for c in group.components)

        def told(text: str, share: float) -> None:
            progress(f"{names}: {text}", share)

        return adapt(group, self.kernel, initial, self.options, rule=RULES[self.rule], basis=basis, progress=told)


def initial_centers(group: DataSites, surface: int, count: tuple[int, int]) -> IntArray:
    """Return the rows of the initial centres: `count[0]` of the first `surface` sites, `count[1]` of the others."""
    moving, others = group.points[:surface], group.points[surface:]
    return np.concatenate([farthest(moving, count[0]), surface + farthest(others, count[1])])


# Section 2: interpolate at the sites (eqs. 2 to 6), and evaluate at the nodes inside (eq. 7).


@dataclass(frozen=True, slots=True, eq=False)
class Confined:
    """The displacement in the hexahedron: one fit for each group of directions, joined in one interpolant."""

    adaptations: tuple[Adaptation, ...]
    interpolant: Interpolant = field(repr=False)

    @classmethod
    def fit(
        cls, sites: Sequence[DataSites], surface: int, how: Choice, earlier: "Confined | None" = None,
        progress: Progress = silent,
    ) -> "Confined":  # fmt: skip
        """Interpolate at the sites; the first `surface` are on the moving surface. SolveError if singular."""
        groups = GROUPINGS[how.strategy](sites)
        pairs = zip(groups, earlier.factors if earlier else (None,) * len(groups), strict=True)
        fits = tuple(how.adapt(group, surface, known, progress) for group, known in pairs)
        return cls(fits, replace(fuse(fits), processor=how.processor))

    def refit(self, sites: Sequence[DataSites], strategy: Strategy) -> "Confined":
        """Interpolate other values at the same sites with the same centres."""
        with single_threaded_blas():
            groups = zip(GROUPINGS[strategy](sites), self.factors, self.adaptations, strict=True)
            fits = tuple(Adaptation.on(factor.with_values(group.values), fit.stop) for group, factor, fit in groups)
        return type(self)(fits, replace(fuse(fits), processor=self.interpolant.processor))

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the displacement (M, 3) at points (M, 3)."""
        return self.interpolant(points)

    def reverse(self, points: FloatArray, gradient: FloatArray) -> list[FloatArray]:
        """Return, for each group, the gradient (S, k) by the values at its sites, given that by the displacement there.

        `points` and `gradient` are (M, 3). Centres and points change places in the sum (eq. 7).
        """
        out = []
        with single_threaded_blas():
            for fit, factor in zip(self.adaptations, self.factors, strict=True):
                problem, part = factor.kernel.problem, np.ascontiguousarray(gradient[:, fit.components])
                scaled, none = problem.box.scaled(points), np.zeros((4, part.shape[1]))
                alpha = np.vstack([part.sum(axis=0), scaled.T @ part])
                centers = problem.points[factor.chosen]
                beta = kernel_sum(problem.scaled_kernel, centers, scaled, part, none)
                values = np.zeros((len(problem.points), part.shape[1]))
                values[factor.chosen] = factor.reverse(Coefficients(alpha, beta))
                out.append(values)
        return out

    @property
    def factors(self) -> tuple[CholeskyBasis, ...]:
        """Factor of each fit."""
        return tuple(fit.basis for fit in self.adaptations if isinstance(fit.basis, CholeskyBasis))

    @property
    def error(self) -> float:
        """Largest error at any data site, as a length."""
        return max(fit.max_error for fit in self.adaptations)
