"""CGNS meshes (.cgns) in HDF5, of unstructured zones in three dimensions."""

from __future__ import annotations

import io
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from sdm_deflect.deform.mesh import Cells, Mesh, Polyhedra
from sdm_deflect.deform.progress import Progress, silent
from sdm_deflect.meshing.files import fresh
from sdm_deflect.meshing.formats.cgns_boundary import NumberedFaces, conditions, patches
from sdm_deflect.meshing.formats.cgns_elements import NFACE, NGON, Section, blocks, read_polyhedra, sections
from sdm_deflect.meshing.formats.cgns_nodes import AXES, Array, child, children, data, integers, text
from sdm_deflect.meshing.formats.cgns_packed import overwrite
from sdm_deflect.meshing.formats.cgns_write import write_base
from sdm_deflect.meshing.formats.format import MeshFileError, about, check_points
from sdm_deflect.meshing.formats.hdf5 import damage, is_real
from sdm_deflect.meshing.formats.shapes import check_faces, oriented
from sdm_deflect.meshing.formats.zones import joined
from sdm_deflect.meshing.mesh import FloatArray

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer as Buffer

ADF = b"ADF Database"


@dataclass(frozen=True, slots=True)
class Cgns:
    """Zones with cells of every linear shape, or polyhedra; patches are the boundary conditions.

    Everything else in a file (solutions, connections of zones, families, units) is no part of the mesh; a rewritten
    file keeps it. Coordinates in single precision stay in single precision.
    """

    name: str = "cgns"
    suffixes: tuple[str, ...] = (".cgns",)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        with about(path), _opened(path) as file:
            return read_base(file, partial(progress, f"reading {path.name}"))

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; only numbers in CoordinateX, CoordinateY and CoordinateZ change."""
        with about(source), _opened(source) as file:
            stored = [coordinate_data(zone) for _, zone in zones(file)[1]]
            check_points(points, sum(len(own[0]) for own in stored))
            _check_apart([axis for own in stored for axis in own])
            moved = list(_moved(stored, points))
            plain = {axis.id.get_offset(): new for axis, new in moved if axis.id.get_offset()}
            packed = {axis.name: new for axis, new in moved if not axis.id.get_offset()}
        with fresh(out, source) as beside, about(source):
            progress(f"writing {out.name}", 0.0)
            shutil.copyfile(source, beside)
            with beside.open("r+b") as copy:
                for place, new in plain.items():
                    copy.seek(place)
                    copy.write(new.tobytes())
            if packed:
                overwrite(beside, packed)
            progress(f"writing {out.name}", 1.0)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; each patch is a family and a boundary condition that its family specifies."""
        with fresh(out) as beside, about(out), _written(beside) as file:
            return write_base(file, mesh, partial(progress, f"writing {out.name}"))


class _Kept(io.FileIO):
    """A file that takes whatever HDF5 writes, and keeps the first error: HDF5 crashes on errors while it closes."""

    error: OSError | None = None

    def write(self, data: Buffer, /) -> int:
        """Write all of the data, or keep the error that prevents it."""
        left = memoryview(data).cast("B")
        size = len(left)
        with self._keeping():
            while len(left):
                left = left[super().write(left) :]
        return size

    def truncate(self, size: int | None = None, /) -> int:
        """Set the size of the file, or keep the error that prevents it."""
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
def _written(path: Path) -> Iterator[Any]:
    """Open an empty file for HDF5 to write; OSError at the end if any part of it was not written."""
    with _Kept(path, "r+") as kept:
        try:
            with h5py.File(kept, "w", track_order=True) as file:
                yield file
        finally:
            if kept.error:
                raise kept.error


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    with path.open("rb") as file:
        head = file.read(64)
    if not h5py.is_hdf5(path):
        if ADF in head:
            raise MeshFileError("this is a CGNS file in ADF; convert it to HDF5 with `cgnsconvert -h IN.cgns OUT.cgns`")
        raise MeshFileError("this is no CGNS file in HDF5")
    with damage(), h5py.File(path) as opened:
        yield opened


def _check_apart(axes: Sequence[Any]) -> None:
    """Refuse (MeshFileError) coordinates that share bytes: one cannot be replaced without the other."""
    places = sorted((axis.id.get_offset(), axis.nbytes) for axis in axes if axis.id.get_offset())
    shared = any(begin + size > after for (begin, size), (after, _) in pairwise(places))
    if shared or len({h5py.h5o.get_info(axis.id).addr for axis in axes}) < len(axes):
        raise MeshFileError("coordinates of several axes or zones are one and the same data")


def _moved(stored: Sequence[Sequence[Any]], points: FloatArray) -> Iterator[tuple[Any, Array]]:
    """Yield the datasets that change, and their new values; values that do not change keep their bits."""
    start = 0
    for own in stored:
        for column, axis in enumerate(own):
            old = axis[()]
            new = points[start : start + len(old), column]
            changed = old.astype(np.float64) != new
            if changed.any():
                yield axis, np.where(changed, new, old).astype(old.dtype)
        start += len(own[0])


def read_base(file: Any, report: Callable[[float], None]) -> Mesh:
    """Return the mesh of an open file, its zones one after another.

    MeshFileError or ValueError if the file is damaged, or holds what is no unstructured mesh in three dimensions.
    """
    base, found = zones(file)
    parts = []
    for i, (name, zone) in enumerate(found):
        report(i / len(found))
        try:
            parts.append(_zone(base, zone))
        except (MeshFileError, ValueError) as error:
            raise MeshFileError(f"zone {name}: {error}") from error
    report(1.0)
    return joined([name for name, _ in found], parts)


def zones(file: Any) -> tuple[Any, list[tuple[str, Any]]]:
    """Return the base of a file, and its zones with their names.

    MeshFileError if there is not one base in three dimensions, no zone, or a structured zone.
    """
    bases = [base for _, base in children(file, "CGNSBase_t")]
    if not bases:
        raise MeshFileError("this HDF5 file has no CGNSBase_t; it is no CGNS file, or it is damaged")
    solid = [base for base in bases if integers(base).tolist() == [3, 3]]
    if len(solid) != 1:
        raise MeshFileError(
            f"{len(solid)} of {len(bases)} bases have cells and points in three dimensions; one is needed"
        )
    found = list(children(solid[0], "Zone_t"))
    if not found:
        raise MeshFileError("the file has no zones")
    if other := [name for name, zone in found if text(child(zone, "ZoneType")) != "Unstructured"]:
        raise MeshFileError(
            f"{len(other)} zones are structured ({', '.join(other[:3])}); only unstructured zones can be read: export "
            "the mesh as unstructured from the program that made it"
        )
    return solid[0], found


def coordinate_data(zone: Any) -> list[Any]:
    """Return the datasets (N,) of x, y and z of a zone; MeshFileError if one is missing, or of another length."""
    grid = child(zone, "GridCoordinates")
    found = [data(child(grid, axis)) for axis in AXES]
    sizes = integers(zone)
    if len(sizes) != 3:
        raise MeshFileError(f"its size has {len(sizes)} numbers, expected 3; the file is damaged")
    points = int(sizes[0])
    for axis, stored in zip(AXES, found, strict=True):
        if stored.shape != (points,) or stored.dtype.kind != "f":
            raise MeshFileError(f"{axis} holds {stored.shape} {stored.dtype}, expected ({points},) real numbers")
        if not is_real(stored):
            raise MeshFileError(f"{axis} holds real numbers of an unknown kind; the file is damaged")
    return found


def _zone(base: Any, zone: Any) -> Mesh:
    points = np.stack([axis[()] for axis in coordinate_data(zone)], axis=1).astype(np.float64, copy=False)
    found = sections(zone)
    if not found:
        raise MeshFileError("it has no elements")
    polyhedral = any(section.kind in (NGON, NFACE) for section in found)
    cells, faces = (_polyhedral if polyhedral else _shaped)(found, points)
    named = patches(conditions(base, zone, found[-1].last, len(points)), faces, found[-1].last)
    mesh = Mesh(points, cells, tuple(named))
    check_faces(mesh)
    return mesh


def _shaped(found: Sequence[Section], points: FloatArray) -> tuple[tuple[Cells, ...], list[NumberedFaces]]:
    cells, faces = [], []
    for section in found:
        for block, numbers in blocks(section, len(points)):
            if len(numbers):
                faces.append(NumberedFaces(section.name, block, numbers))
            else:
                cells.append(oriented(points, block))
    return tuple(cells), faces


def _polyhedral(found: Sequence[Section], points: FloatArray) -> tuple[tuple[Polyhedra], list[NumberedFaces]]:
    if others := [section.name for section in found if section.kind not in (NGON, NFACE)]:
        raise MeshFileError(f"cells by their faces (NGON_n) and other elements ({', '.join(others)}) in one zone")
    block, numbers = read_polyhedra(found, len(points))
    inner = len(block.neighbour)
    faces = [
        NumberedFaces(None, block.faces.rows(0, inner), numbers[:inner], outer=False),
        NumberedFaces(None, block.faces.rows(inner, len(block.faces)), numbers[inner:]),
    ]
    return (block,), faces
