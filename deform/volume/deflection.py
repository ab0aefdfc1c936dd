"""The mesh at one pose, and the error of the interpolants between their sites."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import Progress, silent, single_threaded_blas
from sdm_deflect.deform.rbf.interpolant import SolveError
from sdm_deflect.meshing.mesh.affected import AffectedCells, Least
from sdm_deflect.meshing.mesh.cells import Polygons
from sdm_deflect.meshing.mesh.edges import are_lines, edges_of, polygons_of
from sdm_deflect.meshing.mesh.precision import Precision
from sdm_deflect.meshing.mesh.quality import Quality
from sdm_deflect.meshing.repair.region import RepairResult
from sdm_deflect.meshing.repair.repair import repair_cells

from .boundary import PrescribedMotion
from .job import Amounts
from .plan import BoxPlan, Plan
from .sites import Sites
from .step import Step, take
from .step_rates import StepRates

if TYPE_CHECKING:
    from sdm_deflect.meshing.mesh.orthogonality import State

# Step of the fourth-order difference, in degrees or as a share of a table; relative error of the derivative 1e-11.
DEGREES, SHARE = 0.05, 1e-3
# A worst cell is poor if newly below this quality, or below this share of its own quality before.
POOR, POOR_SHARE = 0.1, 0.5
# Largest number of sample points; larger sets are thinned evenly.
MOST_MIDPOINTS = 20_000


@dataclass(frozen=True, slots=True)
class ErrorBetween:
    """Error of the interpolants between the data sites, a length: the largest of the directions.

    Attributes
    ----------
    max, p99 : the largest error, and its 99th percentile.
    points : number of sample points.
    """

    max: float
    p99: float
    points: int

    @classmethod
    def of(cls, boundary: PrescribedMotion, steps: Sequence[Step], displacement: FloatArray) -> "ErrorBetween | None":
        """Measure a deflection, given the displacement (K, 3) of its moving nodes; None for surfaces without faces.

        The reference displacement of a midpoint is the mean of its corners': exact for a rotation. For motions that
        bend a face, the error includes the bending.
        """
        faces = boundary.mesh.faces_of(boundary.moving)
        corners = _corners(polygons_of(faces))
        if not len(corners):
            return None
        start = _means(boundary.mesh.points, corners)
        places = start.copy()
        for step in steps:
            places += step.fits.interpolant(places)
        moved = np.zeros_like(boundary.mesh.points)
        moved[boundary.nodes] = displacement
        off = np.abs(places - start - _means(moved, corners)).max(axis=1)
        return cls(float(off.max()), float(np.quantile(off, 0.99)), len(off))


def _corners(faces: Polygons) -> Polygons:
    """Return the corners of each edge and each face; more than `MOST_MIDPOINTS` in all are thinned evenly."""
    edges = np.empty((0, 2), dtype=np.intp) if are_lines(faces) else np.sort(edges_of(faces)[0], axis=1)
    edges = np.unique(edges, axis=0)
    sizes = np.concatenate([np.full(len(edges), 2), np.diff(faces.offsets)])
    nodes = np.concatenate([edges.ravel(), faces.nodes])
    chosen = np.arange(0, len(sizes), max(1, -(-len(sizes) // MOST_MIDPOINTS)))
    starts = (np.cumsum(sizes) - sizes)[chosen]
    offsets = np.concatenate([[0], np.cumsum(sizes[chosen])])
    rows = np.arange(offsets[-1]) + np.repeat(starts - offsets[:-1], sizes[chosen])
    return Polygons(nodes[rows], offsets.astype(np.intp))


def _means(values: FloatArray, corners: Polygons) -> FloatArray:
    """Return the mean (P, 3) of values (N, 3) over the corners of each edge or face."""
    sums = np.add.reduceat(values[corners.nodes], corners.offsets[:-1], axis=0)
    return np.asarray(sums / np.diff(corners.offsets)[:, None])


@dataclass(frozen=True, eq=False)
class BoxDeflection:
    """The mesh at given amounts of the surfaces of one box.

    Attributes
    ----------
    plan : the plan of the box.
    amounts : amounts of the moving surfaces.
    steps : its steps; several if one step inverted cells.
    exact : (N, 3) deflected coordinates; outside the box they are those of the mesh.
    seconds : time it took.
    repaired : the repair; None without.
    fitted_at : amounts for which the steps were fitted; None for `amounts`.
    residual : largest error at a data site; None to take it from the steps.
    image_of : the deflection in another box whose reflection this is; None without.
    """

    plan: BoxPlan = field(repr=False)
    amounts: Amounts
    steps: tuple[Step, ...] = field(repr=False)
    exact: FloatArray = field(repr=False)
    seconds: float
    repaired: RepairResult | None = field(default=None, repr=False)
    fitted_at: Amounts | None = None
    residual: float | None = None
    image_of: "BoxDeflection | None" = field(default=None, repr=False)

    @classmethod
    def at(
        cls, plan: BoxPlan, amounts: Amounts, points: FloatArray, repair: FloatArray | None = None
    ) -> "BoxDeflection":
        """Return a deflection without steps, given its final coordinates (N, 3).

        `repair` is the displacement (N, 3) by a repair, if there was one.
        """
        repaired, wanted = None, plan.job.repair
        if repair is not None and wanted.mode != "off" and repair[plan.movable].any():
            start = points - repair
            repaired = RepairResult.of(start, points, plan.affected, plan.freedom(start), wanted.wanted)
        return cls(plan, amounts, (), points, 0.0, repaired)

    @property
    def angle(self) -> float:
        """Amount of the first surface."""
        return self.amounts[0]

    @cached_property
    def points(self) -> FloatArray:
        """Deflected coordinates (N, 3), rounded as the file to be written rounds them."""
        return self.plan.precision.rounded(self.exact, self.plan.mesh.points)

    @cached_property
    def inverted(self) -> int:
        """Number of newly inverted cells."""
        return inverted_count(self.plan.affected, self.points)

    @cached_property
    def quality(self) -> tuple[Quality, ...]:
        """Quality of the affected cells by type."""
        return self.plan.affected.quality(self.points)

    def rounded(self, precision: Precision) -> "BoxDeflection":
        """Return the deflection rounded for another file, from its unrounded coordinates."""
        return replace(self, plan=replace(self.plan, precision=precision))

    @property
    def interpolated(self) -> FloatArray:
        """Coordinates (N, 3) before the repair."""
        return self.points if self.repaired is None else self.repaired.start

    @cached_property
    def error_between(self) -> ErrorBetween | None:
        """Error of the interpolants between the data sites of the moving surfaces; None for surfaces without faces."""
        if self.image_of:
            return self.image_of.error_between
        amounts = self.fitted_at or self.amounts
        return ErrorBetween.of(self.plan.boundary, self.steps, self.plan.boundary.displacement(amounts))

    @property
    def site_error(self) -> float:
        """Largest error at a data site."""
        return max(step.error for step in self.steps) if self.residual is None else self.residual

    @cached_property
    def conditions(self) -> tuple[float, ...]:
        """Condition number of each group of directions, the largest of all steps; empty if the factors are not kept."""
        with single_threaded_blas():
            of_steps = [[factor.condition() for factor in step.fits.factors] for step in self.steps]
        return tuple(map(max, zip(*of_steps, strict=True)))


@dataclass(frozen=True, eq=False)
class Deflection:
    """The mesh at one pose of all surfaces.

    Attributes
    ----------
    plan : the plan of all boxes.
    boxes : the deflection in each box, from the undeflected mesh.
    """

    plan: Plan = field(repr=False)
    boxes: tuple[BoxDeflection, ...] = field(repr=False)

    @classmethod
    def at(cls, plan: Plan, points: FloatArray, repair: FloatArray | None = None) -> "Deflection":
        """Return a deflection without steps at the plan's pose, given its final coordinates (N, 3).

        `repair` is the displacement (N, 3) by repairs, if there were any.
        """
        return cls(plan, tuple(BoxDeflection.at(box, own, points, repair) for box, own in plan.by_box(plan.pose)))

    @property
    def parts(self) -> "tuple[Deflection, ...]":
        """One deflection for each box."""
        return tuple(Deflection(Plan((box.plan,), (box.amounts,)), (box,)) for box in self.boxes)

    @property
    def angle(self) -> float:
        """Amount of the first surface."""
        return self.boxes[0].angle

    @property
    def amounts(self) -> Amounts:
        """Amount of each moving surface."""
        return tuple(amount for box in self.boxes for amount in box.amounts)

    @cached_property
    def points(self) -> FloatArray:
        """Deflected coordinates (N, 3); each box moves its own nodes."""
        if len(self.boxes) == 1:  # saves a copy of a large array
            return self.boxes[0].points
        points = self.plan.undeflected_points.copy()
        for box in self.boxes:
            changed = box.plan.movable
            points[changed] = box.points[changed]
        return points

    @cached_property
    def inverted(self) -> int:
        """Number of newly inverted cells."""
        return inverted_count(self.plan.affected, self.points)

    @property
    def seconds(self) -> float:
        """Time taken."""
        return sum(box.seconds for box in self.boxes)

    @property
    def repairs(self) -> tuple[RepairResult, ...]:
        """Repairs of the boxes that needed one."""
        return tuple(box.repaired for box in self.boxes if box.repaired)

    @cached_property
    def quality(self) -> tuple[Quality, ...]:
        """Quality of the affected cells by type."""
        return self.boxes[0].quality if len(self.boxes) == 1 else self.plan.affected.quality(self.points)

    @cached_property
    def least(self) -> tuple[tuple[Least, Least], ...]:
        """Least quality before and now by type, of the affected cells that were good before."""
        return least_of(self.plan.affected, self.points, self.quality)

    @cached_property
    def faces(self) -> "State | None":
        """Measures of the affected cells' faces, as OpenFOAM's checkMesh has them; None without polyhedra."""
        return self.plan.faces.at(self.points) if self.plan.faces else None

    @property
    def moved_by_repair(self) -> FloatArray | None:
        """Displacement (N, 3) by repairs; None without a repair."""
        if not self.repairs:
            return None
        return np.asarray(np.sum([box.points - box.interpolated for box in self.boxes], axis=0))

    def rounded(self, precision: Precision) -> "Deflection":
        """Return the deflection rounded for another file."""
        return Deflection(self.plan.keeping(precision), tuple(box.rounded(precision) for box in self.boxes))

    def sensitivity(self) -> dict[str, FloatArray]:
        """Return the derivative (N, 3) by each surface's amount, by the surface's name, on the same centres.

        It is in lengths per unit of the amount. With several steps it is the derivative at the end of the last one.

        Raises InputError for a repaired mesh: a repair ends where cells are good enough, so it has no derivative.
        """
        if self.repairs:
            raise InputError(
                f"{self.plan.mesh.name}: the mesh at {self.angle:g} was repaired, and a repair ends where cells are "
                "good enough: it has no derivative; set repair = off for the sensitivity"
            )
        rates = {}
        for box in self.boxes:
            for row, (_, surface) in enumerate(box.plan.moving):
                rate, changed, mirror = np.zeros_like(self.points), box.plan.movable, box.plan.mirror
                if mirror and box.image_of:
                    rate = mirror.reflect(_rate(box.image_of, row), rate)
                else:
                    rate[changed] = _rate(box, row)[changed]
                rates[surface.label] = rate
        return rates


def _rate(deflection: BoxDeflection, row: int) -> FloatArray:
    """Return the derivative (N, 3) by the amount of surface `row` at the end of the last step, on its centres.

    The surface's displacement is differentiated by a difference of fourth order, the step itself exactly.
    """
    plan, step = deflection.plan, deflection.steps[-1]
    boundary = plan.boundary.frozen_at(deflection.amounts)
    h = DEGREES if plan.job.surfaces[row].motion.unit == "deg" else SHARE
    ends = []
    for k in (-2, -1, 1, 2):
        amounts = tuple(amount + k * h * (i == row) for i, amount in enumerate(deflection.amounts))
        ends.append(boundary.displacement(amounts))
    speeds = (8.0 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / (12.0 * h)
    moving = step.known[: len(plan.sites.moving)]
    rate = StepRates.of(step.start, step.first, step.fits, moving).forward(speeds, plan.runner)
    return plan.boundary.thin.displacement(rate) if plan.boundary.thin else rate


def deflect(
    plan: Plan, pose: Amounts = (), progress: Progress = silent, earlier: Deflection | None = None
) -> Deflection:
    """Deflect every box to a pose, by default the plan's; start from the centres of an earlier deflection."""
    known, done = earlier.boxes if earlier else [None] * len(plan.boxes), list[BoxDeflection]()
    for (box, amounts), reused in zip(plan.by_box(pose or plan.pose), known, strict=True):
        done.append(
            _reflect(box, amounts, done, progress) if box.mirror else deflect_box(box, amounts, progress, reused)
        )
    return Deflection(plan, tuple(done))


def _reflect(plan: BoxPlan, amounts: Amounts, done: Sequence[BoxDeflection], progress: Progress) -> BoxDeflection:
    """Return the reflection of the deflection of another box, already done, to the same amounts."""
    mirror, source = plan.mirror, done[plan.job.image_of]
    assert mirror
    source = source if source.amounts == amounts else deflect_box(source.plan, amounts, progress)
    repair = (
        mirror.reflect(source.exact - source.interpolated, np.zeros_like(source.exact)) if source.repaired else None
    )
    reflected = BoxDeflection.at(plan, amounts, mirror.reflect(source.exact, plan.mesh.points), repair)
    return replace(reflected, steps=source.steps, residual=source.site_error, image_of=source)


def deflect_box(
    plan: BoxPlan, amounts: Amounts, progress: Progress = silent, earlier: BoxDeflection | None = None
) -> BoxDeflection:
    """Deflect one box to the amounts of its surfaces in one step, and repair the mesh.

    If cells are newly inverted, the number of steps is doubled as long as that halves their number, and the repair
    leaves some. The result is the deflection with the fewest. A number of steps is skipped if one of them cannot be
    solved, for example because a moving node meets a fixed one on the way. Two steps are also tried if cells that were
    not poor become poor. A single step uses the centres and factors of the first step of an earlier deflection. Each of
    several shapes has its own centres.
    """
    boundary = plan.boundary.straight_to(amounts)
    if boundary is not plan.boundary:
        plan = replace(plan, boundary=boundary, sites=Sites.of(boundary, plan.region, plan.more))
        earlier = None
    reused = earlier.steps[0] if earlier is not None and earlier.steps else None
    attempts, count, most = [deflect_in_steps(plan, amounts, 1, progress, reused)], 1, plan.job.fitting.max_steps
    allowed = attempts[0].inverted
    while 0 < attempts[-1].inverted <= allowed and 2 * count <= most:
        count *= 2
        if attempt := _possible(plan, amounts, count, progress):
            allowed = attempts[-1].inverted // 2
            attempts.append(attempt)
    if not attempts[0].inverted and most > 1 and _worst_share(attempts[0]) < 1.0:
        twice = _possible(plan, amounts, 2, progress)
        if twice and _worst_share(twice) > _worst_share(attempts[0]):
            attempts.insert(0, twice)  # of equally few inverted cells the first is taken
    best = with_repair(min(attempts, key=lambda attempt: attempt.inverted), progress)
    while best.inverted and 2 * count <= most:
        count *= 2
        if attempt := _possible(plan, amounts, count, progress):
            best = min(best, with_repair(attempt, progress), key=lambda attempt: attempt.inverted)
    return best


def poor_below(before: float) -> float:
    """Return the quality below which cells are poor, from the worst before: half of that, but not below `POOR`.

    Of a mesh whose worst cell was below `POOR` it is half of that.
    """
    return max(POOR_SHARE * before, POOR if before >= POOR else 0.0)


def fell_poor(before: Least, after: Least) -> bool:
    """True if the worst cell became poor: it lost more than half of its quality, or newly fell below `POOR`."""
    return after.quality < poor_below(before.quality)


def _worst_share(deflection: BoxDeflection) -> float:
    """Return the least ratio of worst qualities, now over before, of the types that became poor; 1 if none did.

    Types whose worst cell was poor before do not count.
    """
    least = least_of(deflection.plan.affected, deflection.points, deflection.quality)
    shares = (new.quality / old.quality for old, new in least if old.quality >= POOR and fell_poor(old, new))
    return min(shares, default=1.0)


def _possible(plan: BoxPlan, amounts: Amounts, count: int, progress: Progress) -> BoxDeflection | None:
    """Deflect in several steps; None if one of them cannot be solved."""
    try:
        return deflect_in_steps(plan, amounts, count, progress)
    except (InputError, SolveError):
        return None


def with_repair(deflection: BoxDeflection, progress: Progress = silent) -> BoxDeflection:
    """Repair the mesh if the job asks for it, and cells are inverted or too poor."""
    plan, wanted = deflection.plan, deflection.plan.job.repair
    if wanted.mode == "off" or not plan.affected.count:
        return deflection
    least = least_of(plan.affected, deflection.points, deflection.quality)
    fell = any(old.cells and new.quality < wanted.wanted * old.quality for old, new in least)
    if not fell and not deflection.inverted:
        return deflection
    freedom, aim = plan.freedom(deflection.points), (wanted.wanted, wanted.min_quality)
    repair = repair_cells(deflection.points, plan.affected, freedom, *aim, progress)
    return replace(deflection, exact=repair.points, seconds=deflection.seconds + repair.seconds, repaired=repair)


def least_of(
    affected: AffectedCells, points: FloatArray, quality: Sequence[Quality]
) -> tuple[tuple[Least, Least], ...]:
    """Return the least quality before and at points (N, 3) by type, of the affected cells that were good before."""
    before = affected.least(affected.mesh.points, affected.quality_before)
    return tuple(zip(before, affected.least(points, quality), strict=True))


def deflect_in_steps(
    plan: BoxPlan, amounts: Amounts, count: int, progress: Progress = silent, earlier: Step | None = None,
    keep_centers: bool = False,
) -> BoxDeflection:  # fmt: skip
    """Deflect in equal steps, each from the end of the last one.

    A single step starts from the centres of an earlier one, and adds none with `keep_centers`.

    Raises InputError for a system that cannot be solved; the message names the kernel's radius, if it has one.
    """
    begin, nodes, start = perf_counter(), plan.sites.moving, plan.boundary.mesh.points
    points, steps, reached = start, [], np.zeros((len(nodes), 3))
    for k in range(1, count + 1):
        target = plan.boundary.displacement(share_of(amounts, k, count))
        begins = replace(earlier.start, how=plan.choice) if earlier else plan.start(points)
        try:
            steps.append(take(begins, target - reached, earlier, keep_centers, progress, plan.runner))
        except SolveError as error:
            if not plan.sites.radius:
                raise
            given = f"kernel = {plan.job.fitting.kernel} with kernel_radius = {plan.sites.radius:.4g}"
            remedy = "A smaller radius makes the system better conditioned"
            raise InputError(f"{plan.boundary.mesh.name}: {given}: {error} {remedy}") from None
        points, reached = steps[-1].points, target
    points[nodes] = start[nodes] + reached  # the exact places, without the rounding of the steps
    return BoxDeflection(plan, amounts, tuple(steps), plan.to_whole_mesh(points), perf_counter() - begin)


def share_of(amounts: Amounts, k: int, count: int) -> Amounts:
    """Return the amounts after k of `count` equal steps."""
    return tuple(amount * k / count for amount in amounts)


def inverted_count(affected: AffectedCells, points: FloatArray) -> int:
    """Return the number of newly inverted affected cells, with the mesh at `points` (N, 3)."""
    return int(np.count_nonzero(affected.newly_inverted(points)))
