"""Copies of a file with other numbers in some rows of its tables, range by range."""

import errno
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError, write_errors
from sdm_deflect.base.files import fresh
from sdm_deflect.base.threads import HERE, Progress, Runner, silent
from sdm_deflect.meshing.errors import about

from .tables import SHORTER, FileTable

# Bytes of a file that are copied at a time.
RANGE = 1 << 23
# Errors of a system that cannot copy from file to file; None: it has no such function.
WITHOUT_COPYING = (None, errno.EXDEV, errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)


def rewritten(
    source: Path, changes: Sequence["Change"], out: Path, progress: Progress = silent, runner: Runner = HERE
) -> None:
    """Write a copy of a file with other numbers in its tables; MeshFileError for numbers that they cannot hold."""
    with fresh(out, source) as beside, about(source):
        items = items_of(changes, source)
        with write_errors(out):
            os.truncate(beside, source.stat().st_size)
        for i, _ in enumerate(runner.map(copy_range, (source, beside), items), 1):
            progress(f"writing {out.name}", i / len(items))


def items_of(changes: Sequence["Change"], file: Path) -> list["Item"]:
    """Return the byte ranges of a file, each with its new content (`copy_range`)."""
    for change in changes:
        change.check()
    size = file.stat().st_size
    return [item_of(tuple(changes), start, min(start + RANGE, size)) for start in range(0, size, RANGE)]


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """New values (R, width) of sorted rows (R,) of a table."""

    table: FileTable
    rows: IntArray = field(repr=False)
    values: FloatArray = field(repr=False)

    def check(self) -> None:
        """Raise ValueError if the table's type cannot hold the values."""
        check_large(self.values, np.dtype(self.table.kind))

    def within(self, begin: int, end: int) -> "Change":
        """Return the part that changes bytes from `begin` to `end` - 1."""
        part = slice(*np.searchsorted(self.rows, self.table.within(begin, end)))
        return Change(self.table, self.rows[part], self.values[part])

    def ends(self) -> tuple[int, int]:
        """Return the first byte of its rows, and the one after the last."""
        table, (first, last) = self.table, self.rows[[0, -1]].tolist()
        size = table.width * np.dtype(table.kind).itemsize
        return table.begin + first * table.step, table.begin + last * table.step + size

    def put(self, data: bytearray, start: int) -> None:
        """Write the values into bytes of the file, the first of which is `start`; equal values keep their bytes."""
        table, first = self.table, int(self.rows[0])
        shape = int(self.rows[-1]) - first + 1, table.width
        strides = table.step, np.dtype(table.kind).itemsize
        stored = np.ndarray(shape, table.kind, data, table.begin + first * table.step - start, strides)
        rows = slice(None) if len(stored) == len(self.rows) else self.rows - first
        before = stored[rows]
        stored[rows] = np.where(before == self.values, before, self.values)


def check_large(values: FloatArray, kind: np.dtype[Any]) -> None:
    """Raise ValueError if coordinates are too large for a type of number."""
    if np.abs(values).max(initial=0.0) <= np.finfo(kind).max:  # false if one is no number
        return
    bad = np.count_nonzero(~(np.abs(values) <= np.finfo(kind).max))
    raise ValueError(f"{bad} coordinates are too large for numbers of {kind.itemsize} bytes")


Item = tuple[int, int, tuple[Change, ...]]


def item_of(changes: tuple[Change, ...], begin: int, end: int) -> Item:
    """Return the byte range `begin` to `end` - 1 of a file with the changes within it."""
    parts = (change.within(begin, end) for change in changes)
    return begin, end, tuple(part for part in parts if len(part.rows))


def copy_range(files: tuple[Path, Path], item: Item) -> None:
    """Write one byte range of the copy, with its changes. Idempotent and independent of order.

    Parameters
    ----------
    files : The file and its copy, which has its final length already.
    item : See `item_of`.
    """
    (source, out), (begin, end, changes) = files, item
    with about(source), source.open("rb") as old, _open_existing(out) as new:
        if not changes:
            _copy(old, new, begin, end)
            return
        ends = [change.ends() for change in changes]
        low, high = min(begin, *(first for first, _ in ends)), max(end, *(last for _, last in ends))
        data = bytearray(_read(old, low, high))
        for change in changes:
            change.put(data, low)
        _write(new, data[begin - low : end - low], begin)


def _open_existing(out: Path) -> BinaryIO:
    """Open an existing file for writing; MeshFileError if it is absent because another machine made it."""
    try:
        return out.open("r+b", 0)
    except FileNotFoundError:
        raise MeshFileError(
            f"{out.name} is not there for the worker that is to write it: write to a file system that all workers see"
        ) from None


def _copy(old: BinaryIO, new: BinaryIO, begin: int, end: int) -> None:
    """Copy bytes in the kernel, which may share them on disk, or else through memory."""
    try:
        while begin < end:
            if not (count := os.copy_file_range(old.fileno(), new.fileno(), end - begin, begin, begin)):
                raise MeshFileError(SHORTER)
            begin += count
    except (AttributeError, OSError) as error:
        if getattr(error, "errno", None) not in WITHOUT_COPYING:
            raise
        _write(new, _read(old, begin, end), begin)


def _read(file: BinaryIO, begin: int, end: int) -> bytes:
    file.seek(begin)
    data = file.read(end - begin)
    if len(data) < end - begin:
        raise MeshFileError(SHORTER)
    return data


def _write(file: BinaryIO, data: bytes | bytearray, begin: int) -> None:
    rest = memoryview(data)
    while rest:
        count = os.pwrite(file.fileno(), rest, begin)
        rest, begin = rest[count:], begin + count
