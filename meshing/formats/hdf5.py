"""Files in HDF5: errors of damage, checks of what is stored, and coordinates in datasets."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import FULL, MeshFileError
from sdm_deflect.base.files import fresh
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.base.unpacking import check_unpacked
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.mesh.precision import fewest_bits

from .coordinates import moved_coordinates
from .rewriting import check_large

# What h5py raises for a damaged file.
DAMAGE = (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError)
Array = NDArray[Any]
# Byte at which the numbers first to last - 1 of an array begin.
Span = tuple[int, int, int]


@contextmanager
def damage() -> Iterator[None]:
    """Turn h5py's errors into a MeshFileError of one sentence; errors of a full disk pass."""
    try:
        yield
    except MeshFileError:
        raise
    except DAMAGE as error:
        if isinstance(error, OSError) and error.errno in FULL:
            raise
        reason = " ".join(str(error).split())
        raise MeshFileError(f"the file is truncated or damaged ({reason})") from error


def check_stored(stored: Any, name: str) -> None:
    """Raise MeshFileError for a dataset that would take too much memory or is not stored completely."""
    length = stored.file.id.get_filesize()
    largest = max(stored.size * max(stored.dtype.itemsize, 8), prod(stored.chunks or ()) * stored.dtype.itemsize)
    check_unpacked(largest, length, f"the data of {name}")
    if stored.chunks:
        expected = prod(-(-size // chunk) for size, chunk in zip(stored.shape, stored.chunks, strict=True))
        if (held_chunks := stored.id.get_num_chunks()) < expected:
            raise MeshFileError(f"{name} holds {held_chunks} of {expected} parts of its data; the file is incomplete")
    elif stored.id.get_storage_size() != stored.nbytes:
        raise MeshFileError(f"{name} holds no data, or not all; the file is damaged")


def is_real(stored: Any) -> bool:
    """Whether a dataset holds real numbers of a kind that NumPy has."""
    return stored.dtype.kind == "f" and bool(h5py.h5t.py_create(stored.dtype) == stored.id.get_type())


@contextmanager
def open_hdf5(path: Path, kind: str) -> Iterator[Any]:
    """Open a file to read; MeshFileError if it is no HDF5, or for damage found in the block."""
    with path.open("rb"):  # the system's own words where it cannot be read
        pass
    if not h5py.is_hdf5(path):
        raise MeshFileError(f"this is no file in HDF5, which {kind} is")
    with damage(), h5py.File(path) as file:
        yield file


def member(group: Any, path: str) -> Any:
    """Return the group or dataset at a path in a group; MeshFileError if it is absent or a link."""
    node = group
    for name in path.split("/"):
        link = node.get(name, getlink=True) if isinstance(node, h5py.Group) else None
        if link is None:
            raise MeshFileError(f"{_named(group, path)} is missing; the file is truncated, damaged, or of another kind")
        if not isinstance(link, h5py.HardLink):
            raise MeshFileError(f"{_named(group, path)} is a link; only what lies in the file itself is read")
        node = node[name]
    return node


def dataset(group: Any, path: str, kinds: str, what: str) -> Any:
    """Return the dataset at a path; its numbers must be of a NumPy kind, which `what` names in errors.

    MeshFileError if the kind is another, if data stand in other files or datasets, or if the dataset is much larger
    than the file.
    """
    stored, name = member(group, path), _named(group, path)
    if not isinstance(stored, h5py.Dataset) or stored.shape is None or stored.dtype.kind not in kinds:
        raise MeshFileError(f"{name} holds no {what}; the file is damaged")
    if stored.dtype.kind == "f" and not is_real(stored):
        raise MeshFileError(f"the kind of real numbers that {name} holds is not supported")
    if stored.external or stored.is_virtual:
        raise MeshFileError(f"{name} holds data of other files or datasets; only what lies in the file itself is read")
    check_stored(stored, name)
    return stored


def integers(group: Any, path: str) -> IntArray:
    """Return the whole numbers (K,) at a path, flat; MeshFileError as `dataset`."""
    stored = dataset(group, path, "iu", "whole numbers")
    return np.asarray(stored[()], dtype=np.intp).reshape(-1)


def number(node: Any, name: str) -> int:
    """Return the value of an attribute; MeshFileError unless it is a whole number."""
    values = np.asarray(node.attrs.get(name, ())).reshape(-1)
    if len(values) != 1 or values.dtype.kind not in "iu":
        raise MeshFileError(f"{node.name.strip('/')} has no number {name}; the file is truncated or damaged")
    return int(values[0])


def spans(stored: Any) -> list[Span]:
    """Return where the numbers of a dataset stand in its file; empty if HDF5 has packed them."""
    packed = stored.id.get_create_plist().get_nfilters() > 0
    if stored.file.userblock_size or (stored.chunks and (packed or stored.chunks[1:] != stored.shape[1:])):
        return []
    if not stored.chunks:
        offset = stored.id.get_offset()
        return [(offset, 0, stored.size)] if offset else []
    chunks: list[Any] = []
    stored.id.chunk_iter(chunks.append)
    width, size = prod(stored.shape[1:]), prod(stored.chunks)
    starts = [(chunk.byte_offset, chunk.chunk_offset[0] * width) for chunk in chunks]
    return [(begin, first, min(first + size, stored.size)) for begin, first in starts]


class Dataset(NamedTuple):
    """A dataset of an HDF5 file: its name and type, and where its numbers stand.

    Attributes
    ----------
    name, kind : name and type.
    start, stop : its rows are the stored points start to stop - 1.
    first, end : each row has the coordinates `first` to `end` - 1 of a point.
    """

    name: str
    kind: np.dtype[Any]
    start: int
    stop: int
    first: int
    end: int


@dataclass(frozen=True, slots=True, eq=False)
class Datasets:
    """Coordinates in datasets of an HDF5 file; where they are packed, HDF5 may put them elsewhere in it.

    Attributes
    ----------
    path : the file.
    parts : the datasets.
    index, stored : (S,) node of each stored point, and (N,) the first stored point of each node. Points of several
        zones that are one node get the same coordinates.
    """

    path: Path
    parts: Sequence[Dataset]
    index: IntArray = field(repr=False)
    stored: IntArray = field(repr=False)

    @classmethod
    def of(cls, path: Path, parts: Sequence[Dataset]) -> Datasets:
        """Take datasets in which each stored point is a node."""
        nodes = np.arange(max((part.stop for part in parts), default=0))
        return cls(path, parts, nodes, nodes)

    @property
    def count(self) -> int:
        return len(self.stored)

    @property
    def kind(self) -> np.dtype[Any]:
        return fewest_bits(part.kind for part in self.parts)

    def copy(self, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        with fresh(out, self.path) as beside, about(self.path):
            shutil.copyfile(self.path, beside)
            with damage(), h5py.File(beside, "r+") as file:
                places = [(part.start, part.stop, part.first, part.end) for part in self.parts]
                before_all = ((place, file[part.name][()]) for place, part in zip(places, self.parts, strict=True))
                several = len(self.index) > self.count
                moved = moved_coordinates(before_all, self.stored, points) if several else None
                for i, part in enumerate(self.parts, 1):
                    dataset, axes = file[part.name], slice(part.first, part.end)
                    nodes = slice(part.start, part.stop) if moved is None else self.index[part.start : part.stop]
                    before, new = dataset[()], points[nodes, axes]
                    put = moved[nodes, axes] if moved is not None else before.reshape(new.shape) != new
                    if put.any():
                        check_large(new[put], part.kind)
                        np.copyto(before.reshape(new.shape), new, "same_kind", put)
                        dataset[...] = before
                    progress(f"writing {out.name}", i / len(self.parts))


def _named(group: Any, path: str) -> str:
    return f"{group.name}/{path}".strip("/")
