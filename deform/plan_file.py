"""The file of a plan: its content, which is checked value by value when it is read."""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from hashlib import sha256
from math import isfinite, isnan
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.base.files import fresh
from sdm_deflect.base.unpacking import damaged, read_arrays
from sdm_deflect.deform.surface.motions import Fixed, Functions, Powers, Turn
from sdm_deflect.deform.surface.tracks import Places
from sdm_deflect.deform.volume.checksum import Checksum
from sdm_deflect.deform.volume.field import Field
from sdm_deflect.deform.volume.job import Amounts
from sdm_deflect.deform.volume.modes import Control, fields_of
from sdm_deflect.meshing.mesh.cells import LARGEST, bounded

FILE = "plan of sdm-deflect, 2"
EARLIER = "plan of sdm-deflect, 1"
KINDS: dict[str, Any] = {"turn": Turn, "powers": Powers, "fixed": Fixed, "places": Places}
"""Functions of the amount by their names in a file."""
KIND, PLAN, DIGEST = "kind", "plan", "digest"
"""Arrays of the file beside those of the fields."""


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

    def check(self, control: Control) -> None:
        """Raise ValueError if fields and weights do not suit the surface, or may move a point beyond `LARGEST`."""
        count, one = len(self.fields), isinstance(control.functions, Fixed)
        if one != (self.weights is None) or (count > 1 if one else not count):
            raise ValueError(f"{control.name}: {count} deflections, and weights that do not suit them")
        if self.weights is None:
            return
        if self.weights.shape != (control.functions.count, count):
            raise ValueError(f"weights {self.weights.shape} must be ({control.functions.count}, {count})")
        far = [max(np.abs(box.ends - box.places).max(initial=0.0) for box in field.boxes) for field in self.fields]
        if not (np.abs(bounded(self.weights, "weights")) @ far < LARGEST).all():
            raise ValueError(f"weights move points beyond {LARGEST:g}")


class StoredPlan(NamedTuple):
    """What the file of a plan holds.

    Attributes
    ----------
    controls, amounts, measured, placed, source, mesh : as in `HeldPlan`.
    """

    controls: tuple[Control, ...]
    amounts: Amounts
    measured: tuple[tuple[Measured, ...], ...]
    placed: tuple[PlacedFields, ...]
    source: str
    mesh: Checksum


class _Content(NamedTuple):
    """The content of the file that is text."""

    controls: tuple[dict[str, Any], ...]
    amounts: tuple[float, ...]
    measured: tuple[tuple[Measured, ...], ...]
    readings: tuple[int, ...]
    source: str
    mesh: tuple[int, ...]


def combine(weights: FloatArray | None, points: FloatArray, ends: list[FloatArray]) -> FloatArray:
    """Return the fields (k, M, 3) at points (M, 3), given their places (M, 3) in each reading.

    A plan for one amount has two fields; with the points they add up exactly to the final places.
    """
    if weights is not None:
        return fields_of(weights, [end - points for end in ends])
    move = ends[0] - points if ends else np.zeros_like(points)
    return np.stack([move, ends[0] - (points + move) if ends else move])


def is_plan(path: Path) -> bool:
    """Whether a file is a plan, of any version, by the names of its arrays."""
    try:
        with zipfile.ZipFile(path) as packed:
            return {f"{KIND}.npy", f"{PLAN}.npy"} <= {*packed.namelist()}
    except (OSError, zipfile.BadZipFile):
        return False


def write_plan(path: Path, plan: StoredPlan) -> None:
    """Write a plan completely or not at all; InputError for a file that is no plan, or that cannot be written."""
    names = {kind: name for name, kind in KINDS.items()}
    controls = [asdict(one) for one in plan.controls]
    for table, one in zip(controls, plan.controls, strict=True):
        table["functions"] = [names[type(one.functions)], *table["functions"].values()]
    content = {
        "controls": controls,
        "amounts": plan.amounts,
        "measured": [[asdict(row) for row in rows] for rows in plan.measured or [()] * len(controls)],
        "readings": [len(own.fields) for own in plan.placed],
        "source": plan.source,
        "mesh": plan.mesh,
    }
    arrays: dict[str, Any] = {KIND: np.array(FILE), PLAN: np.array(json.dumps(content))}
    for i, own in enumerate(plan.placed):
        if own.weights is not None:
            arrays[f"weights_{i}"] = own.weights
        for j, reading in enumerate(own.fields):
            arrays |= reading.arrays(f"_{i}_{j}")
    try:
        with fresh(path, earlier=is_plan) as beside, beside.open("wb") as file:
            arrays[DIGEST] = np.array(digest(arrays))
            np.savez_compressed(file, **arrays)
    except (MeshFileError, OSError) as error:
        raise InputError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None


def read_plan(path: Path) -> StoredPlan:
    """Read a plan; InputError if it is missing, damaged, changed or of another kind."""
    arrays = read_arrays(path)
    with damaged(path, "plan"):
        if str(arrays.get(KIND)) == EARLIER:
            raise InputError("an earlier version wrote it; make the plan again")
        if str(arrays.get(KIND)) != FILE:
            raise ValueError("it holds something else")
        if str(arrays.pop(DIGEST, "")) != digest(arrays):
            raise ValueError("it was changed after it was written")
        known = _value(json.loads(str(arrays[PLAN])), _Content)
        controls = tuple(map(_control, known.controls))
        count = len(controls)
        if not count or {len(known.amounts), len(known.measured), len(known.readings)} != {count}:
            raise ValueError("its lists are of different lengths")
        if Path(known.source).name != known.source or len(known.mesh) != 3 or min(known.mesh) < 0:
            raise ValueError("the name or the checksum of the mesh is wrong")
        placed = []
        for i, (control, readings) in enumerate(zip(controls, known.readings, strict=True)):
            read = tuple(Field.from_arrays(arrays, f"_{i}_{j}") for j in range(readings))
            placed.append(PlacedFields(read, arrays.get(f"weights_{i}")))
            placed[i].check(control)
            control.check(known.amounts[i])
            for row in known.measured[i]:
                control.check(row.amount)
        return StoredPlan(controls, known.amounts, known.measured, tuple(placed), known.source, Checksum(*known.mesh))


def digest(arrays: Mapping[str, Any]) -> str:
    """Return the SHA-256 of arrays with their names, shapes and types."""
    found = sha256()
    for name in sorted(arrays):
        one = np.ascontiguousarray(arrays[name])
        found.update(f"{name} {one.shape} {one.dtype.str};".encode() + one.tobytes())
    return found.hexdigest()


def _control(table: dict[str, Any]) -> Control:
    """Return a surface; ValueError for values that cannot be."""
    kind, *numbers = table.pop("functions")
    hints = get_type_hints(KINDS[kind])
    values = [_value(one, hints[own.name]) for own, one in zip(fields(KINDS[kind]), numbers, strict=True)]
    functions: Functions = KINDS[kind](*values)
    hints = {name: hint for name, hint in get_type_hints(Control).items() if name != "functions"}
    if {*table} != {*hints}:
        raise ValueError("a surface lacks a value")
    one = Control(**{name: _value(table[name], hint) for name, hint in hints.items()}, functions=functions)
    if not one.patches or not -LARGEST < one.low <= 0.0 <= one.high < LARGEST:
        raise ValueError(f"{one.name}: the range {one.low:g}:{one.high:g} does not hold 0, or there are no patches")
    functions.check()
    return one


def _value(given: Any, kind: Any) -> Any:
    """Return a value of JSON as a type; ValueError for another one, or for a number that is not finite.

    Only `least` of `Measured` may be NaN.
    """
    if kind in (Measured, _Content):
        hints = get_type_hints(kind)
        if not isinstance(given, dict) or {*given} != {*hints}:
            raise ValueError(f"{given!r:.80} lacks a value")
        found = {name: _value(given[name], hint) for name, hint in hints.items() if name != "least"}
        if "least" in hints:
            found["least"] = float("nan") if isnan(float(given["least"])) else _value(given["least"], float)
        return kind(**found)
    if get_origin(kind) is tuple and isinstance(given, list):
        return tuple(_value(one, get_args(kind)[0]) for one in given)
    if get_origin(kind) is dict and isinstance(given, dict):
        return dict(given)
    if kind is float and isinstance(given, int | float) and not isinstance(given, bool) and isfinite(given):
        return float(given)
    if kind in (int, bool, str) and type(given) is kind:
        return given
    raise ValueError(f"{given!r:.80} is of a wrong type")
