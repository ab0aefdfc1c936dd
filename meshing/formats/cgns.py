"""CGNS meshes (.cgns) in HDF5 or ADF, of unstructured zones and of blocks (structured zones)."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.pieces import MeshInPieces
from sdm_deflect.deform.mesh.precision import DOUBLE
from sdm_deflect.meshing.files.staged import fresh
from sdm_deflect.meshing.formats import adf
from sdm_deflect.meshing.formats.cgns_nodes import Array
from sdm_deflect.meshing.formats.cgns_packed import overwrite
from sdm_deflect.meshing.formats.cgns_pieces import in_pieces
from sdm_deflect.meshing.formats.cgns_read import base_of, coordinate_data, may_fit, read_base
from sdm_deflect.meshing.formats.cgns_write import write_base
from sdm_deflect.meshing.formats.format import MeshFileError, about, check_points, fewest_bits
from sdm_deflect.meshing.formats.hdf5 import damage

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer as Buffer


@dataclass(frozen=True, slots=True)
class Cgns:
    """Zones with cells of every linear shape, polyhedra, or blocks of hexahedra; patches are the boundary conditions.

    Zones that fit together point by point, by the file's interfaces, are one zone of the mesh with one point at each
    place. Everything else in a file (solutions, families, units) is no part of the mesh; a rewritten file keeps it.
    Coordinates in single precision stay in single precision, and a file in ADF stays one.
    """

    name: str = "cgns"
    suffixes: tuple[str, ...] = (".cgns",)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        with about(path), _opened(path) as file:
            return read_base(file, partial(progress, f"reading {path.name}")).mesh

    def in_pieces(self, path: Path) -> MeshInPieces | None:
        """See `registry.in_pieces`."""
        with about(path), _opened(path) as file:
            return in_pieces(path.resolve(), file)

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
            _check_apart([axis for own in stored for axis in own])
            moved = list(_moved(stored, points, index, first))
            plain = [(_pieces(axis), new.tobytes()) for axis, new in moved if _pieces(axis)]
            packed = {axis.name: new for axis, new in moved if not _pieces(axis)}
        with fresh(out, source) as beside, about(source):
            progress(f"writing {out.name}", 0.0)
            shutil.copyfile(source, beside)
            with beside.open("r+b") as copy:
                for pieces, new in plain:
                    begin = 0
                    for place, length in pieces:
                        copy.seek(place)
                        copy.write(new[begin : begin + length])
                        begin += length
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
        if adf.MARK in file.read(32):
            with damage():
                yield adf.Tree(file).root
            return
    if not h5py.is_hdf5(path):
        raise MeshFileError("this is no CGNS file, neither in HDF5 nor in ADF")
    with damage(), h5py.File(path) as opened:
        yield opened


def _check_apart(axes: Sequence[Any]) -> None:
    """Refuse (MeshFileError) coordinates that share bytes: one cannot be replaced without the other."""
    places = sorted(piece for axis in axes for piece in _pieces(axis))
    shared = any(begin + size > after for (begin, size), (after, _) in pairwise(places))
    packed = {h5py.h5o.get_info(axis.id).addr for axis in axes if not _pieces(axis)}
    if shared or len(packed) < sum(not _pieces(axis) for axis in axes):
        raise MeshFileError("coordinates of several axes or zones are one and the same data")


def _pieces(axis: Any) -> tuple[tuple[int, int], ...]:
    """Place and length of the bytes that hold data in the file as they are; none if they are packed."""
    if isinstance(axis, adf.Stored):
        return axis.pieces
    return ((axis.id.get_offset(), axis.nbytes),) if axis.id.get_offset() else ()


def _moved(
    stored: Sequence[Sequence[Any]], points: FloatArray, index: IntArray, first: IntArray
) -> Iterator[tuple[Any, Array]]:
    """Yield the data that change, and their new values; values that do not change keep their bits.

    `index` and `first` are those of `Fitted`: points of several zones that are one get the same values.
    """
    ends = np.cumsum([prod(own[0].shape) for own in stored])
    for column in range(len(stored[0])):
        old = [own[column][()] for own in stored]
        before = np.concatenate([values.ravel() for values in old]).astype(np.float64, copy=False)[first]
        new, changed = points[index, column], (before != points[:, column])[index]
        parts = zip(stored, old, np.split(new, ends[:-1]), np.split(changed, ends[:-1]), strict=True)
        for own, values, put, moved in parts:
            if moved.any():
                now = np.where(moved, put, values.ravel()).astype(values.dtype)
                yield own[column], now.reshape(values.shape)
