"""Meshes with all numbers in tables of a file, read in pieces and rewritten by ranges."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.states import States, check_unchanged
from sdm_deflect.base.threads import HERE, Progress, Runner, silent
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.mesh.cells import CORNERS, MIRRORED, PLANE, Cells
from sdm_deflect.meshing.mesh.polyhedra import SomePolyhedra

from .rewriting import Change, rewritten
from .shapes import AXES, SAMPLE, left_handed
from .tables import Array, FileTable, Joined, MemoryTable

# Points or cells read at a time.
ROWS = 1 << 15


@dataclass(frozen=True, slots=True)
class PointRange:
    """Points start to stop - 1; each row of the table has coordinates `first` to `end` - 1 of a point."""

    start: int
    stop: int
    table: FileTable | MemoryTable
    first: int = 0
    end: int = 3

    @property
    def axes(self) -> slice:
        """Coordinates in a row, as a slice."""
        return slice(self.first, self.end)


@dataclass(frozen=True, slots=True)
class CellTable:
    """Cells of one shape: table of nodes, number of the first point, and columns in VTK's order."""

    shape: str
    table: FileTable | Joined | MemoryTable
    first: int = 1
    order: tuple[int, ...] = ()

    def nodes(self, start: int, stop: int) -> IntArray:
        """Return nodes (stop - start, k) of cells."""
        return self.from_zero(self.table.read(start, stop))

    def from_zero(self, stored: Array) -> IntArray:
        """Return stored nodes (M, k) counted from 0 in VTK's order."""
        nodes = np.take(stored, self.order, axis=1) if self.order else stored
        kind = np.intp if nodes.dtype.kind == "u" else nodes.dtype.newbyteorder("=")
        return np.asarray(nodes.astype(kind, copy=False) - self.first)

    def everything(self, points: int, report: Callable[[int], None] = lambda _: None) -> IntArray:
        """Return the nodes (M, k) of all cells; MeshFileError if one is not below the number of points."""
        loaded = self._in_memory()
        nodes = np.empty((self.table.rows, self.table.width), dtype=np.intp) if loaded is None else loaded
        for start in range(0, len(nodes), ROWS):
            part = nodes[start : start + ROWS]
            if loaded is None:
                part[:] = self.nodes(start, start + len(part))
            if part.min() < 0 or part.max() >= points:
                raise self.missing(points)
            report(len(part))
        return nodes

    def _in_memory(self) -> IntArray | None:
        """Return the nodes (M, k) of all cells if they are in memory in VTK's order; else None."""
        if not isinstance(self.table, MemoryTable) or self.first or self.order or self.table.values.dtype != np.intp:
            return None
        return self.table.values

    def missing(self, points: int) -> MeshFileError:
        """Return the error for cells with missing points; all cells are read to count them."""
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
        return tuple((block.shape, block.table.rows) for block in self.cells)

    def coordinates(self, start: int, stop: int) -> FloatArray:
        points = np.empty((stop - start, 3))
        self.coordinates_into(points, start)
        return points

    def coordinates_into(self, out: FloatArray, start: int) -> None:
        """Fill in the coordinates (K, 3) of points, the first of which is `start`."""
        check_unchanged(self.files, elsewhere=True)
        stop = start + len(out)
        for part in self.ranges:
            low, high = max(start, part.start), min(stop, part.stop)
            if low < high:
                with np.errstate(invalid="ignore"):  # what is no number is refused by whoever asks
                    out[low - start : high - start, part.axes] = part.table.read(low - part.start, high - part.start)

    def places(self, nodes: IntArray) -> FloatArray:
        check_unchanged(self.files, elsewhere=True)
        out = np.empty((len(nodes), 3))
        for part in self.ranges:
            rows = np.flatnonzero((nodes >= part.start) & (nodes < part.stop))
            if len(rows):
                with np.errstate(invalid="ignore"):  # as above
                    out[rows, part.axes] = part.table.some(nodes[rows] - part.start)
        return out

    def cells_of(self, block: int, start: int, stop: int) -> Cells | SomePolyhedra:
        check_unchanged(self.files, elsewhere=True)
        return Cells(self.cells[block].shape, self.cells[block].nodes(start, stop))

    def orient(self) -> Self:
        """Return the pieces with each block in VTK's order (`shapes.orient`).

        Plane cells stay as they are: they would be reversed one by one.
        """
        return replace(self, cells=tuple(self._orient(block) for block in self.cells))

    def _orient(self, cells: CellTable) -> CellTable:
        if not cells.table.rows or cells.shape in PLANE:
            return cells
        rows = np.arange(0, cells.table.rows, max(1, cells.table.rows // SAMPLE))
        nodes = cells.from_zero(cells.table.some(rows))[:, [0, *AXES[cells.shape]]]
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

    def changes(self, nodes: IntArray, points: FloatArray) -> Iterator[Change]:
        """Yield the changes of each table for sorted nodes (K,) at `points` (K, 3)."""
        for part in self.ranges:
            assert isinstance(part.table, FileTable)
            first, end = np.searchsorted(nodes, (part.start, part.stop))
            yield Change(part.table, nodes[first:end] - part.start, points[first:end, part.axes])
