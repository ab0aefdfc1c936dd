"""Primary grids of DLR's TAU code (.grid, .taumesh, .nc) in netCDF: CDF-1, CDF-2, or netCDF-4, which is HDF5."""

import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from sdm_deflect.base.arrays import IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.files import fresh
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.mesh.cells import CORNERS, MIRRORED, Cells, Patch, Zone
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.pieces import MeshOnDisk

from .coordinates import ByteColumns
from .format import Format
from .hdf5 import DAMAGE, Dataset, Datasets, Span, damage, dataset, spans
from .polyhedra import standard_cells
from .shapes import mirror_nodes, refuse_plane, simple_faces
from .table_pieces import CellTable, PointRange, TablePieces
from .tables import FileTable, MemoryTable
from .zones import unwritten

AXES = ("points_xc", "points_yc", "points_zc")
MARKERS = "boundarymarker_of_surfaces"
SOLIDS = {"tetraeders": "tetra", "prisms": "wedge", "pyramids": "pyramid", "hexaeders": "hexahedron"}
FACES = {"surfacetriangles": "triangle", "surfacequadrilaterals": "quad"}
KINDS = {"f": "real numbers", "iu": "whole numbers"}
# Largest sizes: bytes of a boundary mapping, markers of a grid, bytes of a written variable.
LONGEST, MOST, LARGEST = 1 << 20, 1 << 12, (1 << 31) - 4
NUMBER = re.compile(r"-?[0-9]{1,9}")


class Grid(NamedTuple):
    """An open grid: arrays by name (None if of unlimited length), lengths of dimensions, and attributes."""

    arrays: Any
    lengths: Mapping[str, int | None]
    attributes: Mapping[str, Any]

    def array(self, name: str, kinds: str, *width: int) -> tuple[Any, list[Span]]:
        """Return an array (N, *width), not read yet, and the places of its numbers; none if HDF5 has packed them."""
        in_hdf5 = isinstance(self.arrays, h5py.File)
        array = dataset(self.arrays, name, kinds, KINDS[kinds]) if in_hdf5 else self.arrays[name]
        if array is None:
            raise MeshFileError(f"{name} has an unlimited dimension; fix its length with `nccopy -u IN OUT`")
        if array.dtype.kind not in kinds or not array.shape or array.shape[1:] != width:
            expected = f"({', '.join(('N', *map(str, width)))}{'' if width else ','}) {KINDS[kinds]}"
            raise MeshFileError(f"{name} holds {array.shape} {array.dtype}, expected {expected}")
        return array, spans(array) if in_hdf5 else [(array.offset, 0, array.size)]

    def table(self, path: Path, name: str, kinds: str, *width: int) -> FileTable | MemoryTable:
        """Return an array as a table; it is in memory if HDF5 has it in several places, or packed."""
        array, places = self.array(name, kinds, *width)
        if len(places) != 1:
            return MemoryTable(array[()].reshape(len(array), -1))
        return FileTable(path.resolve(), places[0][0], array.dtype.str, len(array), *width)


@contextmanager
def open_tau(path: Path) -> Iterator[Grid]:
    """Open a netCDF file; MeshFileError for another or a damaged file."""
    with path.open("rb") as file:
        magic = file.read(4)
    if h5py.is_hdf5(path):
        with damage(), h5py.File(path) as hdf5:
            lengths = {name: len(array) for name, array in hdf5.items() if name.startswith("no_of_")}
            yield Grid(hdf5, lengths, hdf5.attrs)
    elif magic in (b"CDF\1", b"CDF\2"):
        yield _classic(path)
    else:
        raise MeshFileError("this is no netCDF file, or one of CDF-5; run `nccopy -k 64-bit-offset IN OUT`")


def _classic(path: Path) -> Grid:
    """Return the arrays of a CDF-1 or CDF-2 file, memory-mapped where SciPy finds them."""
    from scipy.io import netcdf_file

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # that a damaged file is still mapped
        try:
            with netcdf_file(path, "r", mmap=True) as file:
                begin = {
                    name: variable.data.ctypes.data - variable.data.base.ctypes.data
                    for name, variable in file.variables.items()
                }
                arrays = {
                    name: None
                    if variable.isrec
                    else np.memmap(path, variable.data.dtype, "r", begin[name], variable.shape)
                    for name, variable in file.variables.items()
                }
                used = sorted(
                    (array.offset, array.offset + array.nbytes) for array in arrays.values() if array is not None
                )
                if any(end > following for (_, end), (following, _) in pairwise(used)):
                    raise ValueError("variables share bytes")
                return Grid(arrays, dict(file.dimensions), dict(file._attributes))
        except (*DAMAGE, MemoryError) as error:
            reason = str(error)
    raise MeshFileError(f"the header, or what it announces, is truncated or damaged ({reason})")


class Tau(Format):
    """Cells of the four linear shapes, a block of each; patches are the markers of triangles and quadrilaterals.

    A patch has the name in a boundary mapping beside the grid, else in the grid's attribute ``marker_N``, else the
    marker's number. The mapping of ``wing.grid`` and ``wing-deflected.grid`` is ``wing.bmap``, or the parameters
    ``wing.para``. Markers of one name are one patch. Coordinates in single precision stay in single precision. A new
    file has offsets of 64 bits (CDF-2).
    """

    name = "tau"
    suffixes = (".grid", ".taumesh", ".nc")

    def files(self, path: Path) -> Iterable[Path]:
        return path, *mappings(path)

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshOnDisk | None:
        """See `Format.layout`; None for netCDF-4 in several parts."""
        progress(f"reading {path.name}", 0.0)
        with about(path), open_tau(path) as grid:
            points, cells = _points(grid, path), _elements(grid, path, SOLIDS)
            tables = (*(part.table for part in points.ranges), *(block.table for block in cells))
            if scratch and any(isinstance(table, MemoryTable) for table in tables):
                return None
            _check_count(grid, "no_of_elements", cells)
            patches = _patches(grid, path, points.points)
        pieces = replace(points, cells=tuple(block for block in cells if block.table.rows)).orient()
        return MeshOnDisk(path.resolve().name, pieces, patches, (Zone("", 0, points.points),))

    def coordinates(self, path: Path) -> ByteColumns | Datasets:
        with open_tau(path) as grid:
            table = _points(grid, path)
            if not isinstance(grid.arrays, h5py.File):
                return ByteColumns(table)
            kinds = [grid.array(axis, "f")[0].dtype for axis in AXES]
            axes = zip(AXES, kinds, range(3), strict=True)
            return Datasets.of(path, [Dataset(name, kind, 0, table.points, i, i + 1) for name, kind, i in axes])

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; MeshFileError for polyhedra of other shapes, and for faces of five corners."""
        refuse_plane(mesh, "TAU")
        progress(f"writing {out.name}", 0.0)
        with fresh(out) as beside, about(out), beside.open("wb") as file:
            return _write(mesh, file)

    def holds(self, path: Path) -> bool:
        with suppress(MeshFileError, *DAMAGE), open_tau(path) as grid:
            return AXES[0] in grid.arrays
        return False


def _points(grid: Grid, path: Path) -> TablePieces:
    if missing := [axis for axis in AXES if axis not in grid.arrays]:
        raise MeshFileError(f"there is no variable {missing[0]}; this is no primary grid of TAU, or it is damaged")
    tables = [grid.table(path, axis, "f") for axis in AXES]
    if len(counts := {table.rows for table in tables}) > 1:
        raise MeshFileError(f"{', '.join(AXES)} have different lengths: {sorted(counts)}; the file is damaged")
    ranges = tuple(PointRange(0, table.rows, table, i, i + 1) for i, table in enumerate(tables))
    return TablePieces(str(path.resolve()), tables[0].rows, ranges, ())


def _elements(grid: Grid, path: Path, shapes: Mapping[str, str]) -> list[CellTable]:
    there = {f"points_of_{what}": shape for what, shape in shapes.items() if f"points_of_{what}" in grid.arrays}
    tables = ((shape, grid.table(path, name, "iu", CORNERS[shape])) for name, shape in there.items())
    return [CellTable(shape, table, 0, MIRRORED[shape] if shape == "wedge" else ()) for shape, table in tables]


def _check_count(grid: Grid, dimension: str, blocks: Sequence[CellTable]) -> None:
    announced, count = grid.lengths.get(dimension), sum(block.table.rows for block in blocks)
    if announced is not None and announced != count:
        raise MeshFileError(f"{dimension} is {announced}, but {count} of the shapes that are supported are there")


def _patches(grid: Grid, path: Path, points: int) -> tuple[Patch, ...]:
    """Return the patches by the markers of triangles and then quadrilaterals; markers of one name are one patch."""
    tables = [element for element in _elements(grid, path, FACES) if element.table.rows]
    _check_count(grid, "no_of_surfaceelements", tables)
    if not tables:
        return ()
    ends = np.cumsum([element.table.rows for element in tables])
    markers = _markers(grid, ends[-1])
    blocks = [Cells(element.shape, element.everything(points)) for element in tables]
    patches: dict[str, list[Cells]] = {}
    for marker, name in _marker_names(grid, path, np.unique(markers).tolist()).items():
        for block, marked in zip(blocks, np.split(markers == marker, ends[:-1]), strict=True):
            if marked.any():
                patches.setdefault(name, []).append(replace(block, nodes=block.nodes[marked]))
    return tuple(Patch(name, tuple(marked)) for name, marked in patches.items())


def _markers(grid: Grid, count: int) -> IntArray:
    if MARKERS not in grid.arrays:
        raise MeshFileError(f"there is no variable {MARKERS}, but there are {count} faces; the file is damaged")
    markers = np.asarray(grid.array(MARKERS, "iu")[0][()])
    if len(markers) != count:
        raise MeshFileError(f"{MARKERS} holds {len(markers)} markers of {count} triangles and quadrilaterals")
    if (different := len(np.unique(markers))) > MOST:
        raise MeshFileError(f"{MARKERS} holds {different} different markers, expected at most {MOST}")
    return markers


def _marker_names(grid: Grid, path: Path, markers: Sequence[int]) -> dict[int, str]:
    """Return the name of each marker from the mapping whose file name fits the grid's best."""
    mappings_of = (mapped_names(beside.read_bytes().decode("utf-8", "replace")) for beside in mappings(path))
    mapped = next((each for each in mappings_of if each.keys() & set(markers)), {})
    names = {marker: mapped.get(marker) or _text(grid, f"marker_{marker}") for marker in markers}
    return {marker: name.replace("\0", "") or str(marker) for marker, name in names.items()}


def _text(grid: Grid, attribute: str) -> str:
    value = grid.attributes.get(attribute, "")
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.item()
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value if isinstance(value, str) else ""


def mappings(path: Path) -> Iterator[Path]:
    """Yield the files beside a grid that may have its boundary mapping, the longest name first."""
    parts = re.split(r"(?=[^0-9A-Za-z])", path.name)
    stems = ["".join(parts[:i]) for i in range(len(parts), 0, -1)]
    for beside in (path.with_name(stem + suffix) for stem in stems if stem for suffix in (".bmap", ".para")):
        if beside.is_file() and beside.stat().st_size <= LONGEST:
            yield beside


def mapped_names(text: str) -> dict[int, str]:
    """Return the names of the markers in a boundary mapping.

    The file has blocks of lines ``keyword: value`` (``Markers: 3, 4``, ``Name: wing``) that end with ``block end``; a
    comment begins with ``#``.
    """
    names: dict[int, str] = {}
    for block in text.split("block end"):
        lines = (line.partition("#")[0].partition(":") for line in block.splitlines())
        values = {keyword.strip(): value.strip() for keyword, _, value in lines}
        if name := values.get("Name"):
            words = re.split(r"[\s,]+", values.get("Markers", ""))
            names |= {int(word): name for word in words if NUMBER.fullmatch(word)}
    return names


def _write(mesh: Mesh, file: Any) -> tuple[str, ...]:
    """Write cells by shape, triangles and quadrilaterals with their markers; patch i is marker i + 1."""
    from scipy.io import netcdf_file

    cells = list(filter(len, standard_cells(mesh)))
    if not cells:
        raise MeshFileError("there are no volume cells")
    grid = netcdf_file(file, "w", version=2)
    grid.type = "Primary Grid: Tau Format"
    grid.createDimension("no_of_elements", sum(map(len, cells)))
    _store_shapes(grid, SOLIDS, [(block, 0) for block in cells])
    faces = []
    for marker, patch in enumerate(mesh.patches, 1):
        setattr(grid, f"marker_{marker}", patch.name.encode("utf-8", "replace"))
        faces += [(block, marker) for block in simple_faces(patch) if len(block)]
    if markers := _store_shapes(grid, FACES, faces):
        _store(grid, MARKERS, np.concatenate(markers), "no_of_surfaceelements")
        _store(grid, "marker", np.arange(1, len(mesh.patches) + 1), "no_of_markers")
    for axis, values in zip(AXES, mesh.points.T, strict=True):
        _store(grid, axis, values, "no_of_points")
    grid.flush()
    empty = [f"patch {patch.name} has no faces and is left out" for patch in mesh.patches if not len(patch)]
    return (*empty, *(["its zones are one mesh"] if len(mesh.zones) > 1 else []), *unwritten(mesh.periodic))


def _store_shapes(grid: Any, shapes: Mapping[str, str], blocks: Sequence[tuple[Cells, int]]) -> list[IntArray]:
    """Write blocks and their markers shape by shape; return the marker of each element."""
    markers = []
    for what, shape in shapes.items():
        if of_shape := [(block.nodes, marker) for block, marker in blocks if block.shape == shape]:
            nodes = np.concatenate([block_nodes for block_nodes, _ in of_shape])
            nodes = mirror_nodes(shape, nodes) if shape == "wedge" else nodes
            _store(grid, f"points_of_{what}", nodes, f"no_of_{what}", f"points_per_{what.removesuffix('s')}")
            markers += [np.full(len(block_nodes), marker) for block_nodes, marker in of_shape]
    return markers


def _store(grid: Any, name: str, values: np.ndarray[Any, Any], *dimensions: str) -> None:
    for dimension, length in zip(dimensions, values.shape, strict=True):
        if dimension not in grid.dimensions:
            grid.createDimension(dimension, length)
    kind = "d" if values.dtype.kind == "f" else "i"
    if values.size * np.dtype(f">{kind}").itemsize > LARGEST:
        raise MeshFileError(f"{name} has more than the {LARGEST} bytes that netCDF holds; write CGNS (.cgns) instead")
    grid.createVariable(name, kind, dimensions)[:] = values
