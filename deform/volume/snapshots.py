"""Deflections of one surface from which the fields of a plan are read.

Each is a deflection of its own at an end of the range, or one on the same centres between the ends; repairs fade.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.mesh.cells import LARGEST
from sdm_deflect.meshing.mesh.sliding import Plane

from .controls import ControlRange
from .deflection import BoxDeflection, deflect_box, deflect_in_steps
from .job import Amounts
from .plan import BoxPlan
from .step import take

# Amounts at which the growth of errors between readings is sampled, and the largest by which fits become finer for it.
SAMPLES, MOST_GROWTH = 101, 5.0
# Share of the tolerance by which fields may miss a deflection on the same centres between the ends.
MISSED = 0.1
# Factor by which fits are finer than the largest error of the fields asks for: one more reading then suffices mostly,
# and four reach `MOST_GROWTH`.
FINER = 1.5


class Snapshots(NamedTuple):
    """Deflections of one surface alone, and the weights that turn them into fields.

    Attributes
    ----------
    control : the surface.
    box, row : the plan of the box, and the index of the surface in it.
    deflections : r deflections.
    weights : (k, r) weights of their displacements in the field of each function.
    ends : deflections to the ends of the range, with their adaptations.
    residuals : (k, steps, S, 3) errors of the fields at the data sites in each step; none until `with_residuals`.
    """

    control: ControlRange
    box: BoxPlan
    row: int
    deflections: tuple[BoxDeflection, ...]
    weights: FloatArray
    ends: tuple[BoxDeflection, ...]
    residuals: FloatArray = np.empty((0, 0, 0, 3))

    @classmethod
    def of(
        cls,
        box: BoxPlan,
        row: int,
        control: ControlRange,
        progress: Progress = silent,
        known: BoxDeflection | None = None,
    ) -> "Snapshots":
        """Deflect the surface `row` of a box to each amount to be read; the others stay.

        Where the functions miss a deflection between, further amounts are read. Where the errors of deflections add up
        to more than the tolerance, these are fitted more finely. A `known` deflection is used as it is.

        Raises InputError if a surface cannot move so far, or if the fields miss a deflection by more than `MISSED`.
        """
        finer = 1.0
        while True:
            snapshots = cls._read(box, row, control, finer, progress, known).with_residuals()
            error = snapshots.error() / box.sites.tolerance
            if error <= MISSED:
                growth = snapshots.site_error() * box.margin / box.sites.tolerance
                if growth <= 1.0 or finer >= MOST_GROWTH:
                    return snapshots
                finer = min(FINER * growth * finer, MOST_GROWTH)
                continue
            if control.functions.finer is None:
                smaller = f"{0.5 * control.low:g}:{0.5 * control.high:g}"
                curved = any(not isinstance(patch.surface, Plane) for patch in box.boundary.sliding)
                raise InputError(
                    f"{box.mesh.name}: no plan for {control.name} from {control.low:g} to {control.high:g}: sums of "
                    f"{control.functions.count} fields miss deflections by {error:.2g} of the tolerance, and "
                    f"{MISSED:g} is allowed{', as on a curved slide' * curved}; try {smaller}, or plan one amount"
                )
            control, finer = replace(control, functions=control.functions.finer), 1.0

    @classmethod
    def _read(
        cls, box: BoxPlan, row: int, control: ControlRange, finer: float, progress: Progress,
        known: BoxDeflection | None,
    ) -> "Snapshots":  # fmt: skip
        """Deflect to the ends of the range as `deflect_box` does, and to amounts between on the centres of the ends.

        The fields are read without repairs. The repair of an end has the share 1 there, and 0 at amount 0 and at the
        other end (at the opposite amount, if the other end is 0). If the functions ask for `separate` readings, each is
        a deflection of its own with its repair, and more accurate by as much as errors grow between them. All fits but
        the known one are `finer` by a factor.
        """
        plan, reads = _with_free_nodes_repaired(replace(box, margin=finer * box.margin)), control.reads
        poses = [_alone(box, row, amount) for amount in reads]
        if control.functions.separate:
            inverse = _inverse(control, reads)
            shares = [control.functions.values(amount) @ inverse for amount in control.samples(SAMPLES)]
            growth = min(MOST_GROWTH, float(np.abs(shares).sum(axis=1).max()))
            plan = replace(plan, margin=growth * plan.margin)
            deflections = tuple(deflect_box(plan, pose, progress) for pose in poses)
            return cls(control, box, row, deflections, inverse, deflections)
        end = _deflect(plan, poses[int(np.argmax(np.abs(reads)))], progress, known)
        return cls(control, box, row, (), np.empty(0), (end,))._fading(plan, poses, progress, known)

    def _fading(
        self, plan: BoxPlan, poses: Sequence[Amounts], progress: Progress, known: BoxDeflection | None
    ) -> "Snapshots":
        """Read amounts between the ends on the centres of the end that is there; repairs of the ends fade."""
        control, reads, (end,) = self.control, self.control.reads, self.ends
        last = poses.index(end.amounts)
        ends = {last: end}
        if self.box.boundary.laws[self.row].functions.count <= 2:
            others = {*np.flatnonzero(np.isin(reads, (control.low, control.high))).tolist()} - {last}
            ends |= {i: _deflect(plan, poses[i], progress, known) for i in others}
            steps, first = len(end.steps), end.steps[0] if len(end.steps) == 1 else None
            deflections = [
                ends.get(i) or deflect_in_steps(plan, pose, steps, progress, first) for i, pose in enumerate(poses)
            ]
        else:
            deflections = _on_shared_centers(plan, poses, end, progress)
            deflections[last] = end if end is known else deflections[last]
        plain = [replace(deflection, exact=deflection.interpolated, repaired=None) for deflection in deflections]
        weights = _inverse(control, reads)
        for i, deflection in enumerate(deflections):
            if deflection.repaired:
                share = control.share(reads[i])
                weights[:, i] -= share
                weights = np.column_stack([weights, share])
                plain.append(deflection)
        return self._replace(deflections=tuple(plain), weights=weights, ends=tuple(ends.values()))

    @property
    def fields(self) -> FloatArray:
        """Fields (k, M, 3) of the movable nodes of the box, one for each function of the amount."""
        nodes = self.box.movable
        start = self.box.mesh.points[nodes]
        return weighted(self.weights, [deflection.exact[nodes] - start for deflection in self.deflections])

    def with_residuals(self) -> "Snapshots":
        """Return the same with the errors of the fields at the data sites."""
        steps = max(len(deflection.steps) for deflection in self.deflections)
        errors = weighted(self.weights, [_residuals(deflection, steps) for deflection in self.deflections])
        return self._replace(residuals=errors)

    def site_error(self) -> float:
        """Return the largest error of the fields at any data site, at amounts from end to end of the range."""
        values = (self.control.functions.values(amount) for amount in self.control.samples(SAMPLES))
        return max(float(np.abs(np.tensordot(value, self.residuals, 1)).max(initial=0.0)) for value in values)

    def nearest(self, amount: float) -> BoxDeflection:
        """Return the deflection at the end of the range nearest to an amount."""
        return min(self.ends, key=lambda end: abs(end.amounts[self.row] - amount))

    def error(self) -> float:
        """Return the largest distance between the sum of fields and a deflection on the centres of one reading.

        It is measured halfway between the amounts that were read, and 0.
        """
        reads = self.control.reads
        end = self.deflections[int(np.argmax(np.abs(reads)))]

        def on_centers(amount: float) -> FloatArray:
            """Return the displacement (M, 3) of the nodes inside on the centres of the end's first step."""
            move, step = self.box.boundary.displacement(_alone(self.box, self.row, amount)), end.steps[0]
            points = take(step.start, move, step, keep_centers=True, runner=self.box.runner).points
            return (points - step.start.points)[self.box.region.inside]

        functions, known = self.control.functions, [on_centers(amount) for amount in reads]
        weights, error = _inverse(self.control, reads), 0.0
        for low, high in pairwise(sorted({0.0, *reads})):
            middle = 0.5 * (low + high)
            shares = functions.values(middle) @ weights
            off = on_centers(middle) - sum(share * residual for share, residual in zip(shares, known, strict=True))
            error = max(error, float(np.abs(off).max(initial=0.0)))
        return error


def _inverse(control: ControlRange, reads: Sequence[float]) -> FloatArray:
    """Return the weights (k, k) of deflections at k amounts; InputError if the range is too narrow for them."""
    values = np.array([control.functions.values(amount) for amount in reads], dtype=np.float64)
    try:
        inverse = np.asarray(np.linalg.inv(values))
    except np.linalg.LinAlgError:
        inverse = np.full_like(values, np.inf)
    if not (np.abs(inverse) < LARGEST).all():
        raise InputError(f"range = {control.low:g}:{control.high:g} of {control.name} is too narrow for a plan")
    return inverse


def _on_shared_centers(
    box: BoxPlan, poses: Sequence[Amounts], end: BoxDeflection, progress: Progress
) -> list[BoxDeflection]:
    """Deflect to each pose in one step on the same centres: those of the end, and those that the poses add.

    If the end needs several steps, each has its own centres, and the poses have their own, too.
    """
    if len(end.steps) > 1:
        return [end if pose == end.amounts else deflect_in_steps(box, pose, len(end.steps), progress) for pose in poses]
    step, grown = end.steps[0], False
    while True:
        before = len(step.fits.interpolant.centers)
        for pose in poses:
            step = deflect_in_steps(box, pose, 1, progress, step).steps[0]
        deflections = [deflect_in_steps(box, pose, 1, progress, step, keep_centers=True) for pose in poses]
        added = len(step.fits.interpolant.centers) > before
        grown |= added
        # centres that one pose adds may raise the error of another above the tolerance
        if not added or max(deflection.site_error for deflection in deflections) <= box.sites.tolerance / box.margin:
            break
    return (
        deflections
        if grown
        else [end if pose == end.amounts else deflection for pose, deflection in zip(poses, deflections, strict=True)]
    )


def _alone(box: BoxPlan, row: int, amount: float) -> Amounts:
    return tuple(amount if i == row else 0.0 for i in range(len(box.job.surfaces)))


def _deflect(box: BoxPlan, pose: Amounts, progress: Progress, known: BoxDeflection | None) -> BoxDeflection:
    """Deflect a box in double precision; take the known deflection if its repair is the same, or it has none."""
    if not known or known.amounts != pose or not known.plan.precision.is_double:
        return deflect_box(box, pose, progress)
    alike = not known.repaired or known.plan.job.repair_slides == box.job.repair_slides
    return known if alike else deflect_box(box, pose, progress)


def _with_free_nodes_repaired(box: BoxPlan) -> BoxPlan:
    """Return a plan whose repair moves no node of a wall: no fixed field keeps such nodes on a plane that turns.

    A root that slides has no repair at all: its motion is a sum of many functions.
    """
    job = replace(box.job, repair_slides=())
    if any(law.functions.count > 2 and not law.functions.separate for law in box.boundary.laws):
        job = replace(job, repair=replace(job.repair, mode="off"))
    return replace(box, boundary=replace(box.boundary, job=job))


def _residuals(deflection: BoxDeflection, steps: int) -> FloatArray:
    """Return the errors of a deflection's interpolants at the data sites in each step (steps, S, 3).

    Boundary sites come first, then zero sites; layer sites are left out, because each step chooses its own. Steps
    that the deflection does not have are 0.
    """
    sites = deflection.plan.sites
    counts = np.cumsum([0, len(sites.moving), len(sites.fixed)])
    chosen = zip(counts, (sites.distinct, sites.sampled, sites.sampled_sliding), strict=True)
    rows = np.concatenate([start + some for start, some in chosen])
    out = np.zeros((steps, len(rows) + sum(len(zero.points) for zero in sites.zero), 3))
    for k, step in enumerate(deflection.steps):
        parts = [step.off[rows]]
        for zero in sites.zero:
            parts.append(np.zeros((len(zero.points), 3)))
            columns = list(zero.components)
            parts[-1][:, columns] = step.fits.interpolant(zero.points)[:, columns]
        out[k] = np.vstack(parts)
    return out


def weighted(weights: FloatArray, displacements: Sequence[FloatArray]) -> FloatArray:
    """Return the fields (k, M, 3): displacements (r, M, 3) weighted by (k, r), summed in a fixed order."""
    out = np.zeros((len(weights), *displacements[0].shape))
    for j, displacement in enumerate(displacements):
        for k, row in enumerate(weights):
            out[k] += row[j] * displacement
    return out
