"""One step: from displacements of the moving nodes to those of every node inside the box, and their derivative."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from sdm_deflect.deform.base import limits
from sdm_deflect.deform.base.arrays import FloatArray, IntArray, farthest
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.progress import Progress
from sdm_deflect.deform.base.threads import single_threaded_blas
from sdm_deflect.deform.mesh.images import Images
from sdm_deflect.deform.mesh.mesh import HERE, Runner
from sdm_deflect.deform.mesh.sliding import SlidingSurface
from sdm_deflect.deform.rbf.factor import CholeskyBasis
from sdm_deflect.deform.rbf.fitting import Fitting, RuleName, Strategy
from sdm_deflect.deform.rbf.greedy import Adaptation, Basis, GreedyOptions, Rule, Separated, Stop, Worst, adapt, fused
from sdm_deflect.deform.rbf.interpolant import Interpolant, SolveError
from sdm_deflect.deform.rbf.problem import DataSites, Problem, multivariate, univariate
from sdm_deflect.deform.volume.boundary import PrescribedNodes
from sdm_deflect.deform.volume.near_wall import (
    LocalRotation,
    Nearby,
    NearWall,
    Reach,
    RigidFollow,
    first_height,
    layer_sites,
)
from sdm_deflect.deform.volume.region import BoxNodes
from sdm_deflect.deform.volume.sites import Sites

DIRECTIONS = ("x", "y", "z")
NO_NODES = np.empty((0, 3))
ROUNDS = 8  # of putting nodes on several shapes, one after another
RULES: dict[RuleName, Rule] = {"separated": Separated(), "worst": Worst()}
GROUPINGS: dict[Strategy, Callable[[Sequence[DataSites]], tuple[DataSites, ...]]] = {
    "squv": univariate,
    "mv": multivariate,
}


@dataclass(frozen=True, slots=True, eq=False)
class Fits:
    """Fitted groups of directions."""

    adaptations: tuple[Adaptation, ...]

    @classmethod
    def on(cls, state: "StepStart", groups: Sequence[DataSites], centers: Sequence[IntArray]) -> "Fits":
        """Fit groups of sites on centres, the rows (C,) of each; InputError if a system cannot be solved."""
        found = []
        for group, rows in zip(groups, centers, strict=True):
            try:
                basis = CholeskyBasis.of(Problem.of(group, state.sites.kernel, state.fitting.polynomial), rows)
            except (SolveError, ValueError) as error:
                raise InputError(f"{state.boundary.mesh.name}: {error}") from None
            found.append(_solved(basis, Stop.CONVERGED))
        return cls(tuple(found))

    @property
    def factors(self) -> tuple[CholeskyBasis, ...]:
        """The factors that found them; none if the coefficients were read from a file."""
        return tuple(fit.basis for fit in self.adaptations if isinstance(fit.basis, CholeskyBasis))

    @property
    def interpolant(self) -> Interpolant:
        """One interpolant for all three directions."""
        return fused(self.adaptations)

    @property
    def error(self) -> float:
        """Largest error at any data site."""
        return max(one.max_error for one in self.adaptations)


@dataclass(frozen=True, slots=True, eq=False)
class StepStart:
    """The mesh at the start of a step, and what of it is known.

    Attributes
    ----------
    boundary, region, sites : the job's nodes, the box, and where displacements are known.
    points : (N, 3) coordinates of the whole mesh.
    free : (Q,) nodes inside that are not on a moving, fixed or sliding patch.
    reach : how far from boundary nodes the mesh follows these; 0: nowhere.
    layers : the free ones that are data sites beside the moving surface.
    near_wall : the free ones that follow boundary nodes nearby.
    near_sliding : the sliding ones that follow moving and fixed nodes nearby.
    turning : how boundary nodes turn.
    tied, tied_sliding : images of one another among the free nodes, and among those that slide.
    """

    boundary: PrescribedNodes
    region: BoxNodes
    sites: Sites
    points: FloatArray = field(repr=False)
    free: IntArray = field(repr=False)
    reach: float
    layers: RigidFollow = field(repr=False)
    near_wall: NearWall = field(repr=False)
    near_sliding: NearWall = field(repr=False)
    turning: LocalRotation = field(repr=False)
    tied: Images = field(repr=False)
    tied_sliding: Images = field(repr=False)

    @classmethod
    def of(cls, boundary: PrescribedNodes, region: BoxNodes, sites: Sites, points: FloatArray) -> "StepStart":
        """Sort the nodes inside, with the mesh at `points`."""
        free = np.setdiff1d(region.inside, sites.known, assume_unique=True)
        known = points[sites.known]
        tied = boundary.images.among(free), boundary.images.among(sites.slid)
        if not boundary.job.near_wall:
            none, no_edges = np.empty((0, 3)), np.empty((0, 2), dtype=np.intp)
            nearby = Nearby.of(none, known, [])
            nothing = NearWall.of(none, known, nearby, [], 0.0)
            turning = LocalRotation.of(known, no_edges, len(known))
            return cls(boundary, region, sites, points, free, 0.0, nothing.follow, nothing, nothing, turning, *tied)
        parts, places, certain = sites.parts(boundary), points[free], len(sites.moving) + len(sites.fixed)
        nearby = Nearby.of(places, known, parts)
        size = min(float(np.linalg.norm(np.ptp(points[surface.nodes], axis=0))) for surface in boundary.surfaces)
        reach = Reach.of(first_height(nearby, certain), sites.edge, size, sites.tolerance)
        rows = layer_sites(nearby, np.flatnonzero(sites.sheared(boundary)), reach.sites)
        layers = RigidFollow.of(places, known, rows, nearby)
        near_wall = NearWall.of(places, known, nearby, parts, reach.follow)
        places, parts = points[sites.slid], [part[part < certain] for part in parts]
        near_sliding = NearWall.of(places, known, Nearby.of(places, known, parts), parts, reach.follow)
        turning = LocalRotation.of(known, sites.edges(boundary), certain, boundary.mesh.plane)
        return cls(boundary, region, sites, points, free, reach.follow, layers, near_wall, near_sliding, turning, *tied)

    @property
    def fitting(self) -> Fitting:
        """Numbers of the interpolation."""
        return self.boundary.job.fitting

    def groups(self, values: FloatArray, sliding: bool) -> tuple[DataSites, ...]:
        """Group the sites, by the job's strategy, for displacements `values` (S, 3) of the known points.

        `sliding` says whether the sliding nodes are among them.
        """
        sites = self.sites
        slid = [sites.slid[sites.sampled_sliding]] if sliding else []
        nodes = [sites.moving[sites.distinct], sites.fixed[sites.sampled], self.free[self.layers.rows], *slid]
        components = self.boundary.components
        moving = DataSites(self.points[np.concatenate(nodes)], values[:, components], components)
        return GROUPINGS[self.fitting.strategy]([moving, *sites.zero])

    def values(self, move: FloatArray, slid: FloatArray | None = None) -> FloatArray:
        """Return the displacements (S, 3) of the known points, given those of moving (K, 3) and sliding nodes."""
        boundary = self.boundary_values(move, np.zeros((len(self.sites.slid), 3)))
        return self._at_sites(move, self.layers.displaced(boundary, self.turning.rotations(boundary)), slid)

    def rates(self, move: FloatArray, speed: FloatArray, slid: FloatArray | None = None) -> FloatArray:
        """Return the derivatives (S, 3) of `values`, given those of the moving and sliding nodes."""
        none = np.zeros((len(self.sites.slid), 3))
        boundary, rates = self.boundary_values(move, none), self.boundary_values(speed, none)
        turning = self.turning.rotation_rates(boundary, rates)
        return self._at_sites(speed, self.layers.displaced(rates, turning), slid)

    def boundary_values(self, move: FloatArray, slid: FloatArray) -> FloatArray:
        """Return the displacements of `sites.known`, given those of moving (K, 3) and sliding nodes."""
        return np.vstack([move, np.zeros((len(self.sites.fixed), 3)), slid])

    def _at_sites(self, move: FloatArray, beside: FloatArray, slid: FloatArray | None) -> FloatArray:
        parts = [move[self.sites.distinct], np.zeros((len(self.sites.sampled), 3)), beside]
        return np.vstack(parts if slid is None else [*parts, slid[self.sites.sampled_sliding]])

    def free_displacement(self, values: FloatArray, turns: FloatArray, interpolated: FloatArray) -> FloatArray:
        """Return the displacement (Q, 3) of the free nodes, or its derivative.

        Parameters
        ----------
        values, turns : Displacements (B, 3) and rotations less the identity (B, 3, 3) of `sites.known`, or their
            derivatives.
        interpolated : (Q, 3) of the interpolant at the free nodes.
        """
        out = self.near_wall.following(interpolated, values, turns)
        for section, nodes in self.region.sections:
            out[np.searchsorted(self.free, nodes), section.component] = 0.0
        return self.tied.projected(out)

    def slid(self, move: FloatArray, interpolated: FloatArray) -> FloatArray:
        """Return the displacement (L, 3) of the sliding nodes, given the interpolant's: on their shapes."""
        return _on_shapes(self, _carried(self, interpolated, move))

    def moved(self, move: FloatArray, slid: FloatArray, interpolated: FloatArray) -> FloatArray:
        """Return where all nodes (N, 3) come to be, given the interpolant's displacement (Q, 3) of the free ones."""
        points, boundary = self.points.copy(), self.boundary_values(move, slid)
        if boundary.any():
            points[self.free] += self.free_displacement(boundary, self.turning.rotations(boundary), interpolated)
            points[self.sites.known] += boundary
        return points


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """The fits of one step, and the displacement that follows.

    Attributes
    ----------
    state : the mesh at its start.
    move : (K, 3) displacement of the moving nodes.
    first : the fit by which sliding nodes are carried, where there are any; they are then put on their shapes.
    fits : the fit with all boundary nodes.
    slid : (L, 3) displacement of the sliding nodes.
    correction : largest distance of a boundary node from its place before it was put there.
    points : (N, 3) coordinates at the end of the step.
    evaluation_seconds : time to evaluate the interpolant at the free nodes.
    """

    state: StepStart = field(repr=False)
    move: FloatArray = field(repr=False)
    first: Fits | None
    fits: Fits
    slid: FloatArray = field(repr=False)
    correction: float
    points: FloatArray = field(repr=False)
    evaluation_seconds: float

    @property
    def error(self) -> float:
        """Largest error at any data site, of both fits."""
        return max(fits.error for fits in (self.first, self.fits) if fits)


Fit = Callable[[bool, FloatArray], Fits]
"""What interpolates displacements (S, 3) of the known points; first whether the sliding nodes are among these."""


def solve(state: StepStart, move: FloatArray, fit: Fit, runner: Runner = HERE) -> Step:
    """Carry out one step: moving nodes (K, 3) go by `move`, sliding ones stay on their shapes, all others follow."""
    first, slid, sliding = None, NO_NODES, bool(len(state.sites.slid))
    if sliding:
        first = fit(False, state.values(move))
        slid = state.slid(move, first.interpolant(state.points[state.sites.slid]))
    fits = fit(sliding, state.values(move, slid if sliding else None))
    known, boundary = state.sites.known, state.boundary_values(move, slid)
    interpolant = fits.interpolant
    off = np.linalg.norm(boundary - interpolant(state.points[known]), axis=1)
    interpolant(state.points[:1])  # loads compiled code: not part of the evaluation's time
    start = perf_counter()
    displacement = evaluated(interpolant, state.points[state.free], runner)
    seconds = perf_counter() - start
    return Step(state, move, first, fits, slid, float(off.max()), state.moved(move, slid, displacement), seconds)


def evaluated(interpolant: Interpolant, points: FloatArray, runner: Runner) -> FloatArray:
    """Evaluate at points (M, 3); the bits do not depend on how they are shared out."""
    if runner.shares_memory or len(points) * len(interpolant.centers) < limits.LIMITS.sent_pairs:
        return interpolant(points)
    size = limits.LIMITS.sent
    parts = [points[start : start + size] for start in range(0, len(points), size)]
    return np.concatenate(list(runner.map(_sums, interpolant, parts)))


def _sums(interpolant: Interpolant, points: FloatArray) -> FloatArray:
    return interpolant(points, threads=1)


def rate(step: Step, speed: FloatArray) -> FloatArray:
    """Return d(points)/d(angle) (N, 3) at the end of a step, given that (K, 3) of the moving nodes.

    The displacement is linear in the known values as long as the centres stay: a second right-hand side for the
    same factor gives its derivative exactly.
    """
    state, move, slid, sliding = step.state, step.move, np.empty((0, 3)), step.first is not None
    if step.first is not None:
        nodes = state.points[state.sites.slid]
        speeds = _on_same_centers(step.first, state.groups(state.rates(move, speed), False))(nodes)
        carried = _carried(state, step.first.interpolant(nodes), move)
        slid = _on_shapes_rate(state, carried, _carried_rate(state, speeds, move, speed))
    values = state.rates(move, speed, slid if sliding else None)
    interpolant = _on_same_centers(step.fits, state.groups(values, sliding))
    boundary, rates = state.boundary_values(move, step.slid), state.boundary_values(speed, slid)
    out, turning = np.zeros_like(state.points), state.turning.rotation_rates(boundary, rates)
    out[state.free] = state.free_displacement(rates, turning, interpolant(state.points[state.free]))
    out[state.sites.known] = rates
    return out


def initial_centers(group: DataSites, surface: int, count: tuple[int, int]) -> IntArray:
    """Return the rows of the initial centres: so many of the first `surface` sites and of the others."""
    own, others = group.points[:surface], group.points[surface:]
    return np.concatenate([farthest(own, count[0]), surface + farthest(others, count[1])])


def adapted(state: StepStart, progress: Progress, earlier: Step | None = None) -> Fit:
    """Return the fit that adapts centres until every site is within the tolerance.

    With an earlier step its centres and factors come first: every site is checked, and centres are added where one is
    off by more than the tolerance.
    """

    def fit(sliding: bool, values: FloatArray) -> Fits:
        groups = state.groups(values, sliding)
        known = (earlier.fits if sliding or not earlier.first else earlier.first).factors if earlier else None
        bases = known or (None,) * len(groups)
        return Fits(tuple(_adapted(state, *pair, progress) for pair in zip(groups, bases, strict=True)))

    return fit


def _adapted(state: StepStart, group: DataSites, known: CholeskyBasis | None, progress: Progress) -> Adaptation:
    """Adapt the centres of one group of directions, from those of a known basis if there is one."""
    fitting, tolerance = state.fitting, state.sites.tolerance
    options = GreedyOptions(
        n_add=fitting.n_add, tol_add=tolerance, tol_stop=tolerance, max_centers=fitting.max_centers,
        polynomial=fitting.polynomial,
    )  # fmt: skip
    counts = fitting.initial_surface, fitting.initial_hexahedron
    initial = known.chosen if known else initial_centers(group, len(state.sites.distinct), counts)

    def start(problem: Problem, rows: IntArray) -> Basis:
        return known.with_values(problem.values) if known else CholeskyBasis.of(problem, rows)

    with _solvable(state):
        return adapt(
            group, state.sites.kernel, initial, options,
            rule=RULES[fitting.rule], basis=start, progress=_named(progress, group),
        )  # fmt: skip


@contextmanager
def _solvable(state: StepStart) -> Iterator[None]:
    """Blame the radius of a kernel that has one for a system that cannot be solved: InputError."""
    try:
        yield
    except SolveError as error:
        if not state.sites.radius:
            raise
        fitting, name = state.fitting, state.boundary.mesh.name
        given = f"kernel = {fitting.kernel} with kernel_radius = {state.sites.radius:.4g}"
        raise InputError(f"{name}: {given}: {error} A smaller radius makes the system better conditioned") from None


def _named(progress: Progress, group: DataSites) -> Progress:
    """Return a progress that tells which directions are fitted."""
    names = "".join(DIRECTIONS[c] for c in group.components)

    def named(text: str, fraction: float) -> None:
        progress(f"{names}: {text}", fraction)

    return named


def _on_same_centers(earlier: Fits, groups: Sequence[DataSites]) -> Interpolant:
    """Interpolate other values at the same points on exactly the centres of an earlier fit."""
    with single_threaded_blas():
        parts = zip(groups, earlier.factors, earlier.adaptations, strict=True)
        return fused([_solved(factor.with_values(group.values), fit.stop) for group, factor, fit in parts])


def _solved(basis: CholeskyBasis, stop: Stop) -> Adaptation:
    """Return the interpolant on the centres of a basis, without a history."""
    problem = basis.kernel.problem
    interpolant = problem.interpolant(basis.chosen, basis.refined())
    return Adaptation(interpolant, problem.sites.components, basis.chosen, (), stop, np.nan, basis)


def _carried(state: StepStart, displacement: FloatArray, move: FloatArray) -> FloatArray:
    """Let sliding nodes (L, 3) follow the moving and fixed ones nearby, before they are put on their shapes."""
    values = state.boundary_values(move, np.zeros_like(displacement))
    return state.near_sliding.following(displacement, values, state.turning.rotations(values))


def _carried_rate(state: StepStart, speeds: FloatArray, move: FloatArray, speed: FloatArray) -> FloatArray:
    """Return the derivative (L, 3) of `_carried`, given that of the displacement."""
    none = np.zeros_like(speeds)
    values, rates = state.boundary_values(move, none), state.boundary_values(speed, none)
    return state.near_sliding.following(speeds, rates, state.turning.rotation_rates(values, rates))


def _on_shapes(state: StepStart, displacement: FloatArray) -> FloatArray:
    """Put sliding nodes (L, 3) on their shapes, as images of one another; those on several, on one after another."""
    for surface, rows, points in _rounds(state):
        displacement[rows] = surface.projected(points, displacement[rows])
        displacement = state.tied_sliding.projected(displacement)
    return state.tied_sliding.projected(displacement)


def _on_shapes_rate(state: StepStart, displacement: FloatArray, speed: FloatArray) -> FloatArray:
    """Return the derivative (L, 3) of `_on_shapes`, given that of the displacement."""
    for surface, rows, points in _rounds(state):
        speed[rows] = surface.rate(points, displacement[rows], speed[rows])
        displacement[rows] = surface.projected(points, displacement[rows])
        speed, displacement = (state.tied_sliding.projected(one) for one in (speed, displacement))
    return state.tied_sliding.projected(speed)


def _rounds(state: StepStart) -> list[tuple[SlidingSurface, IntArray, FloatArray]]:
    """Return each shape with the rows and points of the sliding nodes on it, once, or in turn if there are several."""
    slid, patches = state.sites.slid, state.boundary.sliding
    one = [
        (patch.surface, np.searchsorted(slid, nodes), state.points[nodes])
        for patch, nodes in zip(patches, state.sites.sliding, strict=True)
    ]
    return one * (ROUNDS if len(one) + bool(len(state.tied_sliding.nodes)) > 1 else 1)
