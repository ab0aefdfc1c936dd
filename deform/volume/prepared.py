"""A deflection prepared for any angle: its centres stay, so each step is factorised and evaluated once for all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.base import threads
from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.threads import single_threaded_blas
from sdm_deflect.deform.rbf.factor import CholeskyBasis
from sdm_deflect.deform.rbf.kernels import kernel_matrix, kernel_sum
from sdm_deflect.deform.rbf.problem import DataSites

from .deflection import shared, stepped
from .plan import BoxPlan
from .region import check_moving
from .step import Fits, Step, StepStart

SITE_TOLERANCE = 1e-6  # of the surface's median edge: a centre and its data site are no farther apart


class Centers(NamedTuple):
    """Centres (C, 3) of a step by direction: those that carry sliding nodes, if there are any, and those of all."""

    first: Mapping[int, FloatArray]
    all: Mapping[int, FloatArray]

    @property
    def start(self) -> None:
        """The start of the step is not known before."""

    def fits(self, state: StepStart, values: FloatArray, sliding: bool) -> Fits:
        """Fit on these centres; InputError if they are no data sites, or a system cannot be solved."""
        places = self.all if sliding or not len(state.sites.slid) else self.first
        groups = state.groups(values, sliding)
        return Fits.on(state, groups, [_rows(state, group, places) for group in groups])


class Moved(NamedTuple):
    """Where the nodes (N, 3) are, and the largest error of the interpolants at any data site."""

    points: FloatArray
    error: float


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Displacements at fixed points in one group of directions: a linear map from those of its data sites.

    Attributes
    ----------
    basis : the factor on the centres.
    at : (M + n, 3) the points and the sites, in the unit box.
    kernel : (M + n, C) kernel there; None where that takes too much memory.
    """

    basis: CholeskyBasis = field(repr=False)
    at: FloatArray = field(repr=False)
    kernel: FloatArray | None = field(repr=False)

    @classmethod
    def of(cls, basis: CholeskyBasis, points: FloatArray) -> "Evaluation":
        """Prepare the evaluation at points (M, 3)."""
        problem, chosen = basis.kernel.problem, basis.chosen
        at = np.vstack([problem.box.scaled(points), problem.points])
        few = len(at) * len(chosen) <= threads.LIMITS.matrix
        return cls(basis, at, kernel_matrix(problem.scaled_kernel, at, problem.points[chosen]) if few else None)

    def add(self, values: FloatArray, out: FloatArray) -> float:
        """Fill in its columns of displacements (M, 3), given those (S, 3) of the known points.

        Sites beyond these do not move. Returns the largest error at a site.
        """
        problem = self.basis.kernel.problem
        components, wanted = problem.sites.components, np.zeros_like(problem.values)
        wanted[: len(values)] = values[:, components]
        with single_threaded_blas():
            alpha, beta = self.basis.with_values(wanted).coefficients()
            if self.kernel is None:
                centers = problem.points[self.basis.chosen]
                found = kernel_sum(problem.scaled_kernel, self.at, centers, beta, alpha)
            else:
                found = self.kernel @ beta + (alpha[0] + self.at @ alpha[1:])
        out[:, components] = found[: len(out)]
        return float(np.abs(found[len(out) :] - wanted).max())


@dataclass(frozen=True, slots=True, eq=False)
class PreparedStep:
    """A step on fixed centres.

    Attributes
    ----------
    state : the mesh at its start.
    first : the evaluations by which sliding nodes are carried, none without such nodes.
    all : those with all boundary nodes.
    """

    state: StepStart = field(repr=False)
    first: tuple[Evaluation, ...]
    all: tuple[Evaluation, ...]

    @classmethod
    def of(cls, step: Step) -> "PreparedStep":
        """Prepare a step for other displacements of the moving nodes."""
        state, first = step.state, step.first.factors if step.first else ()
        slid, free = state.points[state.sites.slid], state.points[state.free]
        carried = tuple(Evaluation.of(basis, slid) for basis in first)
        return cls(state, carried, tuple(Evaluation.of(basis, free) for basis in step.fits.factors))

    def __call__(self, move: FloatArray) -> Moved:
        """Let the moving nodes go by `move` (K, 3)."""
        evaluated = Evaluated(self)
        _, points = self.state.carried_out(move, evaluated)
        return Moved(points, evaluated.error)


class Evaluated:
    """The evaluations of a step, and the largest error at a site that they had."""

    error: float = 0.0

    def __init__(self, step: PreparedStep) -> None:
        self.step = step

    def of_sliding(self, values: FloatArray) -> FloatArray:
        """See `Interpolation`."""
        return self._sum(self.step.first, values, len(self.step.state.sites.slid))

    def of_free(self, values: FloatArray) -> FloatArray:
        """See `Interpolation`."""
        return self._sum(self.step.all, values, len(self.step.state.free))

    def _sum(self, evaluations: Sequence[Evaluation], values: FloatArray, count: int) -> FloatArray:
        out = np.zeros((count, 3))
        self.error = max(self.error, *(one.add(values, out) for one in evaluations))
        return out


@dataclass(frozen=True, slots=True, eq=False)
class PreparedDeflection:
    """A deflection on fixed centres, for any angle.

    Each of n steps serves the angles of its n-th of `angle`, to which the centres belong; the last one also serves all
    beyond, the first one those of the other sign. `reached` is how far (K, 3) the moving nodes are at its start.
    """

    plan: BoxPlan
    angle: float
    steps: tuple[PreparedStep, ...] = field(repr=False)
    reached: tuple[FloatArray, ...] = field(repr=False)

    @classmethod
    def of(cls, plan: BoxPlan, angle: float, centers: Sequence[Centers]) -> "PreparedDeflection":
        """Prepare the steps of a deflection to an angle, given the centres that it found.

        Raises InputError if they are no data sites of the plan.
        """
        steps, count = stepped(plan, plan.job.amounts_at(angle), centers).steps, len(centers)
        reached = tuple(plan.boundary.displacement(shared(plan.job.amounts_at(angle), k, count)) for k in range(count))
        return cls(plan, angle, tuple(PreparedStep.of(step) for step in steps), reached)

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
        amounts = plan.job.amounts_at(angle)
        boundary, k = plan.boundary.knowing([amounts]), self.step(angle)
        check_moving(boundary, plan.region.hexahedron, [amounts])
        target = boundary.displacement(amounts)
        found = self.steps[k](target - self.reached[k])
        found.points[plan.sites.moving] = boundary.mesh.points[plan.sites.moving] + target
        return found._replace(points=plan.moved(found.points))


def _rows(state: StepStart, sites: DataSites, centers: Mapping[int, FloatArray]) -> IntArray:
    """Return the rows (C,) of the centres of a group among its sites; InputError if they are none."""
    found = centers.get(sites.components[0], np.empty((0, 3)))
    if found.ndim != 2 or found.shape[1] != 3 or not len(found) or not np.isfinite(found).all():
        raise InputError("no centres")
    distance, rows = cKDTree(sites.points).query(found)
    if np.any(distance > SITE_TOLERANCE * state.sites.edge) or len(np.unique(rows)) != len(rows):
        raise InputError(f"{state.boundary.mesh.name}: the centres are no data sites")
    return np.asarray(rows, dtype=np.intp)
