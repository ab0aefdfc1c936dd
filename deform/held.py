"""A held plan: the mesh at any amounts of its surfaces, and its derivatives, as sums of fixed fields."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from math import inf, isfinite, nan
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.deform.surface.motions import Fixed, Moving
from sdm_deflect.deform.surface.placement import UNITS
from sdm_deflect.deform.surface.surface import Surface, name_of
from sdm_deflect.deform.surface.tail_root import RootOnCylinder
from sdm_deflect.deform.volume.checksum import Checksum, Keys, place_keys
from sdm_deflect.deform.volume.deflection import BoxDeflection, Deflection
from sdm_deflect.deform.volume.field import Field, FieldBox
from sdm_deflect.deform.volume.job import Amounts
from sdm_deflect.deform.volume.modes import Control, Modes, Readings, Wanted, fields_of, in_order, residuals
from sdm_deflect.deform.volume.plan import BoxPlan, Plan
from sdm_deflect.meshing.mesh.precision import EVERY_BIT, Precision

from .checks import Check, checks_of
from .motion_fields import write_motion
from .plan_file import Measured, PlacedFields, StoredPlan, combine, read_plan, write_plan

MEASURED = 9
"""Number of amounts of each surface at which the mesh is checked."""
NO_MIRROR = "a plan holds no mirrored surface: leave mirror out, and give each surface its own hinge"
ANOTHER = "measured on another mesh"


@dataclass(frozen=True, eq=False)
class HeldPlan:
    """All that moves a mesh to any amounts of its surfaces within their ranges.

    Attributes
    ----------
    controls : the surfaces and their ranges.
    amounts : where the other surfaces stand while one is measured.
    measured : for each surface the checks at some amounts; empty until `judged`.
    placed : for each surface its fields as functions of place; None until needed.
    mesh : the plan at the nodes of its mesh; None for a plan from a file.
    source : name of the file of the undeflected mesh; empty if it came from elsewhere.
    nodes : the modes at all nodes; None to take them from `mesh`.
    stored_checksum : checksum of the mesh; None to take it from `mesh`.
    """

    controls: tuple[Control, ...]
    amounts: Amounts
    measured: tuple[tuple[Measured, ...], ...] = field(default=(), repr=False)
    placed: tuple[PlacedFields, ...] | None = field(default=None, repr=False)
    mesh: "OnMesh | None" = field(default=None, repr=False)
    source: str = ""
    nodes: Modes | None = field(default=None, repr=False)
    stored_checksum: Checksum | None = field(default=None, repr=False)

    @classmethod
    def of(cls, plan: Plan, progress: Progress = silent, known: Deflection | None = None) -> "HeldPlan":
        """Deflect each surface of a plan to the amounts to be read; surfaces without a range stay.

        A `known` deflection is used as it is.

        Raises InputError if no surface has a range, if one cannot move so far, or if the fields miss a deflection by
        more than a tenth of the tolerance, as on a triangulated slide.
        """
        plan = plan.keeping(EVERY_BIT)
        plan = replace(plan, boxes=tuple(map(_finer, plan.boxes)))
        if any(box.mirror for box in plan.boxes):
            raise InputError(NO_MIRROR)
        readings, places = [], []
        for b, box in enumerate(plan.boxes):
            for row, (moving, surface) in enumerate(box.moving):
                low, high = moving.ends
                if low < high:
                    functions = box.boundary.laws[row].functions.within(low, high)
                    control = Control(_name(moving, surface), surface.patches, moving.motion.unit, low, high, functions)
                    there = known.boxes[b] if known else None
                    readings.append(Readings.of(box, row, control, progress, there))
                    places.append(moving.amount)
        if not readings:
            raise InputError(f"{plan.mesh.name}: no surface has a range: give one, such as range = (-10, 25)")
        on_mesh, source = OnMesh(plan, tuple(readings)), Path(plan.mesh.source).name
        return cls(tuple(one.control for one in readings), tuple(places), mesh=on_mesh, source=source)

    @classmethod
    def of_one_amount(cls, found: Deflection, failed: Sequence[str]) -> "HeldPlan":
        """Hold an unrounded deflection and the names of its failed checks; it serves these amounts alone."""
        found = found.rounded(EVERY_BIT)
        plan, controls, placed = found.plan, [], []
        if any(box.mirror for box in plan.boxes):
            raise InputError(NO_MIRROR)
        first = _first(found.amounts)
        for i, ((moving, surface), amount) in enumerate(zip(plan.moving, found.amounts, strict=True)):
            ends = min(0.0, amount), max(0.0, amount)
            controls.append(Control(_name(moving, surface), surface.patches, moving.motion.unit, *ends, Fixed(amount)))
            placed.append(PlacedFields((Field.of(found.boxes),) if i == first else (), None))
        least = min((one.min for one in found.quality), default=nan)
        error = max(box.site_error for box in found.boxes)
        one = Measured(found.amounts[first], least, found.inverted, error, tuple(failed))
        measured = tuple((one,) if i == first else () for i in range(len(controls)))
        own, source = OnMesh(plan, (), tuple(controls), found), Path(plan.mesh.source).name
        return cls(tuple(controls), found.amounts, measured, tuple(placed), own, source)

    @classmethod
    def load(cls, path: str | PathLike[str], points: FloatArray | None = None) -> "HeldPlan":
        """Read a file of `save`.

        Parameters
        ----------
        path : The file.
        points : (N, 3) undeflected coordinates of the mesh, for which `at`, `jvp` and `vjp` then answer.

        Raises InputError if the file is missing, damaged or of another kind, or as `on`.
        """
        controls, amounts, measured, placed, source, mesh = read_plan(Path(path))
        one = cls(controls, amounts, measured, placed, source=source, stored_checksum=mesh)
        return one if points is None else replace(one, nodes=one.on(points))

    def reading(self, coordinates: Callable[[], FloatArray]) -> "HeldPlan":
        """Return the same plan of a part of a mesh, with what reads the coordinates (N, 3) of the whole."""
        return replace(self, mesh=replace(self._on_mesh, coordinates=coordinates))

    def save(self, path: str | PathLike[str]) -> None:
        """Write the plan to a file, completely or not at all; `load` restores it exactly.

        Raises InputError if the file cannot be written, or is there and no plan.
        """
        own = self.controls, self.amounts, self.measured, self.by_place, self.source, self.checksum
        write_plan(Path(path), StoredPlan(*own))

    def save_openfoam(self, case: str | PathLike[str], points: FloatArray | None = None) -> tuple[Path, ...]:
        """Write the plan into a case of OpenFOAM, for the solver in `solvers/openfoam`; return the files.

        `points` (N, 3) are the case's undeflected ones, in its order; those of the plan's mesh if None. Raises
        InputError as `write_motion` and `on` do, or for a plan from a file without points.
        """
        return write_motion(Path(case), self.modes if points is None else self.on(points))

    @cached_property
    def checksum(self) -> Checksum:
        """Checksum of the mesh on which the plan was measured."""
        return self.stored_checksum or self._on_mesh.checksum(self.boxes)

    @cached_property
    def by_place(self) -> tuple[PlacedFields, ...]:
        """Fields of each surface as functions of place; InputError if nodes at one place move differently."""
        if self.placed is not None:
            return self.placed
        readings = self._on_mesh.readings
        return tuple(PlacedFields(tuple(Field.of([one]) for one in own.deflections), own.weights) for own in readings)

    def on(self, points: FloatArray) -> Modes:
        """Return the modes at undeflected points (N, 3), all nodes of the mesh or any part of them.

        Raises InputError if the points are not finite (N, 3), or are not those on which the plan was measured: rounded,
        deflected, or in another unit of length. Of a part some faults cannot be seen.
        """
        found = self.at_places(points)
        self.check_mesh(found.start)
        return found

    def at_places(self, points: FloatArray) -> Modes:
        """Return the modes at undeflected points (N, 3) that are known to belong to the mesh."""
        rows, fields = [], []
        for own in self.by_place:
            found = own.on(points)
            rows.append(np.flatnonzero(found.any(axis=(0, 2))))
            fields.append(found[:, rows[-1]])
        return Modes(self.controls, np.asarray(points, dtype=np.float64), tuple(rows), tuple(fields))

    def check_mesh(self, points: FloatArray) -> None:
        """Raise InputError if points (N, 3) are not nodes of the mesh of this plan, as `on`."""
        exact, near = np.concatenate([box.matches(points) for box in self.boxes], axis=1)
        if rounded := int((near & ~exact).sum()):
            raise InputError(f"points: {rounded} are near a place of the plan, but not on it: give all digits")
        hint = "" if exact.any() else unit_hint(self.boxes, points)
        keys = [place_keys(points[box.inside(points)]) for box in self.boxes]
        whole = len(points) >= self.checksum.points
        if fault := hint or self.mesh_fault(Checksum.of(len(points), keys), whole):
            raise InputError(f"points: {fault}")

    @property
    def boxes(self) -> list[FieldBox]:
        """The boxes in which surfaces move."""
        return [box for own in self.by_place for one in own.fields[:1] for box in one.boxes]

    def mesh_fault(self, found: Checksum, whole: bool) -> str:
        """Return why what was found is not the plan's mesh, or cannot be a part of it; empty if nothing is wrong."""
        wanted = self.checksum
        if (found.places, found.total) == (wanted.places, wanted.total) or (not whole and found.places < wanted.places):
            return ""
        if found.places != wanted.places:
            return f"{ANOTHER}, with {wanted.places} places in the box; here are {found.places}"
        return f"{ANOTHER}: in the box some of its {wanted.places} places are elsewhere"

    def at_nodes(self, points: FloatArray) -> Modes:
        """Return the modes at the nodes (N, 3) of the mesh: the plan's own, if it has them."""
        return self.mesh.modes if self.mesh else self.on(points)

    @property
    def modes(self) -> Modes:
        """Modes at all nodes of the mesh, even if the plan holds a part of it; InputError for a plan from a file."""
        return self.nodes or self._on_mesh.whole_modes

    def at(self, amounts: Wanted) -> FloatArray:
        """Return the coordinates (N, 3) of the mesh at amounts; at 0 they equal the mesh's exactly.

        Parameters
        ----------
        amounts : One number for a single surface; numbers by name, 0 where left out; or numbers of all surfaces in
            order. Degrees, or shares of a table.

        Raises InputError for an amount outside its range, or for a plan from a file without points: see `load`.
        """
        return self.modes.at(amounts)

    def jvp(self, amounts: Wanted, speeds: Wanted) -> FloatArray:
        """Return the derivative (N, 3) of the coordinates along `speeds`, which are given like amounts."""
        return self.modes.jvp(amounts, speeds)

    def vjp(self, amounts: Wanted, gradient: ArrayLike) -> FloatArray:
        """Return the derivative (n,) by the amounts of a function whose gradient by the coordinates is (N, 3).

        Raises InputError for a gradient of another shape.
        """
        return self.modes.vjp(amounts, gradient)

    def deflection(self, amounts: Wanted, precision: Precision = EVERY_BIT) -> Deflection:
        """Return the mesh at amounts as a deflection, with the steps of the nearest reading."""
        return self._on_mesh.deflection(self.in_order(amounts), precision)

    def at_pose(self, pose: Amounts, precision: Precision = EVERY_BIT) -> Deflection:
        """Return the mesh at a pose of the plan's surfaces, rounded for a file."""
        return self._on_mesh.deflection(self._on_mesh.pose(pose), precision)

    def rates(self, pose: Amounts) -> dict[str, FloatArray]:
        """Return the derivative (N, 3) of the coordinates by each surface's amount, by the surface's name."""
        there, units = self._on_mesh.pose(pose), np.eye(len(self.controls))
        names = (one.name for one in self.controls)
        return {name: self._on_mesh.modes.jvp(there, tuple(unit)) for name, unit in zip(names, units, strict=True)}

    def check(self, amounts: Wanted) -> tuple[Check, ...]:
        """Return all checks of the mesh at amounts."""
        return checks_of(self.deflection(amounts))

    def judged(self, progress: Progress = silent, count: int = MEASURED) -> "HeldPlan":
        """Return the plan with its mesh checked at amounts of each surface, the others where they stand.

        They are `count` even ones, and the rows of a track.
        """
        measured = []
        for i, control in enumerate(self.controls):
            rows = []
            amounts = control.measured(count)
            for k, amount in enumerate(amounts):
                progress(f"judging {control.name}", (i + k / len(amounts)) / len(self.controls))
                pose = [amount if i == j else other for j, other in enumerate(self.amounts)]
                found = self.deflection(pose)
                box = found.boxes[self._on_mesh.box_of(i)]
                least = min((one.min for one in box.quality), default=nan)
                failed = tuple(check.name for check in checks_of(found) if not check.passed)
                rows.append(Measured(amount, least, box.inverted, box.site_error, failed))
            measured.append(tuple(rows))
        return replace(self, measured=tuple(measured))

    def passed(self, row: int) -> tuple[float, float] | None:
        """Return the range of a surface's amounts around where it stands that passed; None if none did."""
        good, bad = ([one.amount for one in self.measured[row] if bool(one.failed) is fails] for fails in (False, True))
        here = min(good, key=lambda amount: abs(amount - self.amounts[row]), default=None)
        if here is None:
            return None
        low, high = (max((x for x in bad if x < here), default=-inf), min((x for x in bad if x > here), default=inf))
        around = [amount for amount in good if low < amount < high]
        return min(around), max(around)

    @property
    def shortfalls(self) -> tuple[str, ...]:
        """A sentence for each surface whose range did not pass as a whole: what did, and half of it as the next try."""
        out = []
        for i, one in enumerate(self.controls):
            passed = self.passed(i) if self.measured and self.measured[i] else (one.low, one.high)
            if passed != (one.low, one.high):
                part = f"passed {passed[0]:g}:{passed[1]:g} of" if passed else "passed nowhere in"
                half = f"{0.5 * one.low:g}:{0.5 * one.high:g}"
                out.append(f"{one.name} {part} {one.low:g}:{one.high:g} {one.unit}; try range {half}")
        return tuple(out)

    def faults(self, amounts: Amounts) -> tuple[str, ...]:
        """Return a sentence for each surface whose amount is outside of those that passed."""
        out = []
        for i, (control, amount) in enumerate(zip(self.controls, amounts, strict=True)):
            rows = self.measured[i] if self.measured else ()
            passed = self.passed(i) if rows else (-inf, inf)
            if amount and not (passed and passed[0] <= amount <= passed[1]):
                failed = ", ".join(dict.fromkeys(name for one in rows for name in one.failed))
                among = f"outside {passed[0]:g}:{passed[1]:g}, which passed" if passed else "no amount passed"
                out.append(f"{control.name} = {amount:g} {control.unit}: {among}; failed: {failed}")
        return tuple(out)

    def is_measured(self, amounts: Amounts) -> bool:
        """Return whether at most one surface is away from where it stood during the checks."""
        return sum(one != other for one, other in zip(amounts, self.amounts, strict=True)) <= 1

    def in_order(self, amounts: Wanted) -> Amounts:
        """Return the amounts in the order of the surfaces; InputError as for `Modes.at`."""
        return in_order(self.controls, amounts)

    @property
    def _on_mesh(self) -> "OnMesh":
        if self.mesh is None:
            raise InputError(
                "a plan from a file has no mesh: give the undeflected points (N, 3) to HeldPlan.load, or take "
                "plan.on(points)"
            )
        return self.mesh

    def figures(self) -> list[dict[str, Any]]:
        """Return range, passed amounts and measurements of each surface, for JSON."""
        out = []
        for i, one in enumerate(self.controls):
            rows = [asdict(row) | {"least": row.least if isfinite(row.least) else None} for row in self.measured[i]]
            own = {"name": one.name, "unit": one.unit, "range": [one.low, one.high]}
            out.append(own | {"passed": self.passed(i), "measured": rows})
        return out

    @property
    def lines(self) -> list[str]:
        """Range, passed amounts and least quality of each surface, as text."""
        lines = []
        for i, one in enumerate(self.controls):
            passed = self.passed(i) if self.measured else None
            least = min((row.least for row in self.measured[i]), default=nan) if self.measured else nan
            said = f", passed {passed[0]:g}:{passed[1]:g}, least quality {least:.3f}" if passed else ""
            said = said or ", none passed" * bool(self.measured)
            lines.append(f"{one.name} {one.low:g}:{one.high:g} {one.unit}{said}")
        return lines

    def __repr__(self) -> str:
        return f"<HeldPlan: {'; '.join(self.lines)}>"


@dataclass(frozen=True, eq=False)
class OnMesh:
    """A held plan at the nodes of its mesh.

    Attributes
    ----------
    plan : the plan.
    readings : the deflections that were read.
    controls, found : of a plan of one amount its surfaces and its deflection, in place of readings.
    coordinates : reads all nodes (N, 3) of the whole mesh, if the plan holds a part of it.
    """

    plan: Plan
    readings: tuple[Readings, ...]
    controls: tuple[Control, ...] = ()
    found: Deflection | None = None
    coordinates: Callable[[], FloatArray] | None = None

    @cached_property
    def whole_modes(self) -> Modes:
        """Modes at all nodes of the mesh; the plan may hold a part of them."""
        whole, own = self.plan.mesh.whole, self.modes
        if whole is None or self.coordinates is None:
            return own
        return replace(own, start=self.coordinates(), rows=tuple(whole.nodes[rows] for rows in own.rows))

    def checksum(self, boxes: Sequence[FieldBox]) -> Checksum:
        """Return the checksum of the mesh, for the boxes in which surfaces move."""
        mesh, keys = self.plan.mesh, list[Keys]()
        for zone in mesh.zones:
            points = mesh.points[zone.start : zone.stop]
            keys += [place_keys(points[box.inside(points)]) for box in boxes if zone.name in box.zones]
        return Checksum.of(mesh.point_count, keys)

    @cached_property
    def modes(self) -> Modes:
        """Modes at all nodes that the plan holds."""
        start, rows, fields = self.plan.mesh.points, [], []
        if self.found:
            moved = np.flatnonzero((self.found.points != start).any(axis=1))
            whole = combine(None, start[moved], [self.found.points[moved]])
            brings = [i == _first(self.found.amounts) for i in range(len(self.controls))]
            nodes = tuple(moved[: len(moved) * one] for one in brings)
            moves = tuple(whole[:, : len(moved) * one] for one in brings)
            return Modes(self.controls, start, nodes, moves)
        for own in self.readings:
            rows.append(own.box.movable)
            ends = [one.exact[rows[-1]] for one in own.deflections]
            fields.append(combine(own.weights, start[rows[-1]], ends))
        return Modes(tuple(own.control for own in self.readings), start, tuple(rows), tuple(fields))

    @cached_property
    def residuals(self) -> tuple[FloatArray, ...]:
        """For each surface the errors of its fields at the data sites in each step (k, steps, S, 3)."""
        most = max(len(one.steps) for own in self.readings for one in own.deflections)
        missed = ([residuals(one, most) for one in own.deflections] for own in self.readings)
        return tuple(fields_of(own.weights, some) for own, some in zip(self.readings, missed, strict=True))

    def box_of(self, row: int) -> int:
        """Return the index of a surface's box."""
        return next(b for b, box in enumerate(self.plan.boxes) if box is self.readings[row].box)

    def pose(self, pose: Amounts) -> Amounts:
        """Return the amounts of the surfaces with a range, given those of all."""
        parts = {id(box): own for box, own in self.plan.by_box(pose)}
        return tuple(parts[id(own.box)][own.row] for own in self.readings)

    def deflection(self, amounts: Amounts, precision: Precision) -> Deflection:
        points, boxes = self.modes.at(amounts), []
        plan = self.plan.keeping(precision)
        for box, of in zip(plan.boxes, self.plan.boxes, strict=True):
            pose, read, missed = [0.0] * len(box.job.surfaces), None, np.zeros(1)
            for own, amount, off in zip(self.readings, amounts, self.residuals, strict=True):
                if own.box is of:
                    pose[own.row] = amount
                    read = read or own.nearest(amount)
                    missed = missed + np.tensordot(own.control.functions.values(amount), off, 1)
            steps, at = (read.steps, read.amounts) if read else ((), None)
            boxes.append(BoxDeflection(box, tuple(pose), steps, points, 0.0, None, at, float(np.abs(missed).max())))
        return Deflection(plan, tuple(boxes))


def unit_hint(boxes: Iterable[FieldBox], points: FloatArray) -> str:
    """Name the unit of length in which points (N, 3) would be places of a plan, as a sentence; empty if none fits."""
    for factor in UNITS:
        if any(match.any() for box in boxes for match in box.matches(points * factor)):
            return f"times {factor:.4g} they would be those of the plan: give them in its unit of length"
    return ""


def _first(amounts: Amounts) -> int:
    """Return the index of the first surface that moves, which brings all nodes there in a plan of one amount."""
    return next((i for i, amount in enumerate(amounts) if amount), 0)


def _finer(box: BoxPlan) -> BoxPlan:
    """Return a box whose fits are finer by the number of its surfaces with a range: their errors add up."""
    return replace(box, margin=float(max(1, sum(moving.ends[0] < moving.ends[1] for moving in box.job.surfaces))))


def _name(moving: Moving, surface: Surface) -> str:
    """Return a name for a surface, without the panel that moves with its root."""
    following = moving.motion.panel if isinstance(moving.motion, RootOnCylinder) else ()
    return name_of([name for name in surface.plain_names if name not in following])
