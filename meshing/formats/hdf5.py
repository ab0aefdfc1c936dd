"""Files in HDF5: errors of their damage, whether they store what they claim, and copies with other numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.errors import FULL, MeshFileError
from sdm_deflect.base.threads import Progress
from sdm_deflect.base.unpacking import check_unpacked

from .rewriting import Change, rewritten
from .tables import FileTable

DAMAGE = (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError)
"""What h5py raises for a damaged file."""
Array = NDArray[Any]
Span = tuple[int, int, int]
"""Byte at which the numbers first to last - 1 of an array begin."""
Replacement = tuple[Any, list[Span], FloatArray, BoolArray]
"""An open array, where its numbers are, their new values in its shape, and which of them change."""


@contextmanager
def damage() -> Iterator[None]:
    """Say in one sentence what h5py finds wrong: MeshFileError; errors of a full disk pass."""
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
    """Refuse (MeshFileError) a dataset that would take too much memory, or that the file holds only in part."""
    length = stored.file.id.get_filesize()
    largest = max(stored.size * max(stored.dtype.itemsize, 8), prod(stored.chunks or ()) * stored.dtype.itemsize)
    check_unpacked(largest, length, f"the data of {name}")
    if stored.chunks:
        expected = prod(-(-size // chunk) for size, chunk in zip(stored.shape, stored.chunks, strict=True))
        if (found := stored.id.get_num_chunks()) < expected:
            raise MeshFileError(f"{name} holds {found} of {expected} parts of its data; the file is incomplete")
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
    """Return what a group holds by a path of names; MeshFileError if it is not there, or elsewhere, by a link."""
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
    """Return the dataset at a path, whose numbers must be of a NumPy kind; `what` is the kind in words.

    MeshFileError if it is another, holds data in other files or datasets, or would take more memory than data of this
    file should.
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
    """Return an attribute that is a whole number; else MeshFileError."""
    values = np.asarray(node.attrs.get(name, ())).reshape(-1)
    if len(values) != 1 or values.dtype.kind not in "iu":
        raise MeshFileError(f"{node.name.strip('/')} has no number {name}; the file is truncated or damaged")
    return int(values[0])


def spans(stored: Any) -> list[Span]:
    """Return where the numbers of a dataset are in its file; an empty result if HDF5 has packed them."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Replaced:
    """New numbers in the arrays of a file.

    Parameters
    ----------
    changes : Those of arrays that are stored as they are.
    packed : All numbers of the others by the name of the dataset, if one changes.
    """

    changes: list[Change] = field(default_factory=list, repr=False)
    packed: dict[str, Array] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, path: Path, arrays: Sequence[Replacement]) -> Replaced:
        """Take open arrays of real numbers, each with where it is, its new values, and which of them changed.

        What does not change keeps its bits. MeshFileError if values are too large.
        """
        found = cls()
        for stored, own, values, changed in arrays:
            rows = np.flatnonzero(changed)
            new = Change(FileTable(path, 0, stored.dtype.str, stored.size), rows, values.reshape(-1, 1)[rows])
            new.check()
            for at, first, end in own:
                part = slice(*np.searchsorted(rows, (first, end)))
                table = FileTable(path, at, stored.dtype.str, end - first)
                found.changes.append(Change(table, rows[part] - first, new.values[part]))
            if not own and len(rows):
                found.packed[stored.name] = np.where(changed, values, stored[()]).astype(stored.dtype)
        return found

    def copy(self, source: Path, out: Path, progress: Progress) -> None:
        """Write a copy of the file; all but these numbers stays, but HDF5 may put packed data elsewhere in it."""
        rewritten(source, self.changes, out, progress, after=self._pack)

    def _pack(self, copy: Path) -> None:
        if self.packed:
            with damage(), h5py.File(copy, "r+") as file:
                for name, values in self.packed.items():
                    file[name][...] = values


def _named(group: Any, path: str) -> str:
    return f"{group.name}/{path}".strip("/")
