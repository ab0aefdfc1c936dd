"""Primary grids of DLR's TAU code (.grid, .taumesh, .nc) in netCDF."""

import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import CORNERS, Cells, Mesh, Patch
from sdm_deflect.deform.mesh.precision import DOUBLE
from sdm_deflect.meshing.files.staged import fresh
from sdm_deflect.meshing.formats.cgns_packed import overwrite
from sdm_deflect.meshing.formats.format import MeshFileError, about, check_points, fewest_bits
from sdm_deflect.meshing.formats.hdf5 import DAMAGE
from sdm_deflect.meshing.formats.netcdf import Array, NetCdf, opened
from sdm_deflect.meshing.formats.shapes import check_faces, mirrored, oriented, refuse_plane
from sdm_deflect.meshing.formats.tau_write import AXES, FACES, MARKERS, SOLIDS, write_grid

MAPPINGS = (".bmap", ".para")
"""Suffixes of files with a boundary mapping: the mapping alone, or all parameters of a computation."""
LONGEST = 1 << 20
"""Bytes of a boundary mapping."""
MOST = 1 << 12
"""Markers of a grid."""
NUMBER = re.compile(r"-?[0-9]{1,9}")


@dataclass(frozen=True, slots=True)
class Tau:
    """Cells of the four linear shapes, each one block; patches are the markers of triangles and quadrilaterals.

    Patches are named by a boundary mapping beside the grid (``wing.bmap``, or the parameters ``wing.para``, for
    ``wing.grid`` and ``wing-deflected.grid``), else by the attribute ``marker_N`` of the grid, else by the marker's
    number. Markers of one name are one patch. Coordinates in single precision stay in single precision. A new file has
    offsets of 64 bits (CDF-2).
    """

    name: str = "tau"
    suffixes: tuple[str, ...] = (".grid", ".taumesh", ".nc")

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        progress(f"reading {path.name}", 0.0)
        with about(path), opened(path) as file:
            return read_grid(file, path)

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        """See `Format.real`."""
        if source is None:
            return DOUBLE
        with about(source), opened(source) as file:
            return fewest_bits(values.dtype for values in coordinates(file))

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; only the bytes of points_xc, points_yc and points_zc change.

        Where netCDF-4 has packed them, HDF5 packs them anew, and may put them elsewhere in the file.
        """
        with about(source), opened(source) as file:
            stored = coordinates(file)
            check_points(points, len(stored[0]))
            places = {axis: file.places(axis) for axis in AXES}
            changed = {axis: _moved(old, new) for axis, old, new in zip(AXES, stored, points.T, strict=True)}
            spans = [
                (at, at + (last - first) * changed[axis].itemsize) for axis in AXES for at, first, last in places[axis]
            ]
            if not file.distinct(AXES) or any(begin < end for (_, end), (begin, _) in pairwise(sorted(spans))):
                raise MeshFileError("coordinates of several axes are one and the same data")
        with fresh(out, source) as beside, about(source):
            progress(f"writing {out.name}", 0.0)
            shutil.copyfile(source, beside)
            with beside.open("r+b") as copy:
                for axis, values in changed.items():
                    for begin, first, last in places[axis]:
                        copy.seek(begin)
                        copy.write(values[first:last].tobytes())
            if packed := {axis: values for axis, values in changed.items() if not places[axis]}:
                overwrite(beside, packed)
            progress(f"writing {out.name}", 1.0)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; polyhedra that are no usual cells, or faces of five corners, are a MeshFileError."""
        refuse_plane(mesh, "TAU")
        progress(f"writing {out.name}", 0.0)
        with fresh(out) as beside, about(out), beside.open("wb") as file:
            return write_grid(mesh, file)

    def holds(self, path: Path) -> bool:
        """Whether a file of any name is such a grid."""
        try:
            with opened(path) as file:
                return AXES[0] in file
        except (MeshFileError, *DAMAGE):
            return False


def read_grid(file: NetCdf, path: Path) -> Mesh:
    """Return the mesh of an open file; names of patches may be in files beside `path`.

    MeshFileError or ValueError if variables are missing, damaged or contradict one another.
    """
    points = np.stack(coordinates(file), axis=1).astype(np.float64, copy=False)
    cells = [block for what, shape in SOLIDS.items() for block in _elements(file, what, shape, len(points))]
    faces = [block for what, shape in FACES.items() for block in _elements(file, what, shape, len(points))]
    _check_count(file, "no_of_elements", cells)
    _check_count(file, "no_of_surfaceelements", faces)
    turned = [replace(b, nodes=mirrored("wedge", b.nodes)) if b.shape == "wedge" else b for b in cells]
    by_marker = _by_marker(file, faces)
    patches: dict[str, list[Cells]] = {}
    for marker, name in marker_names(file, path, list(by_marker)).items():
        patches.setdefault(name, []).extend(by_marker[marker])
    named = tuple(Patch(name, tuple(blocks)) for name, blocks in patches.items())
    mesh = Mesh(points, tuple(oriented(points, block) for block in turned), named)
    check_faces(mesh)
    return mesh


def coordinates(file: NetCdf) -> list[Array]:
    """Return x, y and z (N,) as they are stored; MeshFileError if they are no real numbers of one length."""
    if missing := [axis for axis in AXES if axis not in file]:
        raise MeshFileError(f"there is no variable {missing[0]}; this is no primary grid of TAU, or it is damaged")
    found = [file.array(axis) for axis in AXES]
    count = found[0].shape[0] if found[0].ndim else 0
    for axis, values in zip(AXES, found, strict=True):
        if values.dtype.kind != "f" or values.dtype.itemsize not in (4, 8) or values.shape != (count,):
            raise MeshFileError(f"{axis} holds {values.shape} {values.dtype}, expected ({count},) real numbers")
    return found


def _elements(file: NetCdf, what: str, shape: str, points: int) -> Iterator[Cells]:
    """Yield the cells or faces of one shape, if there are any."""
    name = f"points_of_{what}"
    if name not in file:
        return
    nodes, corners = file.array(name), CORNERS[shape]
    if nodes.dtype.kind not in "iu" or nodes.shape[1:] != (corners,):
        raise MeshFileError(f"{name} holds {nodes.shape} {nodes.dtype}, expected (N, {corners}) whole numbers")
    if missing := np.count_nonzero(((nodes < 0) | (nodes >= points)).any(axis=1)):
        known = f"the {points} (0 to {points - 1})"
        raise MeshFileError(f"{missing} of {len(nodes)} {what} name points that are not among {known}")
    if len(nodes):
        yield Cells(shape, nodes.astype(np.intp))


def _check_count(file: NetCdf, dimension: str, blocks: Sequence[Cells]) -> None:
    announced, found = file.length(dimension), sum(len(block) for block in blocks)
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


def _moved(old: Array, new: FloatArray) -> Array:
    """Return values that are stored; those that do not change keep their bits."""
    with np.errstate(over="ignore"):
        moved = np.where(old.astype(np.float64) != new, new.astype(old.dtype), old).astype(old.dtype, copy=False)
    if bad := np.count_nonzero(~np.isfinite(moved)):
        raise MeshFileError(f"{bad} coordinates are beyond single precision, in which the file has them")
    return moved
