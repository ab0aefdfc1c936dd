"""One step: from displacements of the moving nodes to those of every node inside the box."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Protocol

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray, farthest
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.threads import Progress, single_threaded_blas
from sdm_deflect.deform.mesh.images import Images
from sdm_deflect.deform.mesh.mesh import HERE, Runner
from sdm_deflect.deform.mesh.sliding import Plane, SlidingSurface
from sdm_deflect.deform.rbf.factor import CholeskyBasis
from sdm_deflect.deform.rbf.fitting import Fitting, RuleName, Strategy
from sdm_deflect.deform.rbf.greedy import Adaptation, GreedyOptions, Rule, Separated, Stop, Worst, adapt, fused
from sdm_deflect.deform.rbf.interpolant import Interpolant, SolveError, evaluated
from sdm_deflect.deform.rbf.problem import DataSites, Problem, multivariate, univariate

from .boundary import PrescribedNodes
from .near_wall import LocalRotation, Nearby, NearWall, Reach, RigidFollow, first_height, layer_sites
from .region import BoxNodes
from .sites import Sites

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
    """The fits of one step, one for each group of directions."""

    adaptations: tuple[Adaptation, ...]

    @classmethod
    def on(cls, state: "StepStart", groups: Sequence[DataSites], centers: Sequence[IntArray]) -> "Fits":
        """Fit groups of sites on centres, the rows (C,) of each; InputError if a system cannot be solved."""
        adaptations = []
        for group, rows in zip(groups, centers, strict=True):
            try:
                basis = CholeskyBasis.of(Problem.of(group, state.sites.kernel, state.fitting.polynomial), rows)
            except (SolveError, ValueError) as error:
                raise InputError(f"{state.boundary.mesh.name}: {error}") from None
            adaptations.append(_solved(basis, Stop.CONVERGED))
        return cls(tuple(adaptations))

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
        return max(fit.max_error for fit in self.adaptations)


@dataclass(frozen=True, slots=True, eq=False)
class Following:
    """What follows the boundary nearby, at the start of a step.

    Attributes
    ----------
    reach : how far from boundary nodes the mesh follows these.
    layers : the free nodes that are data sites beside the moving surface.
    free : the free nodes that follow boundary nodes nearby.
    sliding : the sliding nodes that follow moving and fixed nodes nearby.
    turning : how boundary nodes turn.
    """

    reach: float
    layers: RigidFollow = field(repr=False)
    free: NearWall = field(repr=False)
    sliding: NearWall = field(repr=False)
    turning: LocalRotation = field(repr=False)

    @classmethod
    def of(cls, boundary: PrescribedNodes, sites: Sites, points: FloatArray, free: IntArray) -> "Following":
        """Find it among the free nodes (Q,) and the sliding ones of a mesh with its nodes at points (N, 3)."""
        known, parts, places = points[sites.known], sites.parts(boundary), points[free]
        certain = len(sites.moving) + len(sites.fixed)
        nearby = Nearby.of(places, known, parts)
        size = min(float(np.linalg.norm(np.ptp(points[surface.nodes], axis=0))) for surface in boundary.surfaces)
        reach = Reach.of(first_height(nearby, certain), sites.edge, size, sites.tolerance)
        rows = layer_sites(nearby, np.flatnonzero(sites.sheared), reach.sites)
        layers = RigidFollow.of(places, known, rows, nearby)
        near_wall = NearWall.of(places, known, nearby, parts, reach.follow)
        places, parts = points[sites.slid], [part[part < certain] for part in parts]
        sliding = NearWall.of(places, known, Nearby.of(places, known, parts), parts, reach.follow)
        turning = LocalRotation.of(known, sites.edges, certain, boundary.mesh.normal)
        return cls(reach.follow, layers, near_wall, sliding, turning)


class Interpolation(Protocol):
    """What interpolates displacements (S, 3) of the known points."""

    def of_sliding(self, values: FloatArray) -> FloatArray:
        """Return the displacements (L, 3) of the sliding nodes, which are not among the known points."""

    def of_free(self, values: FloatArray) -> FloatArray:
        """Return the displacements (Q, 3) of the free nodes; sliding nodes are among the known points."""


@dataclass(frozen=True, slots=True, eq=False)
class StepStart:
    """The mesh at the start of a step, and what of it is known.

    Attributes
    ----------
    boundary, region, sites : the job's nodes, the box, and where displacements are known.
    points : (N, 3) coordinates of the whole mesh.
    free : (Q,) nodes inside that are not on a moving, fixed or sliding patch.
    following : what follows the boundary nearby; None if nothing is to.
    tied, tied_sliding : images of one another among the free nodes, and among those that slide.
    """

    boundary: PrescribedNodes
    region: BoxNodes
    sites: Sites
    points: FloatArray = field(repr=False)
    free: IntArray = field(repr=False)
    following: Following | None
    tied: Images = field(repr=False)
    tied_sliding: Images = field(repr=False)

    @classmethod
    def of(cls, boundary: PrescribedNodes, region: BoxNodes, sites: Sites, points: FloatArray) -> "StepStart":
        """Build the state at the start of a step from the node coordinates `points` (N, 3)."""
        free = np.setdiff1d(region.inside, sites.known, assume_unique=True)
        following = Following.of(boundary, sites, points, free) if boundary.job.near_wall else None
        tied = boundary.images.among(free), boundary.images.among(sites.slid)
        return cls(boundary, region, sites, points, free, following, *tied)

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
        beside = [self.free[self.following.layers.rows]] if self.following else []
        nodes = [sites.moving[sites.distinct], sites.fixed[sites.sampled], *beside, *slid]
        components = self.boundary.components
        moving = DataSites(self.points[np.concatenate(nodes)], values[:, components], components)
        return GROUPINGS[self.fitting.strategy]([moving, *sites.zero])

    def values(self, move: FloatArray, slid: FloatArray | None = None) -> FloatArray:
        """Return the displacements (S, 3) of the known points, given those of moving (K, 3) and sliding nodes."""
        parts = [move[self.sites.distinct], np.zeros((len(self.sites.sampled), 3))]
        if self.following:
            boundary = self.boundary_values(move)
            parts.append(self.following.layers.displaced(boundary, self.following.turning.rotations(boundary)))
        return np.vstack(parts if slid is None else [*parts, slid[self.sites.sampled_sliding]])

    def turns(self, boundary: FloatArray) -> FloatArray | None:
        """Return the rotations less the identity (B, 3, 3) of `sites.known`, displaced by (B, 3); None without use."""
        return self.following.turning.rotations(boundary) if self.following else None

    def boundary_values(self, move: FloatArray, slid: FloatArray | None = None) -> FloatArray:
        """Return the displacements of `sites.known`, given those of moving (K, 3) and sliding nodes; None: zero."""
        slid = np.zeros((len(self.sites.slid), 3)) if slid is None else slid
        return np.vstack([move, np.zeros((len(self.sites.fixed), 3)), slid])

    def free_displacement(self, values: FloatArray, turns: FloatArray | None, interpolated: FloatArray) -> FloatArray:
        """Return the displacement (Q, 3) of the free nodes.

        Parameters
        ----------
        values, turns : Displacements (B, 3) and rotations less the identity (B, 3, 3) of `sites.known`.
        interpolated : (Q, 3) of the interpolant at the free nodes.
        """
        out = np.array(interpolated)
        if self.following and turns is not None:
            out = self.following.free.following(interpolated, values, turns)
        for section, nodes in self.region.sections:
            out[np.isin(self.free, nodes, assume_unique=True), section.component] = 0.0
        return self.tied.projected(out)

    def carried(self, displacement: FloatArray, boundary: FloatArray, turns: FloatArray | None) -> FloatArray:
        """Let sliding nodes (L, 3) follow the moving and fixed ones nearby."""
        if self.following is None or turns is None:
            return displacement
        return self.following.sliding.following(displacement, boundary, turns)

    def slid(self, move: FloatArray, interpolated: FloatArray) -> FloatArray:
        """Return the displacement (L, 3) of the sliding nodes, given the interpolant's: on their shapes."""
        boundary = self.boundary_values(move)
        return _on_shapes(self, self.carried(interpolated, boundary, self.turns(boundary)))

    def carried_out(self, move: FloatArray, interpolation: Interpolation) -> tuple[FloatArray, FloatArray]:
        """Carry out the step: moving nodes (K, 3) go by `move`, sliding ones stay on their shapes, all others follow.

        Returns the displacements (L, 3) of the sliding nodes, and where all nodes (N, 3) come to be.
        """
        slid = None
        if len(self.sites.slid):
            slid = self.slid(move, interpolation.of_sliding(self.values(move)))
        displacement = interpolation.of_free(self.values(move, slid))
        points, boundary = self.points.copy(), self.boundary_values(move, slid)
        if boundary.any():
            points[self.free] += self.free_displacement(boundary, self.turns(boundary), displacement)
            points[self.sites.known] += boundary
        return (NO_NODES if slid is None else slid), points


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
    off : (B, 3) from where the interpolant puts `sites.known` to where they are put.
    points : (N, 3) coordinates at the end of the step.
    evaluation_seconds : time to evaluate the interpolant at the free nodes.
    """

    state: StepStart = field(repr=False)
    move: FloatArray = field(repr=False)
    first: Fits | None
    fits: Fits
    slid: FloatArray = field(repr=False)
    off: FloatArray = field(repr=False)
    points: FloatArray = field(repr=False)
    evaluation_seconds: float

    @property
    def correction(self) -> float:
        """Largest distance of a boundary node from its place before it was put there."""
        return float(np.linalg.norm(self.off, axis=1).max())

    @property
    def error(self) -> float:
        """Largest error at any data site, of both fits."""
        return max(fits.error for fits in (self.first, self.fits) if fits)


class Way(Protocol):
    """How interpolants find their centres."""

    @property
    def start(self) -> StepStart | None:
        """The start of the step, where it is known already."""

    def fits(self, state: StepStart, values: FloatArray, sliding: bool) -> Fits:
        """Fit displacements (S, 3) of the known points; `sliding`: whether the sliding nodes are among these."""


class FittedStep:
    """Interpolants that are fitted when they are asked for, and kept."""

    first: Fits | None = None
    all: Fits
    seconds: float

    def __init__(self, state: StepStart, way: Way, runner: Runner) -> None:
        self.state, self.way, self.runner = state, way, runner

    def of_sliding(self, values: FloatArray) -> FloatArray:
        """See `Interpolation`."""
        self.first = self.way.fits(self.state, values, False)
        return self.first.interpolant(self.state.points[self.state.sites.slid])

    def of_free(self, values: FloatArray) -> FloatArray:
        """See `Interpolation`."""
        self.all = self.way.fits(self.state, values, self.first is not None)
        interpolant = self.all.interpolant
        interpolant(self.state.points[:1])  # loads compiled code: not part of the evaluation's time
        start = perf_counter()
        displacement = evaluated(interpolant, self.state.points[self.state.free], self.runner)
        self.seconds = perf_counter() - start
        return displacement


def solve(state: StepStart, move: FloatArray, way: Way, runner: Runner = HERE) -> Step:
    """Carry out one step, by which the moving nodes (K, 3) go by `move`."""
    fitted = FittedStep(state, way, runner)
    slid, points = state.carried_out(move, fitted)
    off = state.boundary_values(move, slid) - fitted.all.interpolant(state.points[state.sites.known])
    return Step(state, move, fitted.first, fitted.all, slid, off, points, fitted.seconds)


def initial_centers(group: DataSites, surface: int, count: tuple[int, int]) -> IntArray:
    """Return the rows of the initial centres: so many of the first `surface` sites and of the others."""
    moving, others = group.points[:surface], group.points[surface:]
    return np.concatenate([farthest(moving, count[0]), surface + farthest(others, count[1])])


@dataclass(frozen=True, slots=True, eq=False)
class Adapting:
    """Centres are added until every site is within the tolerance.

    The centres and factors of an earlier step come first: every site is checked all the same.
    """

    progress: Progress
    earlier: Step | None = None

    @property
    def start(self) -> StepStart | None:
        """The start of the earlier step."""
        return self.earlier.state if self.earlier else None

    def fits(self, state: StepStart, values: FloatArray, sliding: bool) -> Fits:
        """See `Way`."""
        groups, earlier = state.groups(values, sliding), self.earlier
        known = (earlier.fits if sliding or not earlier.first else earlier.first).factors if earlier else None
        pairs = zip(groups, known or (None,) * len(groups), strict=True)
        return Fits(tuple(_adapted(state, *pair, self.progress) for pair in pairs))


@dataclass(frozen=True, slots=True, eq=False)
class OnCenters:
    """Exactly the centres and factors of an earlier step serve for other displacements."""

    earlier: Step

    @property
    def start(self) -> StepStart:
        """The start of the earlier step."""
        return self.earlier.state

    def fits(self, state: StepStart, values: FloatArray, sliding: bool) -> Fits:
        """See `Way`."""
        earlier = self.earlier.fits if sliding or not self.earlier.first else self.earlier.first
        with single_threaded_blas():
            groups = zip(state.groups(values, sliding), earlier.factors, earlier.adaptations, strict=True)
            return Fits(tuple(_solved(factor.with_values(one.values), fit.stop) for one, factor, fit in groups))


def _adapted(state: StepStart, group: DataSites, known: CholeskyBasis | None, progress: Progress) -> Adaptation:
    """Adapt the centres of one group of directions, from those of a known basis if there is one.

    Raises InputError, which blames the radius of a kernel that has one, for a system that cannot be solved.
    """
    fitting, tolerance = state.fitting, state.sites.tolerance
    options = GreedyOptions(
        n_add=fitting.n_add, tol_add=tolerance, tol_stop=tolerance, max_centers=fitting.max_centers,
        polynomial=fitting.polynomial,
    )  # fmt: skip
    counts, names = (
        (fitting.initial_surface, fitting.initial_hexahedron),
        "".join(DIRECTIONS[c] for c in group.components),
    )
    try:
        return adapt(
            group,
            state.sites.kernel,
            known.chosen if known else initial_centers(group, len(state.sites.distinct), counts),
            options,
            rule=RULES[fitting.rule],
            basis=(lambda problem, _: known.with_values(problem.values)) if known else CholeskyBasis.of,
            progress=lambda text, fraction: progress(f"{names}: {text}", fraction),
        )
    except SolveError as error:
        if not state.sites.radius:
            raise
        given = f"kernel = {fitting.kernel} with kernel_radius = {state.sites.radius:.4g}"
        remedy = "A smaller radius makes the system better conditioned"
        raise InputError(f"{state.boundary.mesh.name}: {given}: {error} {remedy}") from None


def _solved(basis: CholeskyBasis, stop: Stop) -> Adaptation:
    """Return the interpolant on the centres of a basis, without a history."""
    problem = basis.kernel.problem
    interpolant = problem.interpolant(basis.chosen, basis.refined())
    return Adaptation(interpolant, problem.sites.components, basis.chosen, (), stop, np.nan, basis)


def _on_shapes(state: StepStart, displacement: FloatArray) -> FloatArray:
    """Put sliding nodes (L, 3) on their shapes, as images of one another; those on several, on one after another."""
    for surface, rows, points in _rounds(state):
        displacement[rows] = surface.projected(points, displacement[rows])
        displacement = state.tied_sliding.projected(displacement)
    return state.tied_sliding.projected(displacement)


def _rounds(state: StepStart) -> list[tuple[SlidingSurface, IntArray, FloatArray]]:
    """Return each shape with the rows and points of the sliding nodes on it, once, or in turn if there are several.

    Those that are also on a section stay in its plane as well.
    """
    slid, patches = state.sites.slid, state.boundary.sliding
    shapes = [*zip((patch.surface for patch in patches), state.sites.sliding, strict=True)]
    for section, nodes in state.region.sections:
        both = np.intersect1d(nodes, slid, assume_unique=True)
        shapes += [(Plane(section.point, np.eye(3)[section.component]), both)] * bool(len(both))
    one = [(surface, np.searchsorted(slid, nodes), state.points[nodes]) for surface, nodes in shapes]
    return one * (ROUNDS if len(one) + bool(len(state.tied_sliding.nodes)) > 1 else 1)
