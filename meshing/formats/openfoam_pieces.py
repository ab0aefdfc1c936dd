"""Binary OpenFOAM cases read in pieces: the faces of some cells are searched in ranges of the lists."""

import mmap
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.states import check_unchanged
from sdm_deflect.base.threads import HERE, Progress, Runner, silent
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.mesh.cells import OWNERS, RISING, Cells, Polygons, Polyhedra, Zone, take_faces
from sdm_deflect.meshing.mesh.pieces import MeshOnDisk
from sdm_deflect.meshing.mesh.polyhedra import SomePolyhedra, join_polyhedra
from sdm_deflect.meshing.mesh.standard import POLYHEDRON

from .openfoam_case import case_folder, copy_case, mesh_folder, meshes_beside, pairs_of, patches_of, read_foam
from .openfoam_files import COMPACT, FoamFile, locate_list, parse, read_header
from .polyhedra import FEWEST, check_labels, check_sides
from .rewriting import copy_range, items_of
from .table_pieces import PointRange, TablePieces
from .tables import FileTable

# Files of lists; patches are in text, and in memory.
NAMES = ("points", "faces", "owner", "neighbour")
# Number of faces for which only the least and the largest owner and neighbour are kept.
SPAN = 1 << 13
# Faces that are read at a time.
BATCH = SPAN << 5


class Lists(NamedTuple):
    """The lists of a case: points, begin and end of each face in `nodes`, owners and neighbours."""

    points: FileTable
    offsets: FileTable
    nodes: FileTable
    owner: FileTable
    neighbour: FileTable

    def faces(self, start: int, stop: int) -> Polygons:
        """Return faces start to stop - 1."""
        offsets = self.offsets.read(start, stop + 1)[:, 0].astype(np.intp)
        return Polygons(self.nodes.read(int(offsets[0]), int(offsets[-1]))[:, 0], offsets - offsets[0])

    def cells(self, spans: IntArray) -> int:
        """Return the number of cells; MeshFileError for wrong owners and neighbours.

        Memory: a byte for each cell, and eight for each cell between the least and the largest of a batch of faces.
        `spans` holds the least and the largest cell of each (R, 2).
        """
        faces, inner = self.offsets.rows - 1, self.neighbour.rows
        if self.owner.rows != faces:
            raise MeshFileError(OWNERS.format(faces, self.owner.rows, inner))
        check_labels(int(spans.min()), int(spans.max()), faces, inner)
        sides = np.zeros(int(spans.max()) + 1, dtype=np.uint8)
        for part in chain(_batches(self.owner), _batches(self.neighbour)):
            first = int(part.min())
            counts = np.bincount(part - first)
            sides_of = sides[first : first + len(counts)]
            sides_of[:] = np.minimum(sides_of + counts, FEWEST)
        check_sides(int(np.count_nonzero(sides < FEWEST)), len(sides))
        return len(sides)


@dataclass(frozen=True, slots=True, eq=False)
class FoamPieces(TablePieces):
    """See `Pieces`: only the least and the largest cell of each `SPAN` of faces are in memory.

    Attributes
    ----------
    given : the case as it was named.
    lists : points, faces, owners and neighbours.
    count : number of cells.
    owners, neighbours : (R, 2) least and largest cell of each `SPAN` of faces.
    """

    given: Path
    lists: Lists
    count: int
    owners: IntArray = field(repr=False)
    neighbours: IntArray = field(repr=False)

    @property
    def blocks(self) -> tuple[tuple[str, int], ...]:
        return ((POLYHEDRON, self.count),)

    def cells_of(self, block: int, start: int, stop: int) -> Cells | SomePolyhedra:
        check_unchanged(self.files, elsewhere=True)
        with about(self.given):
            return join_polyhedra([self._some(low, high, start, stop) for low, high in self._ranges(start, stop)])

    def _ranges(self, start: int, stop: int) -> Iterator[tuple[int, int]]:
        """Yield ranges of at most a batch of faces that may bound cells start to stop - 1."""
        near = _meets(self.owners, start, stop)
        near[: len(self.neighbours)] |= _meets(self.neighbours, start, stop)
        spans = np.flatnonzero(near)
        for part in np.split(spans, np.flatnonzero(np.diff(spans) > 1) + 1):
            for first in range(int(part[0]), int(part[-1]) + 1, BATCH // SPAN):
                end = min(first + BATCH // SPAN, int(part[-1]) + 1)
                yield first * SPAN, min(end * SPAN, self.lists.owner.rows)

    def _some(self, low: int, high: int, start: int, stop: int) -> SomePolyhedra:
        """Return the faces from low to high - 1 that bound cells start to stop - 1."""
        inner = self.lists.neighbour.rows
        owner = self.lists.owner.read(low, high)[:, 0]
        neighbour = self.lists.neighbour.read(min(low, inner), min(high, inner))[:, 0]
        wanted = _within(owner, start, stop)
        wanted[: len(neighbour)] |= _within(neighbour, start, stop)
        rows = np.flatnonzero(wanted)
        first, end = (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, 0)
        faces = take_faces(self.lists.faces(low + first, low + end), rows - first)
        return SomePolyhedra(low + rows, Polyhedra(faces, owner[rows], neighbour[wanted[: len(neighbour)]]))

    def rewrite(
        self, nodes: IntArray, points: FloatArray, out: Path, progress: Progress = silent, runner: Runner = HERE
    ) -> None:
        """See `Pieces.rewrite`; errors as of `OpenFoam.rewrite`."""
        file = self.lists.points.path
        with copy_case(self.given, out, progress) as mesh, about(file):
            items = [item for item in items_of(tuple(self.changes(nodes, points)), file) if item[2]]
            for i, _ in enumerate(runner.map(copy_range, (file, mesh / "points"), items), 1):
                progress(f"writing {out.name}", 0.5 + 0.5 * i / len(items))


def in_pieces(path: Path) -> MeshOnDisk | None:
    """Return the mesh of a case; None if one of its lists is text or packed.

    MeshFileError if the case is damaged.
    """
    folder = mesh_folder(path)
    lists = _lists(folder)
    if lists is None or lists.neighbour.rows > lists.owner.rows:
        return None
    boundary = read_foam(folder, "boundary", lambda file: parse(file.text()))
    spans = _spans(lists.owner), _spans(lists.neighbour)
    if spans[1].min() < 0:  # faces of the boundary, in files of old
        return None
    with about(folder):
        cells = lists.cells(np.concatenate(spans))
        patches = patches_of(boundary, lists.owner.rows, lists.neighbour.rows, lists.faces)
    count = lists.points.rows
    ranges = (PointRange(0, count, lists.points),)
    pieces = FoamPieces(str(path.resolve()), count, ranges, (), path.absolute(), lists, cells, *spans)
    with about(folder):
        pairs = pairs_of(boundary, patches, pieces.places)
    notes = meshes_beside(case_folder(path))
    return MeshOnDisk(path.resolve().name, pieces, patches, (Zone("", 0, count),), notes, pairs)


def _lists(folder: Path) -> Lists | None:
    """Return the lists of a case; None if some are text, packed, or one value for all.

    MeshFileError if a file is shorter than it says.
    """
    points = _tables(folder / "points", "scalar", 3)
    faces = _tables(folder / "faces", "label", lists=2) if points else None
    if not (points and faces):
        return None
    with about(folder / "faces"):
        check_offsets(*faces)
    owner = _tables(folder / "owner", "label")
    neighbour = _tables(folder / "neighbour", "label") if owner else None
    return Lists(*points, *faces, *owner, *neighbour) if owner and neighbour else None


def _tables(path: Path, what: str, width: int = 1, lists: int = 1) -> list[FileTable] | None:
    """Return the tables of a file, of rows of labels or scalars; None as `_lists`."""
    if not path.is_file():
        return None
    tables: list[FileTable] = []
    with about(path), _memory_map(path) as file:
        if not file.binary or (lists > 1 and file.entries.get("class") != COMPACT):
            return None
        at = file.start
        for _ in range(lists):
            stored = locate_list(file, at, what, width)
            if stored.uniform or not stored.rows:
                return None
            tables.append(FileTable(path.resolve(), stored.begin, stored.kind.str, stored.rows, width))
            at = stored.begin + stored.rows * tables[-1].step + 1
    return tables


@contextmanager
def _memory_map(path: Path) -> Iterator[FoamFile]:
    with path.open("rb") as file:
        if not (size := os.fstat(file.fileno()).st_size):
            yield read_header(b"", path.name, 0)
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield read_header(cast(bytes, data), path.name, size)  # it can be searched, and cut, as bytes can


def check_offsets(offsets: FileTable, nodes: FileTable) -> None:
    """Raise ValueError if the faces do not follow one another."""
    last = offsets.rows - 1
    for start in range(0, max(last, 1), BATCH):
        part = offsets.read(start, min(start + BATCH, last) + 1)[:, 0]
        first, end = not start and part[0] != 0, start + BATCH >= last and part[-1] != nodes.rows
        if first or end or (np.diff(part) < 2).any():
            raise ValueError(RISING.format(nodes.rows))


def _spans(labels: FileTable) -> IntArray:
    """Return the least and the largest (R, 2) of each `SPAN` of labels."""
    spans = [np.empty((0, 2), dtype=np.intp)]
    for part in _batches(labels):
        starts = np.arange(0, len(part), SPAN)
        spans.append(np.column_stack([np.minimum.reduceat(part, starts), np.maximum.reduceat(part, starts)]))
    return np.concatenate(spans)


def _batches(labels: FileTable) -> Iterator[IntArray]:
    for start in range(0, labels.rows, BATCH):
        yield labels.read(start, min(start + BATCH, labels.rows))[:, 0]


def _meets(spans: IntArray, start: int, stop: int) -> BoolArray:
    """Return which spans, least and largest cell (R, 2), overlap the cells start to stop - 1."""
    return np.asarray((spans[:, 1] >= start) & (spans[:, 0] < stop))


def _within(cells: IntArray, start: int, stop: int) -> BoolArray:
    return np.asarray((cells >= start) & (cells < stop))
