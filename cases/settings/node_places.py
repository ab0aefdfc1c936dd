"""Files with new places of a surface's nodes, as programs of coupling and of SU2 write them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.unpacking import PLACES, columns_of, damaged, read_arrays, read_rows
from sdm_deflect.deform.surface.shapes import NodePlaces

WHAT = "list of places"
# Names of a column with the number of the node in the mesh's file: SU2's, and that of a surface that VTK extracted.
NUMBERS = ("PointID", "vtkOriginalPointIds")
# Formats that cannot serve, and why.
REFUSED = {
    ".stl": "a .stl holds triangles without the order of the nodes: write a .ply or a .vtu",
    ".vtp": "a .vtp cannot be read: save the surface as .vtu or .ply",
}


def read_places(path: Path) -> NodePlaces:
    """Read new places of a surface's nodes.

    A .dat is SU2's list of surface positions: the node's number, then its place, between blanks. A .csv has the titles
    x, y, z, and may have ``PointID``. An .npz has `points`, and may have `nodes`. Files that meshio reads have the
    nodes in the mesh's order, unless they have point data ``PointID``.

    Raises InputError for any other content or suffix.
    """
    suffix = path.suffix.lower()
    if suffix in REFUSED:
        raise InputError(f"{path}: {REFUSED[suffix]}")
    if suffix not in READERS:
        raise InputError(
            f"{path}: no {WHAT} is read from {suffix or 'a file without suffix'}; known are {', '.join(READERS)}"
        )
    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    with damaged(path, WHAT):
        places, numbers = READERS[suffix](path)
        return NodePlaces(places, None if numbers is None else _whole(numbers), path.name)


def _positions(path: Path) -> tuple[FloatArray, FloatArray]:
    with path.open(encoding="utf-8") as text:
        rows = np.loadtxt(text, ndmin=2, comments=None)
    if rows.shape[1] not in (3, 4):
        raise InputError(
            f"{rows.shape[1]} columns; a line has the node's number, then x, y and z, in a plane mesh x and y"
        )
    return rows[:, 1:], rows[:, 0]


def _csv(path: Path) -> tuple[FloatArray, FloatArray | None]:
    titles, rows = read_rows(path, WHAT, "PointID,x,y,z")
    columns = columns_of(titles, {**PLACES, "number": NUMBERS})
    axes = [name for name in "xyz" if name in columns]
    if axes not in (["x", "y"], ["x", "y", "z"]):
        raise InputError(f"titles must be x,y,z, in a plane mesh x,y; they are {','.join(titles)}")
    return rows[:, [columns[name] for name in axes]], rows[:, columns["number"]] if "number" in columns else None


def _npz(path: Path) -> tuple[FloatArray, FloatArray | None]:
    stored = read_arrays(path)
    if "points" not in stored:
        raise InputError(f"it has no array points; its arrays are {', '.join(stored)}")
    return stored["points"], stored.get("nodes")


def _by_meshio(path: Path) -> tuple[FloatArray, FloatArray | None]:
    import meshio

    try:
        mesh = getattr(meshio, path.suffix.lower()[1:]).read(path)
    except (meshio.ReadError, AssertionError):
        raise InputError(f"no {WHAT}: it is damaged, or something else than its suffix says") from None
    numbers = next((mesh.point_data[name] for name in NUMBERS if name in mesh.point_data), None)
    return np.asarray(mesh.points, dtype=np.float64), None if numbers is None else np.ravel(numbers)


def _whole(numbers: FloatArray) -> IntArray:
    """Return node numbers as integers; InputError for fractions and negative ones."""
    given = np.asarray(numbers, dtype=np.float64)
    if given.ndim != 1 or (given != np.round(given)).any() or (given < 0).any():
        raise InputError("numbers of nodes must be whole, from 0")
    return given.astype(np.intp)


READERS: dict[str, Callable[[Path], tuple[FloatArray, FloatArray | None]]] = {
    ".dat": _positions,
    ".csv": _csv,
    ".npz": _npz,
    **dict.fromkeys((".vtu", ".vtk", ".ply", ".obj"), _by_meshio),
}
