"""The file of a plan: arrays and a text, which are checked value by value when they are read."""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from hashlib import sha256
from math import isfinite, isnan
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.base.files import fresh
from sdm_deflect.base.unpacking import damaged, read_arrays
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.surface.motions import Fixed, Functions, Powers, Turn
from sdm_deflect.deform.surface.tracks import Places
from sdm_deflect.deform.volume.controls import ControlRange
from sdm_deflect.deform.volume.job import Amounts
from sdm_deflect.deform.volume.places import PlaceTable, PlanBox
from sdm_deflect.meshing.mesh.cells import LARGEST, bounded
from sdm_deflect.meshing.mesh.thin import MidPlane

FILE = "plan of sdm-deflect, 4"
EARLIER = tuple(f"plan of sdm-deflect, {version}" for version in range(1, 4))
# Functions of the amount by their names in a file.
KINDS: dict[str, Any] = {"turn": Turn, "powers": Powers, "fixed": Fixed, "places": Places}
# Arrays of the file beside places, fields and boxes.
KIND, PLAN, DIGEST = "kind", "plan", "digest"


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
    reservations : what is not good of it although its checks pass, such as ``"36 of 30,926 tetrahedra poor"``.
    """

    amount: float
    least: float
    inverted: int
    site_error: float
    failed: tuple[str, ...]
    reservations: tuple[str, ...]


class StoredPlan(NamedTuple):
    """What the file of a plan holds.

    Attributes
    ----------
    controls, amounts, measured, rows, fields, source, table : as in `MeshMotion`; rows are those of the table.
    """

    controls: tuple[ControlRange, ...]
    amounts: Amounts
    measured: tuple[tuple[Measured, ...], ...]
    rows: tuple[IntArray, ...]
    fields: tuple[FloatArray, ...]
    source: str
    table: PlaceTable


class _Text(NamedTuple):
    """The text of the file: `boxes` has the zones of each box, `mesh` the numbers of nodes and zones."""

    controls: tuple[dict[str, Any], ...]
    amounts: tuple[float, ...]
    measured: tuple[tuple[Measured, ...], ...]
    boxes: tuple[tuple[str, ...], ...]
    source: str
    mesh: tuple[int, ...]


def is_plan(path: Path) -> bool:
    """Whether a file is a plan, of any version, by the names of its arrays."""
    try:
        with zipfile.ZipFile(path) as packed:
            return {f"{KIND}.npy", f"{PLAN}.npy"} <= {*packed.namelist()}
    except (OSError, zipfile.BadZipFile):
        return False


def write_plan(path: Path, plan: StoredPlan) -> None:
    """Write a plan completely or not at all; InputError for a file that is no plan, or that cannot be written."""
    names, table = {kind: name for name, kind in KINDS.items()}, plan.table
    controls = [asdict(control) for control in plan.controls]
    for entry, control in zip(controls, plan.controls, strict=True):
        entry["functions"] = [names[type(control.functions)], *entry["functions"].values()]
    text = {
        "controls": controls,
        "amounts": plan.amounts,
        "measured": [[asdict(row) for row in rows] for rows in plan.measured or [()] * len(controls)],
        "boxes": [box.zones for box in table.boxes],
        "source": plan.source,
        "mesh": [table.mesh_points, table.zones],
    }
    arrays: dict[str, Any] = {KIND: np.array(FILE), PLAN: np.array(json.dumps(text))}
    arrays |= {"places": table.places, "box": table.box}
    for i, (rows, moves) in enumerate(zip(plan.rows, plan.fields, strict=True)):
        arrays |= {f"rows_{i}": rows, f"fields_{i}": moves}
    for b, box in enumerate(table.boxes):
        arrays[f"corners_{b}"] = box.hexahedron.corners
        if box.halfway:
            arrays[f"halfway_{b}"] = box.halfway.numbers
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
        if str(arrays.get(KIND)) in EARLIER:
            raise InputError("an earlier version wrote it; make the plan again")
        if str(arrays.get(KIND)) != FILE:
            raise ValueError("it holds something else")
        if str(arrays.pop(DIGEST, "")) != digest(arrays):
            raise ValueError("it was changed after it was written")
        text = _value(json.loads(str(arrays[PLAN])), _Text)
        controls = tuple(map(_control, text.controls))
        if not controls or {len(text.amounts), len(text.measured)} != {len(controls)}:
            raise ValueError("its lists are of different lengths")
        if Path(text.source).name != text.source or len(text.mesh) != 2 or min(text.mesh) < 1:
            raise ValueError("the name of the mesh or its numbers are wrong")
        table = _table(arrays, text)
        rows = tuple(_indices(arrays, f"rows_{i}", len(table.places), True) for i in range(len(controls)))
        shapes = ((control.functions.count, len(row), 3) for control, row in zip(controls, rows, strict=True))
        moves = tuple(_bounded(arrays, f"fields_{i}", shape) for i, shape in enumerate(shapes))
        for control, base, measured in zip(controls, text.amounts, text.measured, strict=True):
            for amount in (base, *(row.amount for row in measured)):
                control.check(amount)
        return StoredPlan(controls, text.amounts, text.measured, rows, moves, text.source, table)


def digest(arrays: Mapping[str, Any]) -> str:
    """Return the SHA-256 of arrays with their names, shapes and types."""
    hashed = sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        hashed.update(f"{name} {array.shape} {array.dtype.str};".encode() + array.tobytes())
    return hashed.hexdigest()


def _table(arrays: Mapping[str, Any], text: _Text) -> PlaceTable:
    """Return places and boxes; ValueError or KeyError if they do not fit together."""
    boxes = []
    for b, zones in enumerate(text.boxes):
        numbers = bounded(arrays[f"halfway_{b}"], "halfway") if f"halfway_{b}" in arrays else None
        halfway = None if numbers is None else MidPlane.from_numbers(numbers)
        boxes.append(PlanBox(Hexahedron(_bounded(arrays, f"corners_{b}", (8, 3))), zones, halfway))
    count = len(arrays["places"])
    places, box = _bounded(arrays, "places", (count, 3)), _indices(arrays, "box", len(boxes))
    if not count or len(box) != count or not all(text.boxes):
        raise ValueError("it has no places, or boxes do not suit them")
    return PlaceTable(places, box, tuple(boxes), *text.mesh)


def _bounded(arrays: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> FloatArray:
    """Return an array of coordinates; ValueError for a wrong shape or number."""
    numbers = bounded(arrays[name], name)
    if numbers.shape != shape:
        raise ValueError(f"{name} {numbers.shape} must be {shape}")
    return numbers


def _indices(arrays: Mapping[str, Any], name: str, end: int, rising: bool = False) -> IntArray:
    """Return an array (K,) of indices below `end`, in rising order if asked; ValueError for other content."""
    indices = arrays[name]
    if indices.ndim != 1 or indices.dtype.kind != "i" or indices.min(initial=0) < 0 or indices.max(initial=-1) >= end:
        raise ValueError(f"{name} must be numbers from 0 to below {end}")
    if rising and (np.diff(indices) < 1).any():
        raise ValueError(f"{name} must rise")
    return np.asarray(indices, dtype=np.intp)


def _control(table: dict[str, Any]) -> ControlRange:
    """Return a surface from its table; ValueError for impossible values."""
    kind, *numbers = table.pop("functions")
    hints = get_type_hints(KINDS[kind])
    values = [_value(number, hints[field.name]) for field, number in zip(fields(KINDS[kind]), numbers, strict=True)]
    functions: Functions = KINDS[kind](*values)
    hints = {name: hint for name, hint in get_type_hints(ControlRange).items() if name != "functions"}
    if {*table} != {*hints}:
        raise ValueError("a surface lacks a value")
    control = ControlRange(**{name: _value(table[name], hint) for name, hint in hints.items()}, functions=functions)
    if not control.patches or not -LARGEST < control.low <= 0.0 <= control.high < LARGEST:
        raise ValueError(
            f"{control.name}: the range {control.low:g}:{control.high:g} does not hold 0, or there are no patches"
        )
    functions.check()
    return control


def _value(given: Any, kind: Any) -> Any:
    """Convert a JSON value to a type; ValueError if it is of another type, or a number is not finite.

    Only `least` of `Measured` may be NaN.
    """
    if kind in (Measured, _Text):
        hints = get_type_hints(kind)
        if not isinstance(given, dict) or {*given} != {*hints}:
            raise ValueError(f"{given!r:.80} lacks a value")
        values = {name: _value(given[name], hint) for name, hint in hints.items() if name != "least"}
        if "least" in hints:
            values["least"] = float("nan") if isnan(float(given["least"])) else _value(given["least"], float)
        return kind(**values)
    if get_origin(kind) is tuple and isinstance(given, list):
        return tuple(_value(one, get_args(kind)[0]) for one in given)
    if get_origin(kind) is dict and isinstance(given, dict):
        return dict(given)
    if kind is float and isinstance(given, int | float) and not isinstance(given, bool) and isfinite(given):
        return float(given)
    if kind in (int, bool, str) and type(given) is kind:
        return given
    raise ValueError(f"{given!r:.80} is of a wrong type")
