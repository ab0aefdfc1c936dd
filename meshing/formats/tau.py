"""Primary grids of DLR's TAU code (.grid, .taumesh, .nc) in netCDF."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import CORNERS, MIRRORED, Cells, Mesh, Patch, Zone
from sdm_deflect.deform.mesh.pieces import MeshInPieces
from sdm_deflect.meshing.files.staged import fresh
from sdm_deflect.meshing.formats.format import MeshFileError, about, check_points
from sdm_deflect.meshing.formats.hdf5 import DAMAGE, Replaced
from sdm_deflect.meshing.formats.known import registered
from sdm_deflect.meshing.formats.layout import Format
from sdm_deflect.meshing.formats.netcdf import NetCdf, opened
from sdm_deflect.meshing.formats.shapes import refuse_plane
from sdm_deflect.meshing.formats.table_pieces import CellTable, PointRange, TablePieces
from sdm_deflect.meshing.formats.tables import Held
from sdm_deflect.meshing.formats.tau_write import AXES, FACES, MARKERS, SOLIDS, write_grid

MAPPINGS = (".bmap", ".para")
"""Suffixes of files with a boundary mapping: the mapping alone, or all parameters of a computation."""
LONGEST = 1 << 20
"""Bytes of a boundary mapping."""
MOST = 1 << 12
"""Markers of a grid."""
NUMBER = re.compile(r"-?[0-9]{1,9}")


@registered("tau", ".grid", ".taumesh", ".nc")
class Tau(Format):
    """Cells of the four linear shapes, each one block; patches are the markers of triangles and quadrilaterals.

    Patches are named by a boundary mapping beside the grid (``wing.bmap``, or the parameters ``wing.para``, for
    ``wing.grid`` and ``wing-deflected.grid``), else by the attribute ``marker_N`` of the grid, else by the marker's
    number. Markers of one name are one patch. Coordinates in single precision stay in single precision. A new file has
    offsets of 64 bits (CDF-2).
    """

    def files(self, path: Path) -> Iterable[Path]:
        """See `Format.files`."""
        return path, *mappings(path)

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshInPieces | None:
        """See `Format.layout`; None for netCDF-4 in several parts."""
        progress(f"reading {path.name}", 0.0)
        with about(path), opened(path) as file:
            return _layout(file, path, scratch is not None)

    def stored(self, path: Path) -> TablePieces:
        """See `Format.stored`."""
        with opened(path) as file:
            return _points(file, path)

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; only the bytes of points_xc, points_yc and points_zc change.

        Where netCDF-4 has packed them, HDF5 packs them anew, and may put them elsewhere in the file.
        """
        with about(source), opened(source) as file:
            stored = coordinates(file)
            check_points(points, stored[0].size)
            arrays = [
                (own, file.spans(axis), new, file.array(axis) != new)
                for axis, own, new in zip(AXES, stored, points.T, strict=True)
            ]
            new = Replaced.of(source, arrays)
        new.copy(source, out, progress)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; polyhedra that are no usual cells, or faces of five corners, are a MeshFileError."""
        refuse_plane(mesh, "TAU")
        progress(f"writing {out.name}", 0.0)
        with fresh(out) as beside, about(out), beside.open("wb") as file:
            return write_grid(mesh, file)

    def holds(self, path: Path) -> bool:
        """See `Format.holds`."""
        try:
            with opened(path) as file:
                return AXES[0] in file
        except (MeshFileError, *DAMAGE):
            return False


def _points(file: NetCdf, path: Path) -> TablePieces:
    """Return the points, without cells."""
    count = coordinates(file)[0].size
    ranges = tuple(PointRange(0, count, file.table(axis), i, i + 1) for i, axis in enumerate(AXES))
    return TablePieces(str(path.resolve()), count, ranges, ())


def _layout(file: NetCdf, path: Path, in_file: bool) -> MeshInPieces | None:
    """Return the mesh of an open file; names of patches may be in files beside `path`.

    None if some of it would be in memory, and all must be `in_file`.

    MeshFileError or ValueError if variables are missing, damaged or contradict one another.
    """
    points = _points(file, path)
    cells = [_elements(file, what, shape) for what, shape in SOLIDS.items() if f"points_of_{what}" in file]
    stored = (*(own.table for own in points.ranges), *(own.table for own in cells))
    if in_file and any(isinstance(table, Held) for table in stored):
        return None
    _check_count(file, "no_of_elements", cells)
    patches = _patches(file, path, points.points)
    pieces = replace(points, cells=tuple(own for own in cells if own.table.rows)).oriented()
    return MeshInPieces(path.resolve().name, pieces, patches, (Zone("", 0, points.points),))


def _patches(file: NetCdf, path: Path, points: int) -> tuple[Patch, ...]:
    """Return the patches; markers of one name are one."""
    tables = [_elements(file, what, shape) for what, shape in FACES.items() if f"points_of_{what}" in file]
    _check_count(file, "no_of_surfaceelements", tables)
    by_marker = _by_marker(file, [Cells(own.shape, own.everything(points)) for own in tables if own.table.rows])
    patches: dict[str, list[Cells]] = {}
    for marker, name in marker_names(file, path, list(by_marker)).items():
        patches.setdefault(name, []).extend(by_marker[marker])
    return tuple(Patch(name, tuple(blocks)) for name, blocks in patches.items())


def coordinates(file: NetCdf) -> list[Any]:
    """Return the variables x, y and z (N,); MeshFileError if they are no real numbers of one length."""
    if missing := [axis for axis in AXES if axis not in file]:
        raise MeshFileError(f"there is no variable {missing[0]}; this is no primary grid of TAU, or it is damaged")
    found = [file.stored(axis) for axis in AXES]
    count = found[0].shape[0] if found[0].shape else 0
    for axis, own in zip(AXES, found, strict=True):
        if own.dtype.kind != "f" or own.dtype.itemsize not in (4, 8) or own.shape != (count,):
            raise MeshFileError(f"{axis} holds {own.shape} {own.dtype}, expected ({count},) real numbers")
    return found


def _elements(file: NetCdf, what: str, shape: str) -> CellTable:
    """Return the cells or faces of one shape."""
    name, corners = f"points_of_{what}", CORNERS[shape]
    stored = file.stored(name)
    if stored.dtype.kind not in "iu" or stored.shape[1:] != (corners,):
        raise MeshFileError(f"{name} holds {stored.shape} {stored.dtype}, expected (N, {corners}) whole numbers")
    return CellTable(shape, file.table(name), 0, MIRRORED[shape] if shape == "wedge" else ())


def _check_count(file: NetCdf, dimension: str, blocks: Sequence[CellTable]) -> None:
    announced, found = file.length(dimension), sum(block.table.rows for block in blocks)
    if announced is not None and announced != found:
        raise MeshFileError(f"{dimension} is {announced}, but {found} of the shapes that are supported are there")


def _by_marker(file: NetCdf, faces: Sequence[Cells]) -> dict[int, list[Cells]]:
    """Faces by marker, in the order of the markers; the file has markers of triangles, then of quadrilaterals."""
    sizes = [len(block) for block in faces]
    if not sizes:
        return {}
    if MARKERS not in file:
        raise MeshFileError(f"there is no variable {MARKERS}, but there are {sum(sizes)} faces; the file is damaged")
    markers = file.array(MARKERS)
    if markers.dtype.kind not in "iu" or markers.shape != (sum(sizes),):
        expected = f"expected ({sum(sizes)},) whole numbers, one for each triangle and quadrilateral"
        raise MeshFileError(f"{MARKERS} holds {markers.shape} {markers.dtype}, {expected}")
    labels, index = np.unique(markers, return_inverse=True)
    if len(labels) > MOST:
        raise MeshFileError(f"{MARKERS} holds {len(labels)} different markers, expected at most {MOST}")
    found: dict[int, list[Cells]] = {marker: [] for marker in labels.tolist()}
    for block, own in zip(faces, np.split(index, np.cumsum(sizes)[:-1]), strict=True):
        for marker, rows in zip(found, _rows(own, len(labels)), strict=True):
            if len(rows):
                found[marker].append(replace(block, nodes=block.nodes[rows]))
    return found


def _rows(index: IntArray, count: int) -> list[IntArray]:
    """Rows that have each of the numbers 0 to count - 1."""
    order = np.argsort(index, kind="stable")
    return np.split(order, np.searchsorted(index[order], np.arange(1, count)))


def marker_names(file: NetCdf, path: Path, markers: Sequence[int]) -> dict[int, str]:
    """Name of each marker of the grid `path`."""
    mapped = _mapping(path, markers)
    given = {one: mapped.get(one) or file.text(f"marker_{one}") for one in markers}
    return {one: name.replace("\0", "") or str(one) for one, name in given.items()}


def _mapping(path: Path, markers: Sequence[int]) -> dict[int, str]:
    """Names by the file beside the grid whose name is the longest beginning of the grid's and that has its markers."""
    for beside in mappings(path):
        found = mapped_names(beside.read_bytes().decode("utf-8", "replace"))
        if any(marker in found for marker in markers):
            return found
    return {}


def mappings(path: Path) -> Iterator[Path]:
    """Yield the files beside a grid that may have its boundary mapping, those of the longest names first."""
    parts = re.split(r"(?=[^0-9A-Za-z])", path.name)
    stems = ["".join(parts[:i]) for i in range(len(parts), 0, -1)]
    for beside in (path.with_name(stem + suffix) for stem in stems if stem for suffix in MAPPINGS):
        if beside.is_file() and beside.stat().st_size <= LONGEST:
            yield beside


def mapped_names(text: str) -> dict[int, str]:
    """Return the names of the markers in a boundary mapping.

    It has blocks of lines ``keyword: value`` (``Markers: 3, 4``, ``Name: wing``) that end with ``block end``; a comment
    begins with ``#``.
    """
    found: dict[int, str] = {}
    for block in text.split("block end"):
        lines = (line.partition("#")[0].partition(":") for line in block.splitlines())
        values = {keyword.strip(): value.strip() for keyword, _, value in lines}
        if name := values.get("Name"):
            words = re.split(r"[\s,]+", values.get("Markers", ""))
            found |= {int(word): name for word in words if NUMBER.fullmatch(word)}
    return found
