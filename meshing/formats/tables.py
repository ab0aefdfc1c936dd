"""Tables: rows of numbers in a file, in memory, or joined one after another."""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import IntArray
from sdm_deflect.base.errors import MeshFileError, write_errors
from sdm_deflect.meshing.errors import about

# Largest bytes of a table that is read whole even for a few rows.
SMALL = 1 << 26
SHORTER = "the file has become shorter"
Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class FileTable:
    """Rows of numbers at equal distances in a file.

    Attributes
    ----------
    path : the file.
    begin : first byte of the first row.
    kind : type of the numbers, such as ``"<f8"``.
    rows, width : number of rows, and of numbers in each.
    stride : bytes between the begins of two rows; 0 if a row has nothing but its numbers.
    """

    path: Path
    begin: int
    kind: str
    rows: int
    width: int = 1
    stride: int = 0

    @property
    def step(self) -> int:
        """Bytes from one row to the next."""
        return self.stride or self.width * np.dtype(self.kind).itemsize

    def read(self, start: int, stop: int) -> Array:
        """Return rows (stop - start, width), as they are stored; MeshFileError if the file ends before."""
        count, size = stop - start, self.width * np.dtype(self.kind).itemsize
        with about(self.path):
            data = np.fromfile(self.path, np.uint8, count * self.step, offset=self.begin + start * self.step)
            if len(data) < count * self.step:
                raise MeshFileError(SHORTER)
        packed = np.ascontiguousarray(data.reshape(count, self.step)[:, :size])
        return packed.view(self.kind).reshape(count, self.width)

    def integers(self) -> IntArray:
        """Return all rows (rows, width) as whole numbers."""
        return self.read(0, self.rows).astype(np.intp)

    def some(self, rows: IntArray) -> Array:
        """Return some rows (R, width) in any order; MeshFileError if the file ends before."""
        if self.rows * self.step <= SMALL:
            return np.asarray(self.read(0, self.rows)[rows])
        size, places = np.dtype(self.kind).itemsize * self.width, self.begin + rows.astype(np.int64) * self.step
        with about(self.path), self.path.open("rb") as file:
            data = b"".join(os.pread(file.fileno(), size, at) for at in places.tolist())
            if len(data) < len(rows) * size:
                raise MeshFileError(SHORTER)
        return np.frombuffer(data, self.kind).reshape(len(rows), self.width)

    def within(self, begin: int, end: int) -> tuple[int, int]:
        """Return the range of rows that have bytes among `begin` to `end` - 1."""
        size = self.width * np.dtype(self.kind).itemsize
        low = (begin - self.begin - size) // self.step + 1
        return max(low, 0), min(-(-(end - self.begin) // self.step), self.rows)


@dataclass(frozen=True, slots=True)
class Joined:
    """Tables of equal width, one after another."""

    tables: tuple["FileTable | MemoryTable", ...]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return sum(table.rows for table in self.tables)

    @property
    def width(self) -> int:
        """Numbers in each row."""
        return self.tables[0].width

    def read(self, start: int, stop: int) -> Array:
        none = self.tables[0].read(0, 0)
        return np.concatenate([none, *(table.read(low, high) for table, low, high in self._parts(start, stop))])

    def some(self, rows: IntArray) -> Array:
        order = np.argsort(rows, kind="stable")
        parts, end = [], 0
        for table in self.tables:
            low, high = np.searchsorted(rows, (end, end + table.rows), sorter=order)
            parts.append(table.some(rows[order[low:high]] - end))
            end += table.rows
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        return np.asarray(np.concatenate(parts)[back])

    def _parts(self, start: int, stop: int) -> Iterator[tuple["FileTable | MemoryTable", int, int]]:
        end = 0
        for table in self.tables:
            low, high = max(start, end) - end, min(stop, end + table.rows) - end
            if low < high:
                yield table, low, high
            end += table.rows


@dataclass(frozen=True, slots=True, eq=False)
class MemoryTable:
    """Rows of numbers (rows, width) in memory: parsed from text, or reordered."""

    values: Array = field(repr=False)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.values)

    @property
    def width(self) -> int:
        """Numbers in each row."""
        return int(self.values.shape[1])

    @property
    def kind(self) -> str:
        """Type of the numbers."""
        return self.values.dtype.str

    def read(self, start: int, stop: int) -> Array:
        return self.values[start:stop]

    def some(self, rows: IntArray) -> Array:
        return self.values[rows]

    def integers(self) -> IntArray:
        return self.values.astype(np.intp)


def gather_tables(
    parts: Iterable[tuple[str, Array]], most: Callable[[str], int], scratch: Path | None
) -> dict[str, FileTable | MemoryTable]:
    """Collect the rows of several tables, which come in parts, in memory or in files of a folder.

    Parameters
    ----------
    parts : Pairs of a table's name and some rows (K, width) of it.
    most : Upper bound of the number of rows, by name; memory is used only for rows that come.
    scratch : An empty folder; None: memory.
    """
    rows: dict[str, int] = {}
    arrays: dict[str, Array] = {}
    with ExitStack() as stack:
        files: dict[str, BinaryIO] = {}
        for name, part in parts:
            done = rows.setdefault(name, 0)
            if scratch:
                with write_errors(scratch):
                    if name not in files:
                        files[name] = stack.enter_context((scratch / name).open("wb"))
                        arrays[name] = part[:0]
                    files[name].write(part.tobytes())
            else:
                if name not in arrays:
                    arrays[name] = np.empty((most(name), part.shape[1]), part.dtype)
                part = part[: len(arrays[name]) - done]
                arrays[name][done : done + len(part)] = part
            rows[name] += len(part)
    if not scratch:
        return {name: MemoryTable(values[: rows[name]]) for name, values in arrays.items()}
    return {
        name: FileTable(scratch / name, 0, array.dtype.str, rows[name], array.shape[1])
        for name, array in arrays.items()
    }
