"""Meshes whose numbers stand in a file as they are: read in pieces, and rewritten where they stand."""

import errno
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import CORNERS, Cells
from sdm_deflect.deform.mesh.pieces import HERE, Runner
from sdm_deflect.deform.mesh.polyhedra import SomePolyhedra
from sdm_deflect.deform.mesh.unchanged import States, check_unchanged
from sdm_deflect.meshing.files.staged import fresh, written
from sdm_deflect.meshing.formats.format import MeshFileError, about
from sdm_deflect.meshing.formats.shapes import AXES, MIRRORED, SAMPLE, left_handed

RANGE = 1 << 23
"""Bytes of a file that are copied at a time."""
WITHOUT_COPYING = (None, errno.EXDEV, errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)
"""What a system answers that cannot copy from file to file; None is no such function at all."""
SMALL = 1 << 26
"""Bytes of a table that is read whole where some of its rows are wanted."""
SHORTER = "the file has become shorter"
Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of numbers at equal distances in a file.

    Attributes
    ----------
    path : the file.
    begin : byte at which the first row begins.
    kind : type of the numbers, such as ``"<f8"``.
    rows, width : how many rows there are, and numbers in each.
    stride : bytes from one row to the next; 0: a row is as long as its numbers.
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
        """Return all rows (rows, width), of whole numbers."""
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
        """Return the first row, and the one after the last, of those that have bytes from `begin` to `end` - 1."""
        size = self.width * np.dtype(self.kind).itemsize
        low = (begin - self.begin - size) // self.step + 1
        return max(low, 0), min(-(-(end - self.begin) // self.step), self.rows)


@dataclass(frozen=True, slots=True)
class Joined:
    """Tables of as many numbers in each row, one after another."""

    tables: tuple[Table, ...]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return sum(table.rows for table in self.tables)

    def read(self, start: int, stop: int) -> Array:
        """See `Table.read`."""
        none = self.tables[0].read(0, 0)
        return np.concatenate([none, *(table.read(low, high) for table, low, high in self._parts(start, stop))])

    def some(self, rows: IntArray) -> Array:
        """See `Table.some`."""
        order = np.argsort(rows, kind="stable")
        found, end = [], 0
        for table in self.tables:
            low, high = np.searchsorted(rows, (end, end + table.rows), sorter=order)
            found.append(table.some(rows[order[low:high]] - end))
            end += table.rows
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        return np.asarray(np.concatenate(found)[back])

    def _parts(self, start: int, stop: int) -> Iterator[tuple[Table, int, int]]:
        end = 0
        for table in self.tables:
            low, high = max(start, end) - end, min(stop, end + table.rows) - end
            if low < high:
                yield table, low, high
            end += table.rows


@dataclass(frozen=True, slots=True)
class PointRange:
    """Points start to stop - 1: a table of each coordinate, or one of all three."""

    start: int
    stop: int
    tables: tuple[Table, ...]

    def columns(self) -> tuple[tuple[Table, slice], ...]:
        """Return each table with the coordinates that it holds."""
        if len(self.tables) == 1:
            return ((self.tables[0], slice(0, 3)),)
        return tuple((table, slice(i, i + 1)) for i, table in enumerate(self.tables))


@dataclass(frozen=True, slots=True)
class CellTable:
    """Cells of one shape: the table of their nodes, the number of the first point, and the order of VTK's nodes."""

    shape: str
    table: Table | Joined
    first: int = 1
    order: tuple[int, ...] = ()

    def nodes(self, start: int, stop: int) -> IntArray:
        """Return nodes (stop - start, k) of cells."""
        return self.counted(self.table.read(start, stop))

    def counted(self, stored: Array) -> IntArray:
        """Return stored nodes (M, k) counted from 0 in VTK's order."""
        nodes = np.take(stored, self.order, axis=1) if self.order else stored
        own = np.intp if nodes.dtype.kind == "u" else nodes.dtype.newbyteorder("=")
        return np.asarray(nodes.astype(own, copy=False) - self.first)


@dataclass(frozen=True, slots=True)
class TablePieces:
    """See `Pieces`: points and cells in tables of one file."""

    source: str
    points: int
    ranges: tuple[PointRange, ...]
    cells: tuple[CellTable, ...]
    files: States = field(default_factory=dict, kw_only=True, repr=False)

    @property
    def blocks(self) -> tuple[tuple[str, int], ...]:
        """See `Pieces.blocks`."""
        return tuple((own.shape, own.table.rows) for own in self.cells)

    def coordinates(self, start: int, stop: int) -> FloatArray:
        """See `Pieces.coordinates`."""
        check_unchanged(self.files, elsewhere=True)
        found = np.empty((stop - start, 3))
        for own in self.ranges:
            low, high = max(start, own.start), min(stop, own.stop)
            for table, columns in own.columns() if low < high else ():
                found[low - start : high - start, columns] = table.read(low - own.start, high - own.start)
        return found

    def places(self, nodes: IntArray) -> FloatArray:
        """See `Pieces.places`."""
        check_unchanged(self.files, elsewhere=True)
        found = np.empty((len(nodes), 3))
        for own in self.ranges:
            rows = np.flatnonzero((nodes >= own.start) & (nodes < own.stop))
            for table, columns in own.columns() if len(rows) else ():
                found[rows, columns] = table.some(nodes[rows] - own.start)
        return found

    def cells_of(self, block: int, start: int, stop: int) -> Cells | SomePolyhedra:
        """See `Pieces.cells_of`."""
        check_unchanged(self.files, elsewhere=True)
        return Cells(self.cells[block].shape, self.cells[block].nodes(start, stop))

    def oriented(self) -> Self:
        """Return it with each block in VTK's order, whichever of the two orders the file used (`shapes.oriented`)."""
        return replace(self, cells=tuple(self._oriented(own) for own in self.cells))

    def _oriented(self, cells: CellTable) -> CellTable:
        if not cells.table.rows:
            return cells
        rows = np.arange(0, cells.table.rows, max(1, cells.table.rows // SAMPLE))
        nodes = cells.counted(cells.table.some(rows))[:, [0, *AXES[cells.shape]]]
        if nodes.min() < 0 or nodes.max() >= self.points:
            raise MeshFileError(f"{cells.shape} elements name points that are not among the {self.points}")
        corners = self.places(nodes.ravel()).reshape(-1, 4, 3)
        if not left_handed(corners):
            return cells
        order = cells.order or range(CORNERS[cells.shape])
        return replace(cells, order=tuple(order[i] for i in MIRRORED[cells.shape]))

    def rewrite(
        self, nodes: IntArray, points: FloatArray, out: Path, progress: Progress = silent, runner: Runner = HERE
    ) -> None:
        """See `Pieces.rewrite`; MeshFileError for points that the file's numbers cannot hold."""
        source = Path(self.source)
        with fresh(out, source) as beside, about(source):
            items = self.items(nodes, points, source)
            with written(out):
                os.truncate(beside, source.stat().st_size)
            for i, _ in enumerate(runner.map(copy_range, (source, beside), items), 1):
                progress(f"writing {out.name}", i / len(items))

    def items(self, nodes: IntArray, points: FloatArray, file: Path) -> list["Item"]:
        """Return all bytes of the file of the points, range by range, with what is to stand there (`copy_range`)."""
        changes, size = tuple(self._changes(nodes, points)), file.stat().st_size
        return [item_of(changes, start, min(start + RANGE, size)) for start in range(0, size, RANGE)]

    def _changes(self, nodes: IntArray, points: FloatArray) -> Iterator["Change"]:
        for own in self.ranges:
            first, end = np.searchsorted(nodes, (own.start, own.stop))
            for table, columns in own.columns():
                change = Change(table, nodes[first:end] - own.start, points[first:end, columns])
                change.check()
                yield change


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Values (R, width) that are to stand in sorted rows (R,) of a table."""

    table: Table
    rows: IntArray = field(repr=False)
    values: FloatArray = field(repr=False)

    def check(self) -> None:
        """Raise a ValueError if the table cannot hold the values."""
        kind = np.dtype(self.table.kind)
        if np.abs(self.values).max(initial=0.0) > np.finfo(kind).max or not np.isfinite(self.values).all():
            raise ValueError(f"coordinates are too large for numbers of {kind.itemsize} bytes")

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
        """Write the values into the bytes of the file from `start` on; equal ones keep their bytes."""
        table, first = self.table, int(self.rows[0])
        shape = int(self.rows[-1]) - first + 1, table.width
        strides = table.step, np.dtype(table.kind).itemsize
        stored = np.ndarray(shape, table.kind, data, table.begin + first * table.step - start, strides)
        before = stored[self.rows - first]
        stored[self.rows - first] = np.where(before == self.values, before, self.values)


Item = tuple[int, int, tuple[Change, ...]]


def item_of(changes: tuple[Change, ...], begin: int, end: int) -> Item:
    """Return bytes `begin` to `end` - 1 of a file with the changes that concern them."""
    parts = (change.within(begin, end) for change in changes)
    return begin, end, tuple(part for part in parts if len(part.rows))


def copy_range(files: tuple[Path, Path], item: Item) -> None:
    """Write some bytes of a copy, with their changes: alone, twice or in any order it comes to the same.

    Parameters
    ----------
    files : What is copied, and the copy, which has its length already.
    item : See `item_of`.
    """
    (source, out), (begin, end, changes) = files, item
    with about(source), source.open("rb") as old, _opened(out) as new:
        if not changes:
            _copy(old, new, begin, end)
            return
        ends = [own.ends() for own in changes]
        low, high = min(begin, *(first for first, _ in ends)), max(end, *(last for _, last in ends))
        data = bytearray(_read(old, low, high))
        for own in changes:
            own.put(data, low)
        _write(new, data[begin - low : end - low], begin)


def _opened(out: Path) -> BinaryIO:
    """Open a file that is there to write into it; MeshFileError where it is not: another machine made it."""
    try:
        return out.open("r+b", 0)
    except FileNotFoundError:
        raise MeshFileError(
            f"{out.name} is not there for the worker that is to write it: write to a file system that all workers see"
        ) from None


def _copy(old: BinaryIO, new: BinaryIO, begin: int, end: int) -> None:
    """Copy bytes within the system, which may share them, or else through memory."""
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
