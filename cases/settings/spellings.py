"""Spellings of points, ranges, shapes, pairs and selections: text on the command line, or values."""

from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from sdm_deflect.base.errors import InputError, shortened

from .conversion import Nested, read_toml

SELECTION = (
    "NAME=PATCH, then what leaves some of its faces: #NUMBER, box:CORNERS, side:POINT,NORMAL, and last sharp:DEG"
)


def points_of(value: Any) -> Any:
    """Return points as numbers, given as texts ``x,y,z`` or numbers; a single point becomes a list of one."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(value, list | tuple):
        return value
    if len(value) in (2, 3) and not any(isinstance(x, Iterable) for x in value):
        return [value]
    return [_point(item) if isinstance(item, str) else item for item in value]


def _point(text: str) -> tuple[float, ...]:
    try:
        point = tuple(float(number) for number in text.split(","))
    except ValueError:
        point = ()
    if text.startswith("--"):
        raise InputError(f"{shortened(text)} follows one point: a hinge needs two, such as 0.7,0,0 0.7,1,0")
    if len(point) not in (2, 3):
        hint = "the hinge needs two, such as 0.7,0,0 0.7,1,0; in a plane mesh one, such as 0.7,0"
        raise InputError(f"{shortened(text)} is no point: {hint}")
    return point


def shift_of(value: Any) -> Any:
    """Return one shift or two, given as text ``x,y,z`` or as numbers, as points."""
    return [_point(value)] if isinstance(value, str) else points_of(value)


def device_of(value: Any) -> Any:
    """Return ``WING,ETA1,ETA2,XSI`` as a name and three numbers; anything else as it is."""
    try:
        wing, *shares = value.split(",") if isinstance(value, str) else value
        return [wing, *(float(share) for share in shares)]
    except (TypeError, ValueError):
        raise InputError(f"{shortened(value)}: must be a patch, two shares of its span and one of its chord") from None


def table_of_arrays(value: Any) -> Any:
    """Return the table of two or three arrays: points and displacements (P, 3), and rotations (P, 3) of a beam.

    In a plane mesh they are (P, 2), (P, 2) and (P,). Any other value returns as it is.
    """
    if not isinstance(value, list | tuple):
        return value
    if len(value) not in (2, 3):
        raise InputError(
            f"{shortened(value)}: must be a file, or points (P, 3) and displacements (P, 3), of a beam also rotations "
            "(P, 3)"
        )
    import numpy as np

    from sdm_deflect.deform.surface.tables import Table
    from sdm_deflect.meshing.mesh.cells import bounded

    points, vectors, *turns = (bounded(array, "arrays") for array in (value if value[-1] is not None else value[:2]))
    plane = points.ndim == vectors.ndim == 2 and points.shape[1] == vectors.shape[1] == 2
    if plane:
        points, vectors = (np.column_stack([array, np.zeros(len(array))]) for array in (points, vectors))
        turns = [np.column_stack([np.zeros((len(array), 2)), array]) if array.ndim == 1 else array for array in turns]
    return Table(points, vectors, plane=plane, rotations=turns[0] if turns else None)


def shape_of_array(value: Any) -> Any:
    """Return the shape of an array (K, 3) of places, in a plane mesh (K, 2); names of files as they are."""
    rows = value if isinstance(value, list | tuple) or hasattr(value, "tolist") else ()
    if not len(rows) or any(isinstance(row, str | PathLike) for row in rows):
        return value
    from sdm_deflect.deform.surface.shapes import NodePlaces, Shapes

    return Shapes((NodePlaces(value),))


def strip_of(value: Any) -> Any:
    """Return 0 for ``auto``, a number for other text; anything else as it is."""
    if not isinstance(value, str):
        return value
    try:
        return 0.0 if value == "auto" else float(value)
    except ValueError:
        raise InputError(f"{shortened(value)}: must be auto, or a share of the span such as 0.2") from None


def range_of(value: Any) -> Any:
    """Return ``A:B`` as two numbers; anything else as it is."""
    if not isinstance(value, str):
        return value
    try:
        low, high = (float(number) for number in value.split(":"))
    except ValueError:
        raise InputError(f"{shortened(value)}: must be two numbers, such as -25:25") from None
    return low, high


def shapes_of(value: Any) -> Any:
    """Return ``NAME:SHAPE``, or several of them, as a table; tables as they are."""
    if isinstance(value, Mapping) or not isinstance(value, str | list | tuple):
        return value
    out = {}
    for text in value.split(",") if isinstance(value, str) else value:
        name, colon, shape = str(text).rpartition(":")
        if not colon or not name:
            raise InputError(f"{text}: must be NAME:plane, NAME:cylinder or NAME:surface")
        out[name.strip()] = shape.strip()
    return out


def pairs_of(value: Any) -> Any:
    """Return a pair of names, or several pairs, as tables; tables as they are."""
    if not isinstance(value, list | tuple):
        return [value] if isinstance(value, Mapping) else value
    pairs = [value] if value and all(isinstance(name, str) for name in value) else value
    return [pair if isinstance(pair, Mapping) else {"patches": pair} for pair in pairs]


def selections_of(value: Any) -> Any:
    """Return ``NAME=EXPRESSION``, or files with a table `select`, one or several, as a table; tables as they are."""
    if isinstance(value, Mapping) or not isinstance(value, str | Path | list | tuple):
        return value
    out: Nested = {}
    for text in [value] if isinstance(value, str | Path) else value:
        name, equals, expression = (part.strip() for part in str(text).partition("="))
        new = {name: expression} if equals else _stored(Path(str(text)))
        if twice := sorted(out.keys() & new.keys()):
            raise InputError(f"{text}: {twice[0]} is selected twice")
        out |= new
    return out


def _stored(path: Path) -> Nested:
    if path.suffix != ".toml":
        raise InputError(f"{path}: must be {SELECTION}, or a .toml file with a table select")
    table = read_toml(path).get("select")
    if not isinstance(table, Mapping):
        raise InputError(f"{path}: the file has no table select, such as select = {{ flap = 'wall#2' }}")
    return dict(table)
