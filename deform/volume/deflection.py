"""A plan of all that is decided before anything is fitted, and the mesh at one angle or at many."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import nan
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.base.sets import union
from sdm_deflect.deform.base.threads import single_threaded_blas
from sdm_deflect.deform.mesh.faces import BoundaryGaps
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.orthogonality import State, TouchedFaces
from sdm_deflect.deform.mesh.pieces import HERE, Runner
from sdm_deflect.deform.mesh.precision import EVERY_BIT, Precision
from sdm_deflect.deform.mesh.quality import Quality
from sdm_deflect.deform.mesh.sliding import SlidingSurface
from sdm_deflect.deform.mesh.touched import Least, TouchedCells
from sdm_deflect.deform.repair.columns import Columns
from sdm_deflect.deform.repair.freedom import FreeNodes
from sdm_deflect.deform.repair.goal import RepairResult
from sdm_deflect.deform.repair.repair import repaired
from sdm_deflect.deform.surface.motions import Moving
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.volume.between import ErrorBetween
from sdm_deflect.deform.volume.boundary import Amounts, PrescribedNodes
from sdm_deflect.deform.volume.job import Job, prepared
from sdm_deflect.deform.volume.region import ON_FACE, BoxNodes, check_disjoint
from sdm_deflect.deform.volume.sites import Sites
from sdm_deflect.deform.volume.step import Step, StepStart, adapted, rate, solve


class Planned:
    """What is decided before anything is fitted: of one box (`Plan`), or of several (`Plans`)."""

    if TYPE_CHECKING:  # of both, as fields or as properties

        @property
        def boxes(self) -> "tuple[Plan, ...]": ...  # noqa: D102
        @property
        def touched(self) -> TouchedCells: ...  # noqa: D102
        @property
        def before(self) -> tuple[Quality, ...]: ...  # noqa: D102
        @property
        def angles(self) -> tuple[float, ...]: ...  # noqa: D102
        @property
        def runner(self) -> Runner: ...  # noqa: D102
        @property
        def precision(self) -> Precision: ...  # noqa: D102
        def keeping(self, precision: Precision, runner: Runner | None = None) -> "Planned": ...  # noqa: D102

    @property
    def mesh(self) -> Mesh:
        """The mesh."""
        return self.touched.mesh

    @property
    def job(self) -> Job:
        """What is asked of the first box."""
        return self.boxes[0].boundary.job

    @property
    def angle(self) -> float:
        """Amount of the first surface."""
        return self.job.angle

    @property
    def patches(self) -> tuple[str, ...]:
        """Names of the moving patches, the control surface's first."""
        return tuple(name for _, surface in self.moving for name in surface.patches)

    @property
    def moving(self) -> tuple[tuple[Moving, Surface], ...]:
        """What is asked of each moving surface, and the surface."""
        pairs = (zip(box.boundary.job.surfaces, box.boundary.surfaces, strict=True) for box in self.boxes)
        return tuple(pair for some in pairs for pair in some)

    @property
    def surface(self) -> str:
        """Name of the first moving patch: the control surface."""
        return self.patches[0]

    @property
    def stays(self) -> tuple[str, ...]:
        """Names of the patches that stay, whatever box they are in."""
        moving = self.patches
        names = dict.fromkeys(name for box in self.boxes for name in box.boundary.fixed)
        return tuple(name for name in names if name not in moving)

    @property
    def changed(self) -> IntArray:
        """Sorted indices of all nodes that may move."""
        return union(*(nodes for box in self.boxes for nodes in (box.region.inside, box.sites.moving)))

    @property
    def fixed(self) -> IntArray:
        """Sorted indices of the fixed nodes inside."""
        return union(*(box.sites.fixed for box in self.boxes))

    @property
    def walls(self) -> IntArray:
        """Sorted indices of the moving and fixed nodes inside."""
        return union(*(nodes for box in self.boxes for nodes in (box.sites.moving, box.sites.fixed)))

    def amounts_at(self, angle: float) -> Amounts:
        """Return the amount of each moving surface of all boxes when the first one's is `angle`."""
        return tuple(amount for box in self.boxes for amount in box.job.amounts_at(self.angle_of(box, angle)))

    def angle_of(self, box: "Plan", angle: float) -> float:
        """Return the amount of the first surface of a box when that of all is `angle`."""
        return box.job.beside(self.job, angle)

    @cached_property
    def undeflected(self) -> FloatArray:
        """Coordinates (N, 3) of the mesh before, as the file that is to be written holds them."""
        return self.precision.rounded(self.mesh.points, self.mesh.points)

    def least(self, points: FloatArray, quality: Sequence[Quality]) -> tuple[Least, ...]:
        """Return, by type, the least quality of the touched cells that are good in the undeflected mesh.

        Parameters
        ----------
        points : (N, 3) where the nodes are.
        quality : By type, of all touched cells there.
        """
        if all(one.min > 0.0 and not one.inverted for one in self.before):
            return tuple(Least(one.min, one.cells) for one in quality)
        return self.touched.least(points)

    @cached_property
    def unheld(self) -> BoundaryGaps:
        """What patches miss of the boundary where nodes may move, and what they hold beside it."""
        return BoundaryGaps.of(self.touched, self.changed, self.patches)

    @cached_property
    def faces(self) -> TouchedFaces | None:
        """The faces of touched cells as OpenFOAM's checkMesh measures them; None without polyhedra."""
        return TouchedFaces.of(self.touched)


@dataclass(frozen=True, eq=False)
class Plan(Planned):
    """The nodes that move, the box, the sites and the cells touched, for all angles of a job.

    Attributes
    ----------
    boundary, region, sites : nodes of known displacement, the box, and where displacements are interpolated.
    touched : the cells that may change.
    before : their quality, by type, as the mesh is.
    angles : amounts of the job's first surface that the box holds.
    runner : who evaluates the interpolant.
    precision : how the file that is to be written keeps coordinates.
    """

    boundary: PrescribedNodes
    region: BoxNodes
    sites: Sites
    touched: TouchedCells = field(repr=False)
    before: tuple[Quality, ...]
    angles: tuple[float, ...]
    runner: Runner = HERE
    precision: Precision = EVERY_BIT

    @classmethod
    def of(cls, mesh: Mesh, job: Job, angles: Sequence[float] = (), progress: Progress = silent) -> "Plan":
        """Decide motion, box and sites for the job's own angle, or for several, and judge the mesh as it is.

        The plan's mesh has the selections of the job as patches. Raises InputError if the job does not suit the mesh.
        """
        return cls.on(prepared(mesh, (job,)), job, angles, progress)

    @classmethod
    def on(cls, mesh: Mesh, job: Job, angles: Sequence[float] = (), progress: Progress = silent) -> "Plan":
        """Return the plan for a mesh which has the selections of the job as patches already (`prepared`)."""
        wanted = tuple(angles) or (job.angle,)
        progress("surfaces", nan)
        boundary = PrescribedNodes.of(mesh, job)
        progress("box", nan)
        try:
            region = BoxNodes.of(boundary, job.ends(wanted))
        except InputError as error:
            notes = [note for placement in boundary.placements for note in placement.notes()]
            raise InputError("; ".join([str(error), *notes])) from None
        sites = Sites.of(boundary, region)
        progress("cells", nan)
        touched = TouchedCells.of(boundary.mesh, union(region.inside, sites.moving))
        touched.check(job.allow_inverted)
        return cls(boundary, region, sites, touched, touched.quality(mesh.points), wanted)

    @property
    def boxes(self) -> "tuple[Plan, ...]":
        """The plan alone: it is of one box."""
        return (self,)

    def keeping(self, precision: Precision, runner: Runner | None = None) -> "Plan":
        """Return it for a file that keeps coordinates so, and perhaps with others to evaluate the interpolants."""
        return replace(self, precision=precision, runner=runner or self.runner)

    def freedom(self, points: FloatArray) -> FreeNodes:
        """Return which nodes a repair may move, with the mesh at `points` (N, 3), and on what they stay.

        Nodes on a face of a cell that is on no patch stay, for other zones may fit to them, and so do nodes of moving
        patches beyond the box. Layers keep their heights, and images of one another move alike.
        """
        mesh, job = self.mesh, self.job
        shapes: dict[str, SlidingSurface | str] = {}
        for one in job.repair_slides:
            shapes |= dict.fromkeys(mesh.named([one.patch], "repair_slides"), one.shape)
        for section in job.sections:
            if section.slides:
                shapes[section.patch] = "plane"
        shapes |= {one.patch: one.surface for one in self.boundary.sliding}
        inside = np.zeros(len(mesh.points), dtype=np.bool_)
        moving, size = self.sites.moving, self.boundary.size
        inside[self.region.inside] = True
        inside[moving] = self.region.hexahedron.contains(mesh.points[moving], ON_FACE * size)
        inside[np.setdiff1d(self.sites.fixed, mesh.on(*shapes), assume_unique=True)] = inside[self.unheld.nodes] = False
        bound = (*self.boundary.pairs, *self.boundary.sides)
        free = inside.copy()
        free[mesh.on(*(name for name in mesh.names if name not in bound))] = False
        free = self.boundary.images.complete(free)
        images = self.boundary.images.within(free)
        inside[np.setdiff1d(self.boundary.images.nodes, images.nodes, assume_unique=True)] = False
        found = FreeNodes.of(mesh, points, inside, np.flatnonzero(free), shapes, images)
        return found.with_columns(Columns.of(self.touched, self.walls), points)

    def share(self, angle: float, k: int, count: int) -> Amounts:
        """Return the amounts after k of so many equal steps to an angle."""
        return tuple(amount * k / count for amount in self.job.amounts_at(angle))

    def state(self, points: FloatArray) -> StepStart:
        """Return the start of a step with the mesh at `points` (N, 3)."""
        return StepStart.of(self.boundary, self.region, self.sites, points)


@dataclass(frozen=True, eq=False)
class Plans(Planned):
    """The plans of several boxes of one mesh, which do not overlap: each starts from the undeflected mesh.

    Attributes
    ----------
    boxes : the plan of each box; at least one.
    """

    boxes: tuple[Plan, ...]

    @classmethod
    def of(cls, mesh: Mesh, jobs: Sequence[Job], angles: Sequence[float] = (), progress: Progress = silent) -> Planned:
        """Plan every job, for its own angle or for what it is at several of the first one's; of one job its plan.

        Raises InputError if a job does not suit the mesh, or two boxes overlap.
        """
        mesh, first = prepared(mesh, jobs), jobs[0]
        shares = [[job.beside(first, angle) for angle in angles] for job in jobs]
        boxes = tuple(Plan.on(mesh, job, own, progress) for job, own in zip(jobs, shares, strict=True))
        check_disjoint([(box.surface, box.region.hexahedron) for box in boxes], first.box.settings)
        return cls(boxes) if len(boxes) > 1 else boxes[0]

    @cached_property
    def touched(self) -> TouchedCells:
        """The cells that may change."""
        rows = zip(*(box.touched.rows for box in self.boxes), strict=True)
        return replace(self.boxes[0].touched, rows=tuple(union(*own) for own in rows))

    @cached_property
    def before(self) -> tuple[Quality, ...]:
        """Their quality, by type, as the mesh is."""
        return self.touched.quality(self.mesh.points)

    @property
    def angles(self) -> tuple[float, ...]:
        """Amounts of the first surface that its box holds."""
        return self.boxes[0].angles

    @property
    def runner(self) -> Runner:
        """Who evaluates the interpolants."""
        return self.boxes[0].runner

    @property
    def precision(self) -> Precision:
        """How the file that is to be written keeps coordinates."""
        return self.boxes[0].precision

    def keeping(self, precision: Precision, runner: Runner | None = None) -> "Plans":
        """Return it for a file that keeps coordinates so, and perhaps with others to evaluate the interpolants."""
        return Plans(tuple(box.keeping(precision, runner) for box in self.boxes))


class Deflected:
    """The mesh at one angle: deflected in one box (`Deflection`), or in several (`Deflections`)."""

    if TYPE_CHECKING:  # of both, as fields or as properties

        @property
        def plan(self) -> Planned: ...  # noqa: D102
        @property
        def boxes(self) -> "tuple[Deflection, ...]": ...  # noqa: D102
        @property
        def angle(self) -> float: ...  # noqa: D102
        @property
        def points(self) -> FloatArray: ...  # noqa: D102
        @property
        def inverted(self) -> int: ...  # noqa: D102
        @property
        def seconds(self) -> float: ...  # noqa: D102
        def stored(self, precision: Precision) -> "Deflected": ...  # noqa: D102

    @property
    def amounts(self) -> Amounts:
        """Amount of each moving surface."""
        return self.plan.amounts_at(self.angle)

    @property
    def repairs(self) -> tuple[RepairResult, ...]:
        """The repairs of the boxes that needed one."""
        return tuple(box.repaired for box in self.boxes if box.repaired)

    @cached_property
    def quality(self) -> tuple[Quality, ...]:
        """Quality of the touched cells by type."""
        return self.plan.touched.quality(self.points)

    @cached_property
    def least(self) -> tuple[tuple[Least, Least], ...]:
        """Least quality before and now, by type, of the touched cells that were good before."""
        plan = self.plan
        states = ((plan.mesh.points, plan.before), (self.points, self.quality))
        return tuple(zip(*(plan.least(*state) for state in states), strict=True))

    @cached_property
    def faces(self) -> State | None:
        """What was measured of the faces of touched cells as OpenFOAM's checkMesh does; None without polyhedra."""
        return self.plan.faces.at(self.points) if self.plan.faces else None

    @property
    def moved_by_repair(self) -> FloatArray | None:
        """How far (N, 3) repairs moved each node from where the interpolants put it; None without a repair."""
        if not self.repairs:
            return None
        return np.asarray(np.sum([box.points - box.interpolated for box in self.boxes], axis=0))

    def sensitivity(self) -> FloatArray:
        """Return d(points)/d(angle) (N, 3) in length units per unit of the amount, from the same centres.

        With several steps it is the derivative with respect to the end of the last one.

        Raises InputError for a repaired mesh: a repair ends where cells are good enough, which has no derivative.
        """
        if self.repairs:
            raise InputError(
                f"{self.plan.mesh.name}: the mesh at {self.angle:g} was repaired, and a repair ends where cells are "
                "good enough: it has no derivative; set repair = off for the sensitivity"
            )
        first, job = self.boxes[0], self.plan.job
        rates = rate(first.steps[-1], first.plan.boundary.rate(first.amounts, job.ratios))
        for box in self.boxes[1:]:
            own = tuple(ratio * box.plan.job.beside(job, 1.0) for ratio in box.plan.job.ratios)
            changed = box.plan.changed
            rates[changed] = rate(box.steps[-1], box.plan.boundary.rate(box.amounts, own))[changed]
        return rates


@dataclass(frozen=True, eq=False)
class Deflection(Deflected):
    """The mesh at one angle and how it got there.

    Attributes
    ----------
    plan : what was decided before.
    angle : the first surface's amount.
    steps : the solves, one unless a single step inverted further cells.
    points : (N, 3) deflected coordinates, as the file that is to be written holds them (`Plan.precision`); outside the
        box they are those of `Plan.undeflected`.
    inverted : number of touched cells that are inverted at the end and were not before.
    seconds : time it took.
    repaired : the repair, where one was needed.
    """

    plan: Plan = field(repr=False)
    angle: float
    steps: tuple[Step, ...] = field(repr=False)
    points: FloatArray = field(repr=False)
    inverted: int
    seconds: float
    repaired: RepairResult | None = field(default=None, repr=False)

    @property
    def boxes(self) -> "tuple[Deflection, ...]":
        """The deflection alone: it is of one box."""
        return (self,)

    @property
    def exact(self) -> FloatArray:
        """Coordinates (N, 3) before they were rounded to those of the file."""
        return self.steps[-1].points if self.repaired is None else self.repaired.points

    def with_points(self, points: FloatArray) -> "Deflection":
        """Return it with other points (N, 3), rounded to those of the file; unchanged if they are its own."""
        rounded = self.plan.precision.rounded(points, self.plan.mesh.points)
        if rounded is self.points:
            return self
        return replace(self, points=rounded, inverted=inverted_count(self.plan, rounded))

    def stored(self, precision: Precision) -> "Deflection":
        """Return the same deflection as another file holds it."""
        return replace(self, plan=self.plan.keeping(precision)).with_points(self.exact)

    @property
    def interpolated(self) -> FloatArray:
        """Coordinates (N, 3) as the interpolants alone have them, without the repair."""
        return self.points if self.repaired is None else self.repaired.start

    @cached_property
    def error_between(self) -> ErrorBetween | None:
        """Error of the interpolants on the moving surfaces between their nodes; None for surfaces without faces."""
        return ErrorBetween.of(self.plan.boundary, self.steps, self.plan.boundary.displacement(self.amounts))

    @cached_property
    def conditions(self) -> tuple[float, ...]:
        """Condition of each group of directions, the largest of all steps; none if its factors are not at hand."""
        with single_threaded_blas():
            of_steps = [[factor.condition() for factor in step.fits.factors] for step in self.steps]
        return tuple(map(max, zip(*of_steps, strict=True)))


@dataclass(frozen=True, eq=False)
class Deflections(Deflected):
    """The mesh at one angle, deflected in several boxes, of which none reaches into another.

    Attributes
    ----------
    boxes : the deflection in each box, from the undeflected mesh.
    angle : the first surface's amount.
    """

    boxes: tuple[Deflection, ...] = field(repr=False)
    angle: float

    @classmethod
    def of(cls, boxes: Sequence[Deflection]) -> Deflected:
        """Return the deflections of disjoint boxes of one mesh together; that of one box as it is."""
        return cls(tuple(boxes), boxes[0].angle) if len(boxes) > 1 else boxes[0]

    @cached_property
    def plan(self) -> Plans:
        """What was decided before."""
        return Plans(tuple(box.plan for box in self.boxes))

    @cached_property
    def points(self) -> FloatArray:
        """Deflected coordinates (N, 3): of each box its own."""
        points = self.plan.undeflected.copy()
        for box in self.boxes:
            changed = box.plan.changed
            points[changed] = box.points[changed]
        return points

    @cached_property
    def inverted(self) -> int:
        """Number of touched cells that are inverted at the end and were not before."""
        return inverted_count(self.plan, self.points)

    @property
    def seconds(self) -> float:
        """Time it took."""
        return sum(box.seconds for box in self.boxes)

    def stored(self, precision: Precision) -> "Deflections":
        """Return the same deflections as another file holds them."""
        return replace(self, boxes=tuple(box.stored(precision) for box in self.boxes))


def deflect(plan: Plan, angle: float, progress: Progress = silent, earlier: Deflection | None = None) -> Deflection:
    """Bring the mesh to an angle; the angle is halved into steps while cells are inverted that were not before.

    If no number of steps does, the one with the fewest such cells is the result. A single step uses the centres
    and factors of an earlier deflection of a single step.
    """
    reused = earlier.steps[0] if earlier is not None and len(earlier.steps) == 1 else None
    best = mended(adapted_steps(plan, angle, 1, progress, reused), progress)
    count = 2
    while best.inverted and count <= plan.job.fitting.max_steps:
        again = mended(adapted_steps(plan, angle, count, progress), progress)
        best = min(best, again, key=lambda one: one.inverted)
        count *= 2
    return best


def deflected(plan: Planned, angle: float, progress: Progress = silent, earlier: Deflected | None = None) -> Deflected:
    """Bring the mesh to an angle of the first surface in every box, as `deflect` does in one."""
    known = earlier.boxes if earlier else [None] * len(plan.boxes)
    pairs = zip(plan.boxes, known, strict=True)
    return Deflections.of([deflect(box, plan.angle_of(box, angle), progress, one) for box, one in pairs])


def mended(deflection: Deflection, progress: Progress = silent) -> Deflection:
    """Return a deflection whose spoiled cells are repaired, where its job wants that and there are any."""
    plan, wanted = deflection.plan, deflection.plan.job.repair
    if not is_spoiled(deflection):
        return deflection
    found = repaired(deflection.points, plan.touched, plan.freedom(deflection.points), wanted.wanted, progress)
    seconds = deflection.seconds + found.seconds
    after = replace(deflection, points=found.points, inverted=len(found.inverted), seconds=seconds, repaired=found)
    return after.with_points(found.points)


def is_spoiled(deflection: Deflection) -> bool:
    """True if the job of a deflection wants its mesh repaired, and there is something to repair."""
    plan, wanted = deflection.plan, deflection.plan.job.repair
    if wanted.mode == "off" or not plan.touched.count:
        return False
    fell = any(old.cells and new.quality < wanted.wanted * old.quality for old, new in deflection.least)
    return fell or deflection.inverted > 0


def as_repaired(deflection: Deflection, repair: FloatArray) -> Deflection:
    """Return a deflection whose repair is known: how far it moved each node (N, 3); nothing is repaired anew."""
    if not is_spoiled(deflection):
        return deflection
    plan, points = deflection.plan, deflection.points.copy()
    points[plan.changed] += repair[plan.changed]
    freedom = plan.freedom(deflection.points)
    found = RepairResult.of(deflection.points, points, plan.touched, freedom, plan.job.repair.wanted)
    return replace(deflection, points=points, inverted=len(found.inverted), repaired=found)


def sweep(plan: Planned, angles: Sequence[float], progress: Progress = silent) -> Iterator[tuple[int, Deflected]]:
    """Bring the mesh to several angles, the largest first: its centres and factors serve for all of them.

    Each angle is checked at every data site; centres are added where one is off by more than the tolerance.

    Yields
    ------
    The place of the angle in `angles`, and the deflection.
    """
    largest = max(range(len(angles)), key=lambda i: abs(angles[i]))
    reusable: dict[int, Deflection] = {}
    for i in (largest, *(i for i in range(len(angles)) if i != largest)):
        found = []
        for k, box in enumerate(plan.boxes):
            found.append(deflect(box, plan.angle_of(box, angles[i]), progress, reusable.get(k)))
            if len(found[-1].steps) == 1:
                reusable[k] = found[-1]
        yield i, Deflections.of(found)


def stepped(plan: Plan, angle: float, count: int, take: Callable[[int, FloatArray, FloatArray], Step]) -> Deflection:
    """Go to an angle in `count` equal steps, each from where the last one ended.

    `take` carries out a step, given its number from 1, the points (N, 3) at its start, and how far (K, 3) the moving
    nodes go.
    """
    begin, nodes = perf_counter(), plan.sites.moving
    points, steps, reached = plan.mesh.points, [], np.zeros((len(nodes), 3))
    for k in range(1, count + 1):
        target = plan.boundary.displacement(plan.share(angle, k, count))
        steps.append(take(k, points, target - reached))
        points, reached = steps[-1].points, target
    points[nodes] = plan.mesh.points[nodes] + reached  # the places asked for, without the rounding of the steps
    points = plan.precision.rounded(points, plan.mesh.points)
    return Deflection(plan, angle, tuple(steps), points, inverted_count(plan, points), perf_counter() - begin)


def adapted_steps(plan: Plan, angle: float, count: int, progress: Progress, earlier: Step | None = None) -> Deflection:
    """Go to the angle in `count` steps, on centres adapted to each; on those of an earlier step first."""

    def take(_: int, points: FloatArray, move: FloatArray) -> Step:
        state = earlier.state if earlier else plan.state(points)
        return solve(state, move, adapted(state, progress, earlier), plan.runner)

    return stepped(plan, angle, count, take)


def inverted_count(plan: Planned, points: FloatArray) -> int:
    """Return how many touched cells are inverted with the mesh at `points` (N, 3) and were not before."""
    return int(np.count_nonzero(plan.touched.newly_inverted(points)))
