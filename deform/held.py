"""A held plan: the mesh at any amounts of its surfaces, and its derivatives, as sums of fixed fields."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from math import inf, isfinite, nan
from os import PathLike
from pathlib import Path
from shutil import copymode
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError, nearest, shortened
from sdm_deflect.deform.base.threads import Progress, silent
from sdm_deflect.deform.base.unpacking import damaged, read_arrays
from sdm_deflect.deform.mesh.precision import EVERY_BIT, Precision
from sdm_deflect.deform.surface.motions import Fixed, Moving, Powers, Turn
from sdm_deflect.deform.surface.surface import Surface, name_of
from sdm_deflect.deform.surface.tail_root import RootOnCylinder
from sdm_deflect.deform.surface.tracks import Places
from sdm_deflect.deform.volume.deflection import BoxDeflection, Deflection
from sdm_deflect.deform.volume.field import Field
from sdm_deflect.deform.volume.job import Amounts
from sdm_deflect.deform.volume.modes import Control, Modes, Readings, fields_of, residuals
from sdm_deflect.deform.volume.plan import BoxPlan, Plan

from .checks import Check, checks_of
from .motion_fields import write_motion

FILE = "plan of sdm-deflect, 1"
MEASURED = 9
"""Number of amounts of each surface at which the mesh is checked."""
NO_MIRROR = "a plan holds no mirrored surface: leave mirror out, and give each surface its own hinge"
KINDS: dict[str, Any] = {"turn": Turn, "powers": Powers, "fixed": Fixed, "places": Places}
"""Functions of the amount by their names in a file."""
Wanted = float | Mapping[str, float] | Sequence[float]
"""Amounts: of the only surface; by name, 0 where left out; or of all surfaces in order."""


@dataclass(frozen=True, slots=True)
class Measured:
    """Checks of the mesh with one surface at an amount and the others where they stand.

    Attributes
    ----------
    amount : amount of the surface.
    least : least quality of the cells that the surface's box may change; nan without cells.
    inverted : number of these cells that are newly inverted.
    site_error : largest error at a data site of the box, a length.
    failed : names of the failed checks of the whole mesh.
    """

    amount: float
    least: float
    inverted: int
    site_error: float
    failed: tuple[str, ...]


class PlacedFields(NamedTuple):
    """Deflections of one surface as functions of place, and their weights (k, r).

    A plan for one amount has one deflection and no weights.
    """

    fields: tuple[Field, ...]
    weights: FloatArray | None

    def on(self, points: FloatArray) -> FloatArray:
        """Return the fields (k, N, 3) at undeflected points (N, 3)."""
        return combine(self.weights, points, [one.apply(points) for one in self.fields])

    def move(self, points: FloatArray, values: FloatArray, out: FloatArray) -> None:
        """Add the displacement of undeflected points (N, 3) to `out` (N, 3), at values (k,) of the functions."""
        for value, one in zip(values, self.on(points), strict=True):
            out += value * one

    @property
    def zones(self) -> tuple[str, ...]:
        """Names of the zones that deform."""
        return tuple(dict.fromkeys(name for one in self.fields for box in one.boxes for name in box.zones))


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
    """

    controls: tuple[Control, ...]
    amounts: Amounts
    measured: tuple[tuple[Measured, ...], ...] = field(default=(), repr=False)
    placed: tuple[PlacedFields, ...] | None = field(default=None, repr=False)
    mesh: "OnMesh | None" = field(default=None, repr=False)
    source: str = ""

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
        plan, controls, placed = found.plan, [], []
        if any(box.mirror for box in plan.boxes):
            raise InputError(NO_MIRROR)
        first = next((i for i, amount in enumerate(found.amounts) if amount), 0)
        for i, ((moving, surface), amount) in enumerate(zip(plan.moving, found.amounts, strict=True)):
            ends = min(0.0, amount), max(0.0, amount)
            controls.append(Control(_name(moving, surface), surface.patches, moving.motion.unit, *ends, Fixed(amount)))
            placed.append(PlacedFields((Field.of(found.boxes),) if i == first else (), None))
        least = min((one.min for one in found.quality), default=nan)
        error = max(box.site_error for box in found.boxes)
        one = Measured(found.amounts[first], least, found.inverted, error, tuple(failed))
        measured = tuple((one,) if i == first else () for i in range(len(controls)))
        source = Path(plan.mesh.source).name
        return cls(tuple(controls), found.amounts, measured, tuple(placed), source=source)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "HeldPlan":
        """Read a file of `save`; InputError if it is missing, damaged or of another kind."""
        stored = read_arrays(Path(path))
        with damaged(Path(path), FILE):
            if str(stored["kind"]) != FILE:
                raise ValueError("it holds something else")
            known = json.loads(str(stored["plan"]))
            controls, measured, placed = [], [], []
            for i, one in enumerate(known["controls"]):
                kind, *numbers = one.pop("functions")
                functions, patches = KINDS[kind](*numbers), tuple(map(str, one.pop("patches")))
                controls.append(Control(functions=functions, patches=patches, **one))
                rows = (row | {"failed": tuple(row["failed"])} for row in known["measured"][i])
                measured.append(tuple(Measured(**row) for row in rows))
                fields = (Field.from_arrays(stored, f"_{i}_{j}") for j in range(known["readings"][i]))
                weights = stored.get(f"weights_{i}")
                placed.append(PlacedFields(tuple(fields), weights))
            own = tuple(controls), tuple(known["amounts"]), tuple(measured), tuple(placed)
            return cls(*own, source=str(known.get("source", "")))

    def save(self, path: str | PathLike[str]) -> None:
        """Write the plan to a file, completely or not at all; `load` restores it exactly."""
        arrays: dict[str, Any] = {"kind": np.array(FILE)}
        names = {kind: name for name, kind in KINDS.items()}
        controls = [asdict(one) for one in self.controls]
        for table, one in zip(controls, self.controls, strict=True):
            table["functions"] = [names[type(one.functions)], *table["functions"].values()]
        for i, own in enumerate(self.by_place):
            if own.weights is not None:
                arrays[f"weights_{i}"] = own.weights
            for j, reading in enumerate(own.fields):
                arrays |= reading.arrays(f"_{i}_{j}")
        known = {
            "controls": controls,
            "amounts": self.amounts,
            "measured": [[asdict(row) for row in rows] for rows in self.measured or [()] * len(controls)],
            "readings": [len(own.fields) for own in self.by_place],
            "source": self.source,
        }
        arrays["plan"] = np.array(json.dumps(known))
        with TemporaryDirectory(prefix=".sdm-", dir=Path(path).parent) as folder:
            beside = Path(folder, "plan.npz")
            np.savez_compressed(beside, **arrays)
            with suppress(FileNotFoundError):
                copymode(path, beside)
            beside.replace(path)

    def save_openfoam(self, case: str | PathLike[str], points: FloatArray | None = None) -> tuple[Path, ...]:
        """Write the plan into a case of OpenFOAM, for the solver in `solvers/openfoam`; return the files.

        `points` (N, 3) are the case's undeflected ones, in its order; those of the plan's mesh if None. Raises
        InputError as `write_motion` does, or for a plan from a file without points.
        """
        return write_motion(Path(case), self.modes if points is None else self.on(points))

    @cached_property
    def by_place(self) -> tuple[PlacedFields, ...]:
        """Fields of each surface as functions of place; InputError if nodes at one place move differently."""
        if self.placed is not None:
            return self.placed
        readings = self._on_mesh.readings
        return tuple(PlacedFields(tuple(Field.of([one]) for one in own.deflections), own.weights) for own in readings)

    def on(self, points: FloatArray) -> Modes:
        """Return the modes at undeflected points (N, 3), any part of the mesh.

        Nodes with prescribed places are found by their exact coordinates. InputError if the points are not finite (N,
        3).
        """
        rows, fields = [], []
        for own in self.by_place:
            found = own.on(points)
            rows.append(np.flatnonzero(found.any(axis=(0, 2))))
            fields.append(found[:, rows[-1]])
        return Modes(self.controls, points, tuple(rows), tuple(fields))

    def at_nodes(self, points: FloatArray) -> Modes:
        """Return the modes at the nodes (N, 3) of the mesh: the plan's own, if it has them."""
        return self.mesh.modes if self.mesh else self.on(points)

    @property
    def modes(self) -> Modes:
        """Modes at all nodes of the mesh, even if the plan holds a part of it; InputError for a plan from a file."""
        whole = self._on_mesh.plan.mesh.whole
        return self.on(whole.pieces.coordinates(0, whole.pieces.points)) if whole else self._on_mesh.modes

    def at(self, amounts: Wanted) -> FloatArray:
        """Return the coordinates (N, 3) of the mesh at amounts; at 0 they equal the mesh's exactly.

        Parameters
        ----------
        amounts : One number for a single surface; numbers by name, 0 where left out; or numbers of all surfaces in
            order. Degrees, or shares of a table.

        Raises InputError for an amount outside its range, or for a plan from a file, which has no mesh: see `on`.
        """
        return self._on_mesh.modes.at(self.in_order(amounts))

    def jvp(self, amounts: Wanted, speeds: Wanted) -> FloatArray:
        """Return the derivative (N, 3) of the coordinates along `speeds`, which are given like amounts."""
        return self._on_mesh.modes.jvp(self.in_order(amounts), self.in_order(speeds))

    def vjp(self, amounts: Wanted, gradient: ArrayLike) -> FloatArray:
        """Return the derivative (n,) by the amounts of a function whose gradient by the coordinates is (N, 3)."""
        return self._on_mesh.modes.vjp(self.in_order(amounts), np.asarray(gradient, dtype=np.float64))

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
        """Return the plan with its mesh checked at `count` amounts of each surface, the others where they stand."""
        measured = []
        for i, control in enumerate(self.controls):
            rows = []
            for k, amount in enumerate(control.samples(count)):
                progress(f"judging {control.name}", (i + k / count) / len(self.controls))
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

    def check_ranges(self, amounts: Amounts) -> None:
        """Raise InputError for an amount outside its range."""
        for control, amount in zip(self.controls, amounts, strict=True):
            control.check(amount)

    def is_measured(self, amounts: Amounts) -> bool:
        """Return whether at most one surface is away from where it stood during the checks."""
        return sum(one != other for one, other in zip(amounts, self.amounts, strict=True)) <= 1

    def in_order(self, amounts: Wanted) -> Amounts:
        """Return the amounts in the order of the surfaces; InputError for a wrong name or number of them."""
        if isinstance(amounts, Mapping):
            out = [0.0] * len(self.controls)
            for name, amount in amounts.items():
                out[self._row(name)] = float(amount)
            return tuple(out)
        found = np.atleast_1d(np.asarray(amounts, dtype=np.float64))
        if found.shape != (len(self.controls),):
            names = ", ".join(one.name for one in self.controls)
            raise InputError(f"amounts = {shortened(amounts)}: the plan has {len(self.controls)} surfaces: {names}")
        return tuple(found.tolist())

    def _row(self, name: str) -> int:
        for i, control in enumerate(self.controls):
            if name == control.name or name in control.patches:
                return i
        raise InputError(f"{name!r} is no surface of the plan; {nearest(name, [one.name for one in self.controls])}")

    @property
    def _on_mesh(self) -> "OnMesh":
        if self.mesh is None:
            raise InputError("a plan from a file has no mesh: take plan.on(points), the undeflected coordinates (N, 3)")
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
    """A held plan at the nodes of its mesh: the plan, and the deflections that were read."""

    plan: Plan
    readings: tuple[Readings, ...]

    @cached_property
    def modes(self) -> Modes:
        """Modes at all nodes."""
        start, rows, fields = self.plan.mesh.points, [], []
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


def _finer(box: BoxPlan) -> BoxPlan:
    """Return a box whose fits are finer by the number of its surfaces with a range: their errors add up."""
    return replace(box, margin=float(max(1, sum(moving.ends[0] < moving.ends[1] for moving in box.job.surfaces))))


def _name(moving: Moving, surface: Surface) -> str:
    """Return a name for a surface, without the panel that moves with its root."""
    following = moving.motion.panel if isinstance(moving.motion, RootOnCylinder) else ()
    return name_of([name for name in surface.plain_names if name not in following])


def combine(weights: FloatArray | None, points: FloatArray, ends: Sequence[FloatArray]) -> FloatArray:
    """Return the fields (k, M, 3) at points (M, 3), given their places (M, 3) in each reading.

    A plan for one amount has two fields; with the points they add up exactly to the final places.
    """
    if weights is not None:
        return fields_of(weights, [end - points for end in ends])
    move = ends[0] - points if ends else np.zeros_like(points)
    return np.stack([move, ends[0] - (points + move) if ends else move])
