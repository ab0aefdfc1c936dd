"""Interpolants of the displacement: fitted, and fitted again on the same centres for other values."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.cases.case import AdaptationSettings
from sdm_deflect.cases.confine import GROUPINGS
from sdm_deflect.cases.fitting import fit_from, initial_centers
from sdm_deflect.cases.own.job import Fitting
from sdm_deflect.cases.progress import Report
from sdm_deflect.deform.rbf.bases import Kept, with_values
from sdm_deflect.deform.rbf.factor import Grown
from sdm_deflect.deform.rbf.greedy import Adaptation, Basis
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray
from sdm_deflect.deform.rbf.problem import Problem
from sdm_deflect.deform.rbf.sites import DataSites, pinned
from sdm_deflect.deform.rbf.threads import single_threaded_blas
from sdm_deflect.deform.volume.fused import fused

INITIAL = 30  # centres on the surface, and on all else


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """Points of known displacement; the first `moving` rows are on the moving surface.

    Attributes
    ----------
    points : (S, 3) boundary nodes, each place once.
    zero : (Z, 3) points on the box that stay.
    moving : number of rows of `points` on the moving surface.
    """

    points: FloatArray = field(repr=False)
    zero: FloatArray = field(repr=False)
    moving: int

    def groups(self, values: FloatArray, fitting: Fitting) -> tuple[DataSites, ...]:
        """Group sites of displacements `values` (S, 3) by the job's strategy; (Z,) zeros follow."""
        parts = [DataSites(self.points, values), *([pinned(self.zero)] if len(self.zero) else [])]
        return GROUPINGS[fitting.strategy](parts)


@dataclass(frozen=True, slots=True, eq=False)
class Fits:
    """Fitted groups of directions, and the factors that found them."""

    adaptations: tuple[Adaptation, ...]
    factors: tuple[Grown, ...] = field(repr=False)

    @property
    def interpolant(self) -> Interpolant:
        """One interpolant for all three directions."""
        return fused(self.adaptations)

    @property
    def error(self) -> float:
        """Largest error at any data site."""
        return max(one.max_error for one in self.adaptations)


def fitted(known: Known, values: FloatArray, fitting: Fitting, settings: AdaptationSettings, report: Report) -> Fits:
    """Adapt centres to displacements `values` (S, 3) of known points."""
    found: list[Adaptation] = []
    kept: list[Grown] = []
    for group in known.groups(values, fitting):
        initial = initial_centers(group, known.moving, (settings.initial_surface, settings.initial_hexahedron))

        def start(problem: Problem, rows: IndexArray) -> Basis:
            return Kept(Grown.of(problem, rows), kept.append)

        found.append(fit_from(group, initial, settings, report, start))
    return Fits(tuple(found), tuple(kept))


def fitted_again(
    earlier: Fits, known: Known, values: FloatArray, fitting: Fitting, settings: AdaptationSettings, report: Report
) -> Fits:
    """Fit other displacements of the same points from the centres and factors of an earlier fit.

    Every site is checked; centres are added where one is off by more than the tolerance.
    """
    found: list[Adaptation] = []
    kept: list[Grown] = []
    for group, factor in zip(known.groups(values, fitting), earlier.factors, strict=True):

        def start(problem: Problem, rows: IndexArray, factor: Grown = factor) -> Basis:
            del rows
            return Kept(with_values(factor, problem.values), kept.append)

        found.append(fit_from(group, factor.chosen, settings, report, start))
    return Fits(tuple(found), tuple(kept))


def on_same_centers(earlier: Fits, known: Known, values: FloatArray, fitting: Fitting) -> Interpolant:
    """Interpolate other values (S, 3) at the same points on exactly the centres of an earlier fit."""
    columns: list[Interpolant] = []
    groups: Sequence[DataSites] = known.groups(values, fitting)
    with single_threaded_blas():
        for group, factor in zip(groups, earlier.factors, strict=True):
            grown = with_values(factor, group.values)
            columns.append(grown.kernel.problem.interpolant(grown.chosen, grown.refined()))
    solved = [Adaptation(s, g.components, f.chosen, (), a.stop, np.nan) for s, g, f, a in
              zip(columns, groups, earlier.factors, earlier.adaptations, strict=True)]  # fmt: skip
    return fused(solved)
