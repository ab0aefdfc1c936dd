"""The motion of a mesh: its coordinates at any amounts of its surfaces, as a sum of fixed fields.

x(a) = X0 + sum f_k(a) F_k, where X0 is the undeflected mesh. A hinge gives sin a S + (1 - cos a) V, a table s T,
or powers of s if it has rotations, and several surfaces add up. The fields are read from deflections, each with its
own steps and repair.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from math import inf, isfinite, nan
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError, shortened
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.deform.surface.motions import Fixed, Moving
from sdm_deflect.deform.surface.surface import Surface, name_of
from sdm_deflect.deform.surface.tail_root import RootOnCylinder
from sdm_deflect.deform.volume.controls import ControlRange, Wanted, by_surface, in_order
from sdm_deflect.deform.volume.deflection import BoxDeflection, Deflection
from sdm_deflect.deform.volume.job import Amounts
from sdm_deflect.deform.volume.places import PlaceTable
from sdm_deflect.deform.volume.plan import BoxPlan, Plan
from sdm_deflect.deform.volume.snapshots import Snapshots
from sdm_deflect.meshing.mesh.cells import bounded
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.precision import EVERY_BIT, Precision

from .checks import Check, checks_of, reservations
from .motion_fields import write_motion
from .plan_file import Measured, StoredPlan, read_plan, write_plan

# Number of amounts of each surface at which the mesh is checked.
MEASURED = 9
NO_MIRROR = "a plan holds no mirrored surface: leave mirror out, and give each surface its own hinge"
NO_MESH = (
    "a plan from a file has no mesh: give the undeflected points (N, 3) to MeshMotion.load, or take plan.on(points)"
)


@dataclass(frozen=True, eq=False)
class MeshMotion:
    """The coordinates of a mesh as a function of its surfaces' amounts within their ranges.

    Attributes
    ----------
    controls : the surfaces and their ranges.
    start : (N, 3) undeflected coordinates; of a plan from a file those of its places.
    rows : for each surface the nodes (M,) that it moves.
    fields : for each surface (k, M, 3), one field for each function of its amount.
    amounts : amounts of the other surfaces while one is measured.
    measured : for each surface the checks at some amounts; empty until `judged`.
    source : name of the file of the undeflected mesh; empty if it came from elsewhere.
    plan : the plan from which it was made; None for a plan from a file.
    snapshots : the deflections from which the fields were read.
    single : the deflection of a plan of one amount.
    table : the places that `start` are; None where `start` are nodes of a mesh.
    stored : the motion of all places, if this one was taken from it for some points.
    """

    controls: tuple[ControlRange, ...]
    start: FloatArray = field(repr=False)
    rows: tuple[IntArray, ...] = field(repr=False)
    fields: tuple[FloatArray, ...] = field(repr=False)
    amounts: Amounts = ()
    measured: tuple[tuple[Measured, ...], ...] = field(default=(), repr=False)
    source: str = ""
    plan: Plan | None = field(default=None, repr=False)
    snapshots: tuple[Snapshots, ...] = field(default=(), repr=False)
    single: Deflection | None = field(default=None, repr=False)
    table: PlaceTable | None = field(default=None, repr=False)
    stored: "MeshMotion | None" = field(default=None, repr=False)

    @classmethod
    def of(cls, plan: Plan, progress: Progress = silent, known: Deflection | None = None) -> "MeshMotion":
        """Deflect each surface of a plan to the amounts to be read; surfaces without a range stay.

        A `known` deflection is used as it is.

        Raises InputError if no surface has a range, if one cannot move so far, or if the fields miss a deflection by
        more than a tenth of the tolerance, as on a triangulated slide.
        """
        plan = plan.keeping(EVERY_BIT)
        plan = replace(plan, boxes=tuple(map(_finer, plan.boxes)))
        _check_unmirrored(plan)
        taken, amounts = list[Snapshots](), list[float]()
        for b, box in enumerate(plan.boxes):
            for row, (moving, surface) in enumerate(box.moving):
                low, high = moving.ends
                if low < high:
                    functions = box.boundary.laws[row].functions.within(low, high)
                    control = ControlRange(
                        control_name(moving, surface), surface.patches, moving.motion.unit, low, high, functions
                    )
                    there = known.boxes[b] if known else None
                    taken.append(Snapshots.of(box, row, control, progress, there))
                    amounts.append(moving.amount)
        if not taken:
            raise InputError(f"{plan.mesh.name}: no surface has a range: give one, such as range = (-10, 25)")
        return cls(
            tuple(snapshots.control for snapshots in taken),
            plan.mesh.points,
            tuple(snapshots.box.movable for snapshots in taken),
            tuple(snapshots.fields for snapshots in taken),
            tuple(amounts),
            source=Path(plan.mesh.source).name,
            plan=plan,
            snapshots=tuple(taken),
        )

    @classmethod
    def of_one_amount(cls, deflection: Deflection, checks: Sequence[Check]) -> "MeshMotion":
        """Return the motion that serves the amounts of an unrounded deflection alone, with its checks.

        The first surface that moves has two fields; with the undeflected mesh they add up exactly to the deflected one.
        """
        deflection = deflection.rounded(EVERY_BIT)
        plan, start, controls = deflection.plan, deflection.plan.mesh.points, []
        _check_unmirrored(plan)
        for (moving, surface), amount in zip(plan.moving, deflection.amounts, strict=True):
            ends = min(0.0, amount), max(0.0, amount)
            controls.append(
                ControlRange(control_name(moving, surface), surface.patches, moving.motion.unit, *ends, Fixed(amount))
            )
        first = next((i for i, amount in enumerate(deflection.amounts) if amount), 0)
        least = min((quality.min for quality in deflection.quality), default=nan)
        error = max(box.site_error for box in deflection.boxes)
        measured = Measured(deflection.amounts[first], least, deflection.inverted, error, *_judgement(checks))
        moved = np.flatnonzero((deflection.points != start).any(axis=1))
        move = deflection.points[moved] - start[moved]
        whole = np.stack([move, deflection.points[moved] - (start[moved] + move)])
        counts = [len(moved) * (i == first) for i in range(len(controls))]
        return cls(
            tuple(controls), start, tuple(moved[:count] for count in counts),
            tuple(whole[:, :count] for count in counts), deflection.amounts,
            tuple((measured,) if i == first else () for i in range(len(controls))), Path(plan.mesh.source).name, plan,
            single=deflection,
        )  # fmt: skip

    @classmethod
    def load(cls, path: str | PathLike[str], points: FloatArray | None = None) -> "MeshMotion":
        """Read a file of `save`.

        Parameters
        ----------
        path : The file.
        points : (N, 3) undeflected coordinates of the mesh, for which `at`, `jvp` and `vjp` then answer.

        Raises InputError if the file is missing, damaged or of another kind, or as `on`.
        """
        controls, amounts, measured, rows, fields, source, table = read_plan(Path(path))
        motion = cls(controls, table.places, rows, fields, amounts, measured, source, table=table)
        return motion if points is None else motion.on(points)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the plan to a file, completely or not at all; `load` restores it exactly.

        Raises InputError if the file cannot be written, or is there and no plan; or if nodes at one place move apart.
        """
        motion = self.by_place
        parts = (
            motion.controls,
            motion.amounts,
            motion.measured,
            motion.rows,
            motion.fields,
            motion.source,
            motion.places,
        )
        write_plan(Path(path), StoredPlan(*parts))

    def save_openfoam(self, case: str | PathLike[str], points: FloatArray | None = None) -> tuple[Path, ...]:
        """Write the plan into a case of OpenFOAM, for the solver in `solvers/openfoam`; return the files.

        `points` (N, 3) are the case's undeflected ones, in its order; those of the plan's mesh if None. Raises
        InputError as `write_motion` and `on` do, or for a plan from a file without points.
        """
        motion = self if points is None else self.on(points)
        motion._check_nodes()
        return write_motion(Path(case), motion.start, zip(motion.controls, motion.rows, motion.fields, strict=True))

    @cached_property
    def by_place(self) -> "MeshMotion":
        """The same motion by place, each place once; InputError if nodes at one place move apart."""
        if self.table or self.stored:
            return self.stored or self
        if self.plan is None:
            raise InputError(NO_MESH)
        table, nodes, place = PlaceTable.of(self.plan)
        motion, rows, fields = self._on_plan, [], []
        for moved, some in zip(motion.rows, motion.fields, strict=True):
            whole = np.zeros((len(some), len(table.places), 3))
            at = place[np.searchsorted(nodes, moved)]
            whole[:, at] = some
            stays = np.isin(nodes, moved, assume_unique=True, invert=True)
            if (whole[:, at] != some).any() or whole[:, place[stays]].any():
                raise InputError(f"{self.plan.mesh.name}: nodes at one place move apart: the motion is no function")
            rows.append(np.flatnonzero(whole.any(axis=(0, 2))))
            fields.append(whole[:, rows[-1]])
        kept = self.controls, table.places, tuple(rows), tuple(fields), self.amounts, self.measured, self.source
        return MeshMotion(*kept, table=table)

    @property
    def nbytes(self) -> int:
        """Bytes of the fields and of their nodes' coordinates: about the size of its file."""
        return sum(array.nbytes + 24 * array.shape[1] for array in self.fields)

    @property
    def places(self) -> PlaceTable:
        """The places of its mesh; errors as of `by_place`."""
        table = self.by_place.table
        assert table is not None
        return table

    def on(self, points: FloatArray | Mesh) -> "MeshMotion":
        """Return the motion of undeflected points (N, 3): all nodes of the mesh, or any part of them in any order.

        A mesh stands for its points.

        Raises InputError if the points are not finite (N, 3), or are not those of the plan's mesh: rounded, deflected,
        or in another unit of length. Of a part of a mesh with several zones some faults cannot be seen.
        """
        given = bounded(points.points if isinstance(points, Mesh) else points, "points")
        if given.ndim != 2 or given.shape[1] != 3:
            raise InputError(f"points {given.shape} must be (N, 3)")
        place = self.places.find(given)
        self.places.check(given, place)
        return self.taken(given, place)

    def taken(self, points: FloatArray, place: IntArray) -> "MeshMotion":
        """Return the motion of points (N, 3), given the index (N,) of the place of each; -1 for those that stay."""
        whole, rows, fields = self.by_place, [], []
        slot = np.empty(len(whole.start) + 1, dtype=np.intp)
        for moved, some in zip(whole.rows, whole.fields, strict=True):
            slot[:] = -1
            slot[moved] = np.arange(len(moved))
            at = slot[place]
            rows.append(np.flatnonzero(at >= 0))
            fields.append(some[:, at[rows[-1]]])
        return replace(whole, start=points, rows=tuple(rows), fields=tuple(fields), table=None, stored=whole)

    def of_whole(self, coordinates: FloatArray) -> "MeshMotion":
        """Return the motion of all nodes (N, 3) of a mesh of which the plan holds a submesh."""
        assert self.plan is not None
        mesh = self.plan.mesh
        return replace(self, start=coordinates, rows=tuple(map(mesh.numbers, self.rows)))

    def at(self, amounts: Wanted) -> FloatArray:
        """Return the coordinates (N, 3) of the mesh at amounts; at 0 they equal the mesh's exactly.

        Terms are added in a fixed order, so a part of the nodes has the bits of the whole.

        Parameters
        ----------
        amounts : One number for a single surface; numbers by name, 0 where left out; or numbers of all surfaces in
            order. Degrees, or shares of a table.

        Raises InputError for an amount outside its range, or for a plan from a file without points: see `load`.
        """
        pose, out = self.in_order(amounts), self._check_nodes().copy()
        for rows, fields, control, amount in zip(self.rows, self.fields, self.controls, pose, strict=True):
            if amount:
                for value, vectors in zip(control.functions.values(amount), fields, strict=True):
                    out[rows] += value * vectors
        return out

    def jvp(self, amounts: Wanted, speeds: Wanted) -> FloatArray:
        """Return the derivative (N, 3) of the coordinates along `speeds`, which are given like amounts."""
        out, rates = np.zeros_like(self._check_nodes()), self._rates(amounts)
        given = by_surface(self.controls, speeds)
        if not all(map(isfinite, given)):
            raise InputError(f"speeds = {shortened(speeds)} must be finite")
        for rows, fields, factors, speed in zip(self.rows, self.fields, rates, given, strict=True):
            for rate, vectors in zip(factors, fields, strict=True):
                out[rows] += speed * rate * vectors
        return out

    def vjp(self, amounts: Wanted, gradient: ArrayLike) -> FloatArray:
        """Return the derivative (n,) by the amounts of a function whose gradient by the coordinates is (N, 3).

        Raises InputError for a gradient of another shape, or one that is not finite.
        """
        given = bounded(gradient, "gradient")
        if given.shape != self._check_nodes().shape:
            raise InputError(f"gradient {given.shape} must be {self.start.shape}, one row for each node")
        pairs = zip(self.rows, self.fields, self._rates(amounts), strict=True)  # in jvp's order: BLAS rounds otherwise
        return np.array([sum(rates * np.einsum("kmi,mi->k", vectors, given[rows])) for rows, vectors, rates in pairs])

    def _rates(self, amounts: Wanted) -> Iterator[FloatArray]:
        for control, amount in zip(self.controls, self.in_order(amounts), strict=True):
            yield control.functions.rates(amount)

    def _check_nodes(self) -> FloatArray:
        """Return `start`; InputError for a plan from a file, which has places and no nodes."""
        if self.table:
            raise InputError(NO_MESH)
        return self.start

    def deflection(self, amounts: Wanted, precision: Precision = EVERY_BIT) -> Deflection:
        """Return the mesh at amounts as a deflection, with the steps of the nearest snapshot.

        Raises InputError as `at`.
        """
        pose, whole = self.in_order(amounts), self._on_plan
        assert whole.plan is not None
        if self.single:
            self.controls[0].functions.values(pose[0])
            return self.single.rounded(precision)
        points, boxes, plan = whole.at(pose), [], whole.plan.keeping(precision)
        for box, of in zip(plan.boxes, whole.plan.boxes, strict=True):
            at_box, read, missed = [0.0] * len(box.job.surfaces), None, np.zeros(1)
            for snapshot, amount, off in zip(self.snapshots, pose, self._residuals, strict=True):
                if snapshot.box is of:
                    at_box[snapshot.row] = amount
                    read = read or snapshot.nearest(amount)
                    missed = missed + np.tensordot(snapshot.control.functions.values(amount), off, 1)
            steps, at = (read.steps, read.amounts) if read else ((), None)
            error = float(np.abs(missed).max(initial=0.0))
            boxes.append(BoxDeflection(box, tuple(at_box), steps, points, 0.0, None, at, error))
        return Deflection(plan, tuple(boxes))

    def at_pose(self, pose: Amounts, precision: Precision = EVERY_BIT) -> Deflection:
        """Return the mesh at a pose of all surfaces of the plan, rounded for a file."""
        return self.deflection(self._ranged(pose), precision)

    def rates(self, pose: Amounts) -> dict[str, FloatArray]:
        """Return the derivative (N, 3) of the plan's coordinates by each surface's amount, by the surface's name."""
        there, units = self._ranged(pose), np.eye(len(self.controls))
        names = (control.name for control in self.controls)
        return {name: self._on_plan.jvp(there, tuple(unit)) for name, unit in zip(names, units, strict=True)}

    def check(self, amounts: Wanted) -> tuple[Check, ...]:
        """Return all checks of the mesh at amounts."""
        return checks_of(self.deflection(amounts))

    def _ranged(self, pose: Amounts) -> Amounts:
        """Return the amounts of the surfaces with a range, given those of all."""
        assert self.plan is not None
        parts = {id(box): amounts for box, amounts in self.plan.by_box(pose)}
        return tuple(parts[id(snapshot.box)][snapshot.row] for snapshot in self.snapshots)

    @cached_property
    def _on_plan(self) -> "MeshMotion":
        """The motion of the nodes that the plan holds; InputError for a plan from a file."""
        if self.plan is None:
            raise InputError(NO_MESH)
        if not self.plan.mesh.whole or self.start is self.plan.mesh.points:
            return self
        rows = tuple(snapshot.box.movable for snapshot in self.snapshots)
        if self.single:
            rows = tuple(np.searchsorted(self.plan.mesh.whole.nodes, some) for some in self.rows)
        return replace(self, start=self.plan.mesh.points, rows=rows)

    @cached_property
    def _residuals(self) -> tuple[FloatArray, ...]:
        """For each surface the errors of its fields at the data sites in each step (k, steps, S, 3)."""
        found = [snapshot.residuals for snapshot in self.snapshots]
        most = max(errors.shape[1] for errors in found)
        return tuple(np.pad(errors, ((0, 0), (0, most - errors.shape[1]), (0, 0), (0, 0))) for errors in found)

    def judged(self, progress: Progress = silent, count: int = MEASURED) -> "MeshMotion":
        """Check the mesh at some amounts of each surface; return the motion with the results.

        The amounts are `count` evenly spaced ones and the rows of a track. The other surfaces stay at `amounts`.
        """
        measured, plan = [], self._on_plan.plan
        assert plan is not None
        for i, control in enumerate(self.controls):
            rows = []
            amounts = control.measured(count)
            for k, amount in enumerate(amounts):
                progress(f"judging {control.name}", (i + k / len(amounts)) / len(self.controls))
                pose = [amount if i == j else other for j, other in enumerate(self.amounts)]
                deflection = self.deflection(pose)
                box = deflection.boxes[next(b for b, box in enumerate(plan.boxes) if box is self.snapshots[i].box)]
                least = min((quality.min for quality in box.quality), default=nan)
                rows.append(Measured(amount, least, box.inverted, box.site_error, *_judgement(checks_of(deflection))))
            measured.append(tuple(rows))
        return replace(self, measured=tuple(measured))

    def passed(self, row: int) -> tuple[float, float] | None:
        """Return the ends of the range that passed around a surface's own amount; None if no amount passed."""
        good, bad = (
            [measured.amount for measured in self.measured[row] if bool(measured.failed) is fails]
            for fails in (False, True)
        )
        here = min(good, key=lambda amount: abs(amount - self.amounts[row]), default=None)
        if here is None:
            return None
        low, high = (max((x for x in bad if x < here), default=-inf), min((x for x in bad if x > here), default=inf))
        around = [amount for amount in good if low < amount < high]
        return min(around), max(around)

    def where_passed(self) -> "MeshMotion":
        """Return the motion with each range cut to what passed around the surface's own amount.

        A range of which nothing passed stays.
        """
        controls, measured = [], []
        for i, control in enumerate(self.controls):
            low, high = self.passed(i) or (control.low, control.high)
            controls.append(replace(control, low=min(low, 0.0), high=max(high, 0.0)))
            measured.append(tuple(row for row in self.measured[i] if controls[i].low <= row.amount <= controls[i].high))
        return replace(self, controls=tuple(controls), measured=tuple(measured))

    @property
    def shortfalls(self) -> tuple[str, ...]:
        """A sentence for each surface whose whole range did not pass: the part that did, and a range to try."""
        out = []
        for i, control in enumerate(self.controls):
            passed = self.passed(i) if self.measured and self.measured[i] else (control.low, control.high)
            if passed != (control.low, control.high):
                part = f"passed {passed[0]:g}:{passed[1]:g} of" if passed else "passed nowhere in"
                half = f"{0.5 * control.low:g}:{0.5 * control.high:g}"
                out.append(f"{control.name} {part} {control.low:g}:{control.high:g} {control.unit}; try range {half}")
        return tuple(out)

    def faults(self, amounts: Amounts) -> tuple[str, ...]:
        """Return a sentence for each surface whose amount is outside of those that passed."""
        out = []
        for i, (control, amount) in enumerate(zip(self.controls, amounts, strict=True)):
            rows = self.measured[i] if self.measured else ()
            passed = self.passed(i) if rows else (-inf, inf)
            if amount and not (passed and passed[0] <= amount <= passed[1]):
                failed = ", ".join(dict.fromkeys(name for row in rows for name in row.failed))
                among = f"outside {passed[0]:g}:{passed[1]:g}, which passed" if passed else "no amount passed"
                out.append(f"{control.name} = {amount:g} {control.unit}: {among}; failed: {failed}")
        return tuple(out)

    def reservations(self, amounts: Amounts) -> tuple[str, ...]:
        """Return what was not good, although checks passed, at the measured amounts around those of each surface.

        A sentence names the measured amount if it is another one.
        """
        out = []
        for control, amount, rows in zip(self.controls, amounts, self.measured, strict=False):
            low = max((row.amount for row in rows if row.amount <= amount), default=amount)
            high = min((row.amount for row in rows if row.amount >= amount), default=amount)
            for row in (row for row in rows if row.amount in (low, high)):
                at = "" if row.amount == amount else f" at {row.amount:g} {control.unit}"
                out += [f"{text}{at}" for text in row.reservations]
        return tuple(dict.fromkeys(out))

    def is_measured(self, amounts: Amounts) -> bool:
        """Return whether at most one surface is away from where it stood during the checks."""
        return sum(amount != other for amount, other in zip(amounts, self.amounts, strict=True)) <= 1

    def in_order(self, amounts: Wanted) -> Amounts:
        """Return amounts in the order of the surfaces; InputError for a wrong name, number or amount."""
        return in_order(self.controls, amounts)

    def figures(self) -> list[dict[str, Any]]:
        """Return range, passed amounts and measurements of each surface, for JSON."""
        out = []
        for i, control in enumerate(self.controls):
            rows = [asdict(row) | {"least": row.least if isfinite(row.least) else None} for row in self.measured[i]]
            entry = {"name": control.name, "unit": control.unit, "range": [control.low, control.high]}
            out.append(entry | {"passed": self.passed(i), "measured": rows})
        return out

    @property
    def lines(self) -> list[str]:
        """Range, passed amounts and least quality of each surface, as text."""
        lines = []
        for i, control in enumerate(self.controls):
            passed = self.passed(i) if self.measured else None
            least = min((row.least for row in self.measured[i]), default=nan) if self.measured else nan
            said = f", passed {passed[0]:g}:{passed[1]:g}, least quality {least:.3f}" if passed else ""
            said = said or ", none passed" * bool(self.measured)
            lines.append(f"{control.name} {control.low:g}:{control.high:g} {control.unit}{said}")
        return lines

    def __repr__(self) -> str:
        return f"<MeshMotion: {'; '.join(self.lines)}>"


def _judgement(checks: Sequence[Check]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of failed checks, and what is not good although checks pass."""
    return tuple(check.name for check in checks if not check.passed), reservations(checks)


def _check_unmirrored(plan: Plan) -> None:
    """Raise InputError if a surface is the reflection of another one."""
    if any(box.mirror for box in plan.boxes):
        raise InputError(NO_MIRROR)


def _finer(box: BoxPlan) -> BoxPlan:
    """Return the box with smaller errors of its fits: those of surfaces with a range add up."""
    return replace(box, margin=float(max(1, sum(moving.ends[0] < moving.ends[1] for moving in box.job.surfaces))))


def control_name(moving: Moving, surface: Surface) -> str:
    """Return the name of a surface in a plan: without the panel that moves with its root."""
    panels = panels_of(moving, surface)
    return name_of([name for name in surface.patches if name not in panels]) + surface.suffix


def panels_of(moving: Moving, surface: Surface) -> tuple[str, ...]:
    """Return the patches of a surface that are panels of the body and follow its root."""
    named = moving.motion.panel if isinstance(moving.motion, RootOnCylinder) else ()
    return tuple(name for name in surface.patches if name in named or name not in surface.plain_names)
