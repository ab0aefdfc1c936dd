"""CGNS meshes (.cgns) in HDF5 or ADF, of unstructured zones and of blocks (structured zones).

They are read in pieces if they have one unstructured zone, whose sections have one shape each and are not packed.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.files import fresh
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.mesh.cells import MIRRORED, VOLUMES, Polyhedra, Zone
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.pieces import MeshOnDisk

from .adf import MARK, AdfCoordinates, AdfStored, Column, Tree
from .cgns_boundary import NumberedFaces, notes_of, without, zone_border
from .cgns_elements import MIXED, NFACE, NGON, SHAPES, SIZES, ElementSection, blocks, sections
from .cgns_hdf5 import HdfNode, HdfStored
from .cgns_nodes import Node, Stored, child, data, has, reals
from .cgns_read import Base, base_of, coordinate_data, coordinates_beside, may_fit, read_base
from .cgns_write import write_base
from .format import Format
from .hdf5 import Dataset, Datasets, damage
from .table_pieces import CellTable, PointRange, TablePieces
from .tables import FileTable

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer as Buffer


# A version between CGNS 3.0 and later ones; 3.0 numbers the types of elements otherwise.
RENUMBERED = 3.05
CELLS = {number: shape for number, shape in SHAPES.items() if shape in VOLUMES}
# What the library's version is stored in.
VERSION = "CGNSLibraryVersion"


def in_pieces(path: Path, file: Node) -> MeshOnDisk | None:
    """Return the mesh of an open file; None if it must be read as a whole.

    MeshFileError or ValueError if the file is damaged.
    """
    base = base_of(file)
    if len(base.zones) != 1 or base.dimension != 3 or may_fit(base):
        return None
    ((name, zone),) = base.zones.items()
    elements, (count,) = sections(zone), base.sizes[name]
    points, cells = _points(path, base, name, count), _cells(path, elements)
    faces = _faces(elements, count) if points and cells else None
    if faces is None:
        return None
    border = zone_border(base.node, zone, faces, elements[-1].last, count, base.dimension)
    patches = without(border.patches, {fault.patch for fault in border.faults})
    pieces = TablePieces(str(path.resolve()), count, points, cells).orient()
    notes = (*notes_of({name: border.faults}), *coordinates_beside(file, base))
    return MeshOnDisk(path.name, pieces, patches, (Zone(name, 0, count),), notes)


def _points(path: Path, base: Base, zone: str, count: int) -> tuple[PointRange, ...]:
    """Return where the coordinates of a zone stand; empty if some are packed, or if two axes share an array."""
    axes = coordinate_data(base, zone)
    places = [axis.begin for axis in axes]
    if not all(places) or len(set(places)) < len(axes):
        return ()
    tables = [FileTable(path, begin, axis.dtype.str, count) for begin, axis in zip(places, axes, strict=True)]
    return tuple(PointRange(0, count, table, i, i + 1) for i, table in enumerate(tables))


def _cells(path: Path, elements: Sequence[ElementSection]) -> tuple[CellTable, ...]:
    """Return where the cells of all sections stand; empty if some are packed, mixed or polyhedra."""
    if any(_is_mixed(section) for section in elements):
        return ()
    cells = []
    for section in elements:
        if shape := CELLS.get(section.kind):
            table = _table(path, section)
            if table is None:
                return ()
            cells.append(CellTable(shape, table, 1, MIRRORED[shape] if shape == "wedge" else ()))
    return tuple(cells)


def _is_mixed(section: ElementSection) -> bool:
    """Whether cells are polyhedra, or of several shapes; only the first element is read."""
    if section.kind == MIXED:
        first = data(child(section.node, "ElementConnectivity")).first()
        return first is None or first not in SHAPES or first in CELLS
    return section.kind in (NGON, NFACE)


def _table(path: Path, section: ElementSection) -> FileTable | None:
    """Return the table of a section's nodes; None if they are packed."""
    stored, size = data(child(section.node, "ElementConnectivity")), SIZES[section.kind]
    if stored.dtype.kind not in "iu" or stored.size != size * len(section):
        raise MeshFileError(
            f"section {section.name} has {len(section)} elements of {size} nodes, but {stored.size} nodes; the file is "
            "damaged"
        )
    begin, kind = stored.begin, stored.dtype.str
    return FileTable(path.resolve(), begin, kind, len(section), size) if begin else None


def _faces(elements: Sequence[ElementSection], points: int) -> list[NumberedFaces] | None:
    """Return the faces of all sections without cells; None if a section has faces and cells."""
    faces = []
    for section in elements:
        for block, numbers in blocks(section, points, 3) if section.kind not in CELLS else ():
            if not len(numbers):
                return None
            faces.append(NumberedFaces(section.name, block, numbers))
    return faces


class Cgns(Format):
    """Zones with cells of every linear shape, polyhedra, or blocks of hexahedra; patches are the boundary conditions.

    Zones that fit together point by point, by the file's interfaces, are one zone of the mesh with one point at each
    place. Everything else in a file (solutions, families, units) is no part of the mesh; a rewritten file keeps it.
    Coordinates in single precision stay in single precision.
    """

    name = "cgns"
    suffixes = (".cgns",)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        with about(path), open_tree(path) as file:
            return read_base(file, partial(progress, f"reading {path.name}")).mesh

    for_workers = "CGNS files of one unstructured zone"
    zoned = True

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshOnDisk | None:
        with about(path), open_tree(path) as file:
            return in_pieces(path.resolve(), file)

    def finer(self, out: Path, mesh: Mesh) -> str:
        return "" if any(isinstance(block, Polyhedra) for block in mesh.cells) else ".su2"

    def coordinates(self, path: Path) -> Datasets | AdfCoordinates:
        with open_tree(path) as file:
            base, parts, start = base_of(file), list[Dataset | Column](), 0
            for name, size in base.sizes.items():
                stop = start + prod(size)
                for axis, array in enumerate(coordinate_data(base, name)):
                    parts.append(_part(path, array, start, stop, axis))
                start = stop
            index = first = np.arange(start)
            if may_fit(base):
                mesh_of_file = read_base(file, lambda _: None)
                index, first = mesh_of_file.index, mesh_of_file.first
            kept = [part for part in parts if isinstance(part, Dataset)]
            columns = [part for part in parts if isinstance(part, Column)]
            return Datasets(path, kept, index, first) if kept else AdfCoordinates(path, columns, index, first)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; each patch is a family and a boundary condition that its family specifies."""
        with fresh(out) as beside, about(out), _file_to_write(beside) as file:
            return write_base(file, mesh, partial(progress, f"writing {out.name}"))


def _part(path: Path, stored: Stored, start: int, stop: int, axis: int) -> Dataset | Column:
    """Return one coordinate of the stored points start to stop - 1."""
    if isinstance(stored, AdfStored):
        return Column(stored.tables(path), start, stop, axis)
    assert isinstance(stored, HdfStored)
    return Dataset(stored.path, stored.dtype, start, stop, axis, axis + 1)


class _Kept(io.FileIO):
    """A file that reports its first write error at the end, because HDF5 crashes on errors while it closes."""

    error: OSError | None = None

    def write(self, data: Buffer, /) -> int:
        """Write all of the data; an error is stored."""
        left = memoryview(data).cast("B")
        size = len(left)
        with self._keeping():
            while len(left):
                left = left[super().write(left) :]
        return size

    def truncate(self, size: int | None = None, /) -> int:
        """Set the size of the file; an error is stored."""
        with self._keeping():
            super().truncate(size)
        return self.tell() if size is None else size

    @contextmanager
    def _keeping(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.error = self.error or error


@contextmanager
def _file_to_write(path: Path) -> Iterator[Any]:
    """Open an empty file for HDF5 to write; OSError at the end if any part of it was not written."""
    with _Kept(path, "r+") as kept:
        try:
            with h5py.File(kept, "w", track_order=True) as file:
                yield file
        finally:
            if kept.error:
                raise kept.error


@contextmanager
def open_tree(path: Path) -> Iterator[Node]:
    """Open a file to read, and return the root of its nodes; MeshFileError for damage found in the block."""
    with ExitStack() as stack:
        file = stack.enter_context(path.open("rb"))
        stack.enter_context(damage())
        if MARK in file.read(32):
            root: Node = Tree(file).root
        elif h5py.is_hdf5(path):
            root = HdfNode(stack.enter_context(h5py.File(path)))
        else:
            raise MeshFileError("this is no CGNS file, neither in HDF5 nor in ADF")
        version = reals(child(root, VERSION)) if has(root, VERSION) else None
        if version and version.size and 3.0 <= version.read().flat[0] < RENUMBERED:
            raise MeshFileError("is of CGNS 3.0, which numbers elements otherwise: cgnsupdate OLD.cgns NEW.cgns")
        yield root
