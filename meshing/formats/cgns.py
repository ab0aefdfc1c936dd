"""CGNS meshes (.cgns) in HDF5, of unstructured zones and of blocks (structured zones)."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.cells import Polyhedra
from sdm_deflect.deform.mesh.mesh import Mesh, MeshInPieces
from sdm_deflect.deform.mesh.precision import DOUBLE
from sdm_deflect.meshing.files import fresh
from sdm_deflect.meshing.formats.cgns_pieces import in_pieces
from sdm_deflect.meshing.formats.cgns_read import base_of, coordinate_data, may_fit, read_base
from sdm_deflect.meshing.formats.cgns_write import write_base
from sdm_deflect.meshing.formats.format import MeshFileError, about, check_points, fewest_bits
from sdm_deflect.meshing.formats.hdf5 import Replaced, Replacement, damage, spans
from sdm_deflect.meshing.formats.known import registered
from sdm_deflect.meshing.formats.layout import Format

ADF = b"ADF Database"
"""Mark at the beginning of files in ADF."""

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer as Buffer


@registered("cgns", ".cgns")
class Cgns(Format):
    """Zones with cells of every linear shape, polyhedra, or blocks of hexahedra; patches are the boundary conditions.

    Zones that fit together point by point, by the file's interfaces, are one zone of the mesh with one point at each
    place. Everything else in a file (solutions, families, units) is no part of the mesh; a rewritten file keeps it.
    Coordinates in single precision stay in single precision.
    """

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        with about(path), _opened(path) as file:
            return read_base(file, partial(progress, f"reading {path.name}")).mesh

    for_workers = "CGNS files in HDF5 of one unstructured zone"
    zoned = True

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshInPieces | None:
        """See `Format.layout`."""
        with about(path), _opened(path) as file:
            return in_pieces(path.resolve(), file)

    def finer(self, out: Path, mesh: Mesh) -> str:
        """See `Format.finer`."""
        return "" if any(isinstance(block, Polyhedra) for block in mesh.cells) else ".su2"

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        """See `Format.real`."""
        if source is None:
            return DOUBLE
        with about(source), _opened(source) as file:
            base = base_of(file)
            return fewest_bits(axis.dtype for name in base.zones for axis in coordinate_data(base, name))

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; only numbers in CoordinateX, CoordinateY and CoordinateZ change."""
        with about(source), _opened(source) as file:
            base = base_of(file)
            stored = [coordinate_data(base, name) for name in base.zones]
            index = first = np.arange(sum(prod(size) for size in base.sizes.values()))
            if may_fit(base):
                found = read_base(file, lambda _: None)
                index, first = found.index, found.first
            check_points(points, len(first))
            new = Replaced.of(source, _changed(stored, points, index, first))
        new.copy(source, out, progress)

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
    if not h5py.is_hdf5(path):
        with path.open("rb") as file:
            old = ADF in file.read(32)
        way = f"in ADF, of which HDF5 took the place; convert it: cgnsconvert -h {path.name} NEW.cgns"
        raise MeshFileError(f"this CGNS file is {way}" if old else "this is no CGNS file in HDF5")
    with damage(), h5py.File(path) as opened:
        yield opened


def _changed(
    stored: Sequence[Sequence[Any]], points: FloatArray, index: IntArray, first: IntArray
) -> list[Replacement]:
    """Return each array of coordinates with its new values, and which of them change; all others keep their bits.

    `index` and `first` are those of `Fitted`: points of several zones that are one get the same values.
    """
    ends, found = np.cumsum([prod(own[0].shape) for own in stored]), []
    for column in range(len(stored[0])):
        before = np.concatenate([own[column][()].ravel() for own in stored]).astype(np.float64, copy=False)[first]
        new, moved = points[index, column], (before != points[:, column])[index]
        parts = zip(stored, np.split(new, ends[:-1]), np.split(moved, ends[:-1]), strict=True)
        for own, put, changed in parts:
            axis = own[column]
            found.append((axis, spans(axis), put.reshape(axis.shape), changed.reshape(axis.shape)))
    return found
