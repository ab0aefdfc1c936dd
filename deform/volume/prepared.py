"""A deflection prepared for any angle: its centres stay, so each step is factorised and evaluated once for all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, lu_factor, lu_solve
from scipy.spatial import cKDTree

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.threads import single_threaded_blas
from sdm_deflect.deform.rbf.interpolant import UnitBox, coefficient_matrix
from sdm_deflect.deform.rbf.kernels import Kernel
from sdm_deflect.deform.rbf.sites import DataSites
from sdm_deflect.deform.rbf.sums import kernel_matrix, kernel_sum
from sdm_deflect.deform.volume.deflection import Plan
from sdm_deflect.deform.volume.region import check_moving
from sdm_deflect.deform.volume.step import StepState

SAME = 1e-6  # of the surface's median edge: a centre and its data site are no farther apart
MOST = 1 << 25  # entries of an evaluation matrix, 256 MB; beyond, the sums are computed at every angle


class Centers(NamedTuple):
    """Centres (C, 3) of a step by direction: those that carry sliding nodes, if there are any, and those of all."""

    first: Mapping[int, FloatArray]
    all: Mapping[int, FloatArray]


class Moved(NamedTuple):
    """Where the nodes (N, 3) are, and the largest error of the interpolants at any data site."""

    points: FloatArray
    error: float


@dataclass(frozen=True, slots=True, eq=False)
class PreparedFit:
    """One interpolation problem on fixed centres: a linear map from values at the sites to values at fixed points.

    Attributes
    ----------
    components : directions of its columns.
    chosen : (C,) rows of the data sites that are centres.
    count : number n of data sites; those beyond the known points do not move.
    box, kernel, centers : the unit box, the kernel in it, and the centres (C, 3) there.
    factor, pivots : LU factorisation of the matrix of eq. 6.
    at : (M + n, 3) the points and the sites, in the unit box.
    evaluation : (M + n, q + C) polynomials and kernel there; None where that takes too much memory.
    """

    components: tuple[int, ...]
    chosen: IntArray = field(repr=False)
    count: int
    box: UnitBox = field(repr=False)
    kernel: Kernel
    centers: FloatArray = field(repr=False)
    factor: FloatArray = field(repr=False)
    pivots: IntArray = field(repr=False)
    at: FloatArray = field(repr=False)
    evaluation: FloatArray | None = field(repr=False)

    @classmethod
    def of(cls, state: StepState, sites: DataSites, chosen: IntArray, points: FloatArray) -> "PreparedFit":
        """Factorise for the chosen rows of the sites, and prepare the evaluation at points (M, 3)."""
        with single_threaded_blas():
            box = UnitBox.around(sites.points[chosen], state.fitting.polynomial)
            centers, at = box.scaled(sites.points[chosen]), box.scaled(np.vstack([points, sites.points]))
            kernel = state.sites.kernel.rescaled(box.length).kernel
            matrix = coefficient_matrix(box.polynomials(centers), kernel, centers)
            try:
                factor, pivots = lu_factor(matrix)
            except (LinAlgError, ValueError) as error:
                raise InputError(f"the system of {len(matrix)} unknowns cannot be factorised: {error}") from None
            whole = None
            if len(at) * len(matrix) <= MOST:
                whole = np.hstack([box.polynomials(at), kernel_matrix(kernel, at, centers)])
        return cls(sites.components, chosen, len(sites), box, kernel, centers, factor, pivots, at, whole)

    def __call__(self, values: FloatArray) -> tuple[FloatArray, float]:
        """Return the displacement (M, k) for one (S, 3) of the known points, and the largest error at the sites."""
        wanted = np.zeros((self.count, len(self.components)))
        wanted[: len(values)] = values[:, self.components]
        right = np.zeros((len(self.factor), len(self.components)))
        q = len(right) - len(self.chosen)
        right[q:] = wanted[self.chosen]
        with single_threaded_blas():
            solution = lu_solve((self.factor, self.pivots), right, overwrite_b=True)
            if self.evaluation is None:
                alpha = self.box.complete(solution[:q])
                found = kernel_sum(self.kernel, self.at, self.centers, solution[q:], alpha)
            else:
                found = self.evaluation @ solution
        inside = len(found) - self.count
        return found[:inside], float(np.abs(found[inside:] - wanted).max())


@dataclass(frozen=True, slots=True, eq=False)
class PreparedStep:
    """A step on fixed centres.

    Attributes
    ----------
    state : the mesh at its start.
    first : the fits by which sliding nodes are carried, none without such nodes.
    fits : the fits with all boundary nodes.
    """

    state: StepState = field(repr=False)
    first: tuple[PreparedFit, ...]
    fits: tuple[PreparedFit, ...]

    @classmethod
    def of(cls, state: StepState, centers: Centers) -> "PreparedStep":
        """Find the centres among the data sites and factorise; InputError if they are no data sites."""
        sliding, move = state.sites.slid, np.zeros((len(state.sites.moving), 3))
        none = np.zeros((len(sliding), 3))
        first: tuple[PreparedFit, ...] = ()
        if len(sliding):
            groups = state.groups(state.values(move), sliding=False)
            first = tuple(_prepared(state, one, centers.first, state.points[sliding]) for one in groups)
        groups = state.groups(state.values(move, none if len(sliding) else None), sliding=len(sliding) > 0)
        fits = tuple(_prepared(state, one, centers.all, state.points[state.free]) for one in groups)
        return cls(state, first, fits)

    def __call__(self, move: FloatArray) -> Moved:
        """Let the moving nodes go by `move` (K, 3)."""
        state, slid, off = self.state, np.empty((0, 3)), 0.0
        if self.first:
            found, off = _evaluated(self.first, state.values(move))
            slid = state.slid(move, found)
        found, error = _evaluated(self.fits, state.values(move, slid if self.first else None))
        return Moved(state.moved(move, slid, found), max(off, error))

    def centers(self, points: FloatArray) -> FloatArray:
        """Return the centres (C, 3) of all directions, those on the moving surface where it is in points (N, 3)."""
        sites = self.state.sites
        own = sites.moving[sites.distinct]
        on = [fit.chosen[fit.chosen < len(own)] for fit in self.fits]
        others = [fit.centers[fit.chosen >= len(own)] * fit.box.length + fit.box.origin for fit in self.fits]
        return np.unique(np.vstack([points[own[np.unique(np.concatenate(on))]], *others]), axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class PreparedDeflection:
    """A deflection on fixed centres, for any angle.

    Each of n steps serves the angles of its n-th of `angle`, to which the centres belong; the last one also serves all
    beyond, the first one those of the other sign.
    """

    plan: Plan
    angle: float
    steps: tuple[PreparedStep, ...] = field(repr=False)

    @classmethod
    def of(cls, plan: Plan, angle: float, centers: Sequence[Centers]) -> "PreparedDeflection":
        """Prepare the steps of a deflection to an angle, given the centres that it found.

        Raises InputError if they are no data sites of the plan.
        """
        points, steps, reached = plan.mesh.points, [], np.zeros((len(plan.sites.moving), 3))
        for k, own in enumerate(centers, 1):
            steps.append(PreparedStep.of(plan.state(points), own))
            target = plan.boundary.displacement(_share(plan, angle, k, len(centers)))
            points, reached = steps[-1](target - reached).points, target
        return cls(plan, angle, tuple(steps))

    def step(self, angle: float) -> int:
        """Return which step serves an angle, from 0."""
        count, share = len(self.steps), angle / self.angle if self.angle else 0.0
        return min(max(ceil(share * count - 1e-9), 1), count) - 1

    def check(self, angle: float) -> None:
        """Raise InputError if the surfaces cannot move to an angle within the box."""
        amounts = self.plan.job.amounts_at(angle)
        check_moving(self.plan.boundary, self.plan.region.hexahedron, [amounts])

    def at(self, angle: float) -> Moved:
        """Bring the mesh to an angle; at zero nothing is interpolated.

        Raises InputError if the surfaces cannot move so far within the box.
        """
        plan = self.plan
        if angle == 0.0:
            return Moved(plan.mesh.points, 0.0)
        self.check(angle)
        k, target = self.step(angle), plan.boundary.displacement(plan.job.amounts_at(angle))
        reached = plan.boundary.displacement(_share(plan, self.angle, k, len(self.steps)))
        found = self.steps[k](target - reached)
        found.points[plan.sites.moving] = plan.mesh.points[plan.sites.moving] + target
        return found

    def centers(self, angle: float, points: FloatArray) -> FloatArray:
        """Return the centres (C, 3) that serve an angle, with the mesh at points (N, 3)."""
        return self.steps[self.step(angle)].centers(points)


def _share(plan: Plan, angle: float, k: int, count: int) -> tuple[float, ...]:
    """Return the amounts after k of so many steps to an angle."""
    return tuple(amount * k / count for amount in plan.job.amounts_at(angle))


def _prepared(state: StepState, sites: DataSites, centers: Mapping[int, FloatArray], points: FloatArray) -> PreparedFit:
    """Prepare one group for points (M, 3); InputError if the centres of its directions are not among its sites."""
    found = centers.get(sites.components[0], np.empty((0, 3)))
    if found.ndim != 2 or found.shape[1] != 3 or not len(found) or not np.isfinite(found).all():
        raise InputError("no centres")
    distance, rows = cKDTree(sites.points).query(found)
    if np.any(distance > SAME * state.sites.edge) or len(np.unique(rows)) != len(rows):
        raise InputError(f"{state.boundary.mesh.name}: the centres are no data sites")
    return PreparedFit.of(state, sites, np.asarray(rows, dtype=np.intp), points)


def _evaluated(fits: Sequence[PreparedFit], values: FloatArray) -> tuple[FloatArray, float]:
    """Return the displacement (M, 3) of all directions for one (S, 3) of the known points, and the largest error."""
    parts = [fit(values) for fit in fits]
    out = np.zeros((len(parts[0][0]), 3))
    for fit, (columns, _) in zip(fits, parts, strict=True):
        out[:, fit.components] = columns
    return out, max(error for _, error in parts)
