"""Meshes whose numbers stand in a file as they are: read in pieces, and rewritten where they stand."""

import errno
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import CORNERS, PLANE, Cells
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
ROWS = 1 << 15
"""Points or cells that are put into arrays at a time."""
SHORTER = "the file has become shorter"
Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class FileTable:
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

    tables: tuple["FileTable | Held", ...]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return sum(table.rows for table in self.tables)

    @property
    def width(self) -> int:
        """Numbers in each row."""
        return self.tables[0].width

    def read(self, start: int, stop: int) -> Array:
        """See `FileTable.read`."""
        none = self.tables[0].read(0, 0)
        return np.concatenate([none, *(table.read(low, high) for table, low, high in self._parts(start, stop))])

    def some(self, rows: IntArray) -> Array:
        """See `FileTable.some`."""
        order = np.argsort(rows, kind="stable")
        found, end = [], 0
        for table in self.tables:
            low, high = np.searchsorted(rows, (end, end + table.rows), sorter=order)
            found.append(table.some(rows[order[low:high]] - end))
            end += table.rows
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        return np.asarray(np.concatenate(found)[back])

    def _parts(self, start: int, stop: int) -> Iterator[tuple["FileTable | Held", int, int]]:
        end = 0
        for table in self.tables:
            low, high = max(start, end) - end, min(stop, end + table.rows) - end
            if low < high:
                yield table, low, high
            end += table.rows


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """Rows of numbers (rows, width) in memory: what stood in the file as text, or had to be put in order."""

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
        """See `FileTable.read`."""
        return self.values[start:stop]

    def some(self, rows: IntArray) -> Array:
        """See `FileTable.some`."""
        return self.values[rows]

    def integers(self) -> IntArray:
        """See `FileTable.integers`."""
        return self.values.astype(np.intp)


def gathered(
    parts: Iterable[tuple[str, Array]], most: Callable[[str], int], scratch: Path | None
) -> dict[str, FileTable | Held]:
    """Put the rows of several tables, which come in parts, into memory, or into files of a folder.

    Parameters
    ----------
    parts : Name of a table, and some rows (K, width) of it.
    most : Returns for a name more rows than come; their memory is taken as it is filled.
    scratch : An empty folder; None: memory.
    """
    rows: dict[str, int] = {}
    arrays: dict[str, Array] = {}
    with ExitStack() as stack:
        files: dict[str, BinaryIO] = {}
        for name, part in parts:
            done = rows.setdefault(name, 0)
            if scratch:
                with written(scratch):
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
        return {name: Held(values[: rows[name]]) for name, values in arrays.items()}
    return {name: FileTable(scratch / name, 0, own.dtype.str, rows[name], own.shape[1]) for name, own in arrays.items()}


@dataclass(frozen=True, slots=True)
class PointRange:
    """Points start to stop - 1: coordinates `first` to `end` - 1 of each are a row of a table."""

    start: int
    stop: int
    table: FileTable | Held
    first: int = 0
    end: int = 3

    @property
    def axes(self) -> slice:
        """Which coordinates they are."""
        return slice(self.first, self.end)


@dataclass(frozen=True, slots=True)
class CellTable:
    """Cells of one shape: the table of their nodes, the number of the first point, and the order of VTK's nodes."""

    shape: str
    table: FileTable | Joined | Held
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

    def everything(self, points: int, report: Callable[[int], None] = lambda _: None) -> IntArray:
        """Return nodes (M, k) of all cells; MeshFileError if one is not among so many points."""
        held = self._held()
        nodes = np.empty((self.table.rows, self.table.width), dtype=np.intp) if held is None else held
        for start in range(0, len(nodes), ROWS):
            part = nodes[start : start + ROWS]
            if held is None:
                part[:] = self.nodes(start, start + len(part))
            if part.min() < 0 or part.max() >= points:
                raise self.missing(points)
            report(len(part))
        return nodes

    def _held(self) -> IntArray | None:
        """Return the nodes (M, k) of all cells if they are in memory as they are to be; else None."""
        if not isinstance(self.table, Held) or self.first or self.order or self.table.values.dtype != np.intp:
            return None
        return self.table.values

    def missing(self, points: int) -> MeshFileError:
        """Return the error of cells that name points that are not there; all cells are read to count them."""
        bad = 0
        for start in range(0, self.table.rows, SAMPLE):
            nodes = self.nodes(start, min(start + SAMPLE, self.table.rows))
            bad += int(np.count_nonzero(((nodes < 0) | (nodes >= points)).any(axis=1)))
        last = points - 1 + self.first
        return MeshFileError(
            f"{bad} {self.shape} elements name points that are not among the {points} ({self.first} to {last})"
        )


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
        found = np.empty((stop - start, 3))
        self.coordinates_into(found, start)
        return found

    def coordinates_into(self, found: FloatArray, start: int) -> None:
        """Fill in the coordinates (K, 3) of the points from `start` on."""
        check_unchanged(self.files, elsewhere=True)
        stop = start + len(found)
        for own in self.ranges:
            low, high = max(start, own.start), min(stop, own.stop)
            if low < high:
                with np.errstate(invalid="ignore"):  # what is no number is refused by whoever asks
                    found[low - start : high - start, own.axes] = own.table.read(low - own.start, high - own.start)

    def places(self, nodes: IntArray) -> FloatArray:
        """See `Pieces.places`."""
        check_unchanged(self.files, elsewhere=True)
        found = np.empty((len(nodes), 3))
        for own in self.ranges:
            rows = np.flatnonzero((nodes >= own.start) & (nodes < own.stop))
            if len(rows):
                with np.errstate(invalid="ignore"):  # as above
                    found[rows, own.axes] = own.table.some(nodes[rows] - own.start)
        return found

    def cells_of(self, block: int, start: int, stop: int) -> Cells | SomePolyhedra:
        """See `Pieces.cells_of`."""
        check_unchanged(self.files, elsewhere=True)
        return Cells(self.cells[block].shape, self.cells[block].nodes(start, stop))

    def oriented(self) -> Self:
        """Return it with each block in VTK's order, whichever of the two orders the file used (`shapes.oriented`).

        Plane cells stay as they are: they are turned one by one.
        """
        return replace(self, cells=tuple(self._oriented(own) for own in self.cells))

    def _oriented(self, cells: CellTable) -> CellTable:
        if not cells.table.rows or cells.shape in PLANE:
            return cells
        rows = np.arange(0, cells.table.rows, max(1, cells.table.rows // SAMPLE))
        nodes = cells.counted(cells.table.some(rows))[:, [0, *AXES[cells.shape]]]
        if nodes.min() < 0 or nodes.max() >= self.points:
            raise cells.missing(self.points)
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
        with about(source):
            changes = tuple(self.changes(nodes, points))
        rewritten(source, changes, out, progress, runner)

    def changes(self, nodes: IntArray, points: FloatArray) -> Iterator["Change"]:
        """Yield what is to stand in each table once sorted nodes (K,) are at `points` (K, 3)."""
        for own in self.ranges:
            assert isinstance(own.table, FileTable)
            first, end = np.searchsorted(nodes, (own.start, own.stop))
            yield Change(own.table, nodes[first:end] - own.start, points[first:end, own.axes])


def rewritten(
    source: Path,
    changes: Sequence["Change"],
    out: Path,
    progress: Progress = silent,
    runner: Runner = HERE,
    after: Callable[[Path], None] = lambda _: None,
) -> None:
    """Write a copy of a file with other numbers in its tables; `after` may change the copy before it is in its place.

    MeshFileError for numbers that they cannot hold.
    """
    with fresh(out, source) as beside, about(source):
        items = items_of(changes, source)
        with written(out):
            os.truncate(beside, source.stat().st_size)
        for i, _ in enumerate(runner.map(copy_range, (source, beside), items), 1):
            progress(f"writing {out.name}", i / len(items))
        after(beside)


def items_of(changes: Sequence["Change"], file: Path) -> list["Item"]:
    """Return all bytes of a file, range by range, with what is to stand there (`copy_range`)."""
    for change in changes:
        change.check()
    size = file.stat().st_size
    return [item_of(tuple(changes), start, min(start + RANGE, size)) for start in range(0, size, RANGE)]


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Values (R, width) that are to stand in sorted rows (R,) of a table."""

    table: FileTable
    rows: IntArray = field(repr=False)
    values: FloatArray = field(repr=False)

    def check(self) -> None:
        """Raise a ValueError if the table cannot hold the values."""
        kind = np.dtype(self.table.kind)
        if np.abs(self.values).max(initial=0.0) <= np.finfo(kind).max:  # false if one is no number
            return
        bad = np.count_nonzero(~(np.abs(self.values) <= np.finfo(kind).max))
        raise ValueError(f"{bad} coordinates are too large for numbers of {kind.itemsize} bytes")

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
        rows = slice(None) if len(stored) == len(self.rows) else self.rows - first
        before = stored[rows]
        stored[rows] = np.where(before == self.values, before, self.values)


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
