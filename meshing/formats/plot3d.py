"""PLOT3D grids (NASA TM 101067) of hexahedra or quadrilaterals, in text and binary, and their maps (.nmf).

A grid has the number of blocks if there are several, then their sizes, then all x, y, z and perhaps IBLANK of each.
A map lists the faces that are boundaries, and those that meet (The Neutral Map File, W. T. Jones, NASA Langley).
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import accumulate, product, takewhile
from math import prod
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.files import fresh
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.errors import about, check_points
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.precision import fewest_bits

from .cgns_blocks import AXES, BlockFace, Size, cells, equal_neighbours, faces, points_in
from .cgns_interfaces import NEAR, meeting
from .conforming_zones import Fitted, ZoneMesh, fit_zones
from .format import Format
from .numbers import Placed, chunks, copy_text, numbers
from .rewriting import Change, rewritten
from .shapes import orient
from .tables import FileTable
from .ugrid_file import EXACT

# Bytes of a Fortran record's length or of a whole number, and of the head that tells text from binary.
MARKER, HEAD = 4, 4096
LIKE_FORTRAN = bytes.maketrans(b"Dd,", b"Ee ")
# Axis normal to a face of a map, and whether the face is at its end; the other axes follow cyclically.
FACES = {1: (2, False), 2: (2, True), 3: (0, False), 4: (0, True), 5: (1, False), 6: (1, True)}
ONE_TO_ONE, PATCHED, UNPROCESSED = "one_to_one", "patched", "unprocessed"
# Entries of faces on no patch: they touch others, or have no area.
WITHOUT = (PATCHED, "collapsed", "pole_dir1", "pole_dir2")
COMMENT, NUMBER = re.compile(r"[#!](.*)"), re.compile(r"\d{1,9}")
ENTRY = re.compile(r"""\s*('[^']*'|"[^"]*"|[^\s\d]\S*)((?:\s+[+-]?\d{1,9}){6,12})\s*(\w*)\s*$""")


class Plot3d(Format):
    """Blocks of hexahedra, or of quadrilaterals in a plane, of either hand; blocks that meet are one zone.

    Two faces with all corners at the same places are joined, unless the map calls them boundaries; so are near faces
    that it pairs as ``ONE_TO_ONE``. ``PATCHED`` faces are on no patch. The map names patches; others are
    ``block1/imin`` and so on. A rewritten file keeps IBLANK.
    """

    name = "plot3d"
    suffixes = (".p3d", ".p3dfmt", ".p2d", ".p2dfmt", ".xyz", ".x", ".g", ".ufmt")
    written = False

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        return self._read(path, path, progress)

    def read_copy(self, path: Path, source: Path) -> Mesh:
        """See `Format.read_copy`; the map beside the source counts."""
        return self._read(path, source)

    def _read(self, path: Path, mapped: Path, progress: Progress = silent) -> Mesh:
        with about(path), path.open("rb") as file:
            stored = Plot3dFile.open(file, partial(progress, f"reading {path.name}"))
            return join_blocks(stored.points(), stored.sizes, map_of(mapped, stored.sizes)).mesh

    def files(self, path: Path) -> Iterable[Path]:
        return path, *maps(path)

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        with about(source or out), (source or out).open("rb") as file:
            real = Plot3dFile.open(file, lambda _: None).layout.real if b"\0" in file.read(HEAD) else None
            return fewest_bits([real] if real else [])

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; joined points of several blocks get the same coordinates."""
        report = partial(progress, f"writing {out.name}")
        with about(source), source.open("rb") as file:
            stored = Plot3dFile.open(file, report)
            old = stored.points()
            joined = join_blocks(old, stored.sizes, map_of(source, stored.sizes))
            check_points(points, len(joined.first))
            new, changed = points[joined.index], (points != old[joined.first])[joined.index]
            changes, moved, real = [], stored.values, stored.layout.real
            for at, axis, points_of in stored.layout.columns():
                rows = np.flatnonzero(changed[points_of, axis])
                if moved is not None:
                    moved[at + rows] = new[points_of][rows, axis]
                elif real:
                    table = FileTable(source, at, real.str, points_of.stop - points_of.start)
                    changes.append(Change(table, rows, new[points_of][rows, axis, None]))
            if moved is not None:
                with fresh(out, source) as beside, beside.open("wb") as copy:
                    copy_text(file, _words(file, report), moved, copy)
                return
        rewritten(source, changes, out, progress)


class Layout(NamedTuple):
    """Layout of a file: sizes of blocks, whether it has their number, IBLANK and records, and type (None: text)."""

    sizes: tuple[Size, ...]
    counted: bool
    blanked: bool
    real: np.dtype[Any] | None = None
    records: bool = False

    @property
    def lengths(self) -> list[int]:
        """Length of each record in bytes; in text the count of its numbers."""
        whole, real = (MARKER, self.real.itemsize) if self.real else (1, 1)
        head = [whole] * self.counted + [whole * len(self.sizes[0]) * len(self.sizes)]
        return head + [prod(size) * (len(size) * real + whole * self.blanked) for size in self.sizes]

    @property
    def begins(self) -> list[int]:
        """Begin of the coordinates of each block, and end of the file: in bytes, or in numbers for text."""
        around = 2 * MARKER * self.records
        ends = list(accumulate((length + around for length in self.lengths), initial=0))
        return [*(begin + around // 2 for begin in ends[1 + self.counted : -1]), ends[-1]]

    def columns(self) -> Iterator[tuple[int, int, slice]]:
        """Yield for each block and axis the begin of its coordinates, the axis, and the slice of the block's points."""
        start, size = 0, self.real.itemsize if self.real else 1
        for begin, extent in zip(self.begins, self.sizes, strict=False):
            count = prod(extent)
            for axis in range(len(extent)):
                yield begin + axis * count * size, axis, slice(start, start + count)
            start += count


@dataclass(frozen=True, slots=True, eq=False)
class Plot3dFile:
    """An open file and its layout; `values` are all numbers of a text."""

    file: BinaryIO = field(repr=False)
    layout: Layout
    report: Callable[[float], None] = field(repr=False)
    values: FloatArray | None = field(default=None, repr=False)

    @classmethod
    def open(cls, file: BinaryIO, report: Callable[[float], None]) -> "Plot3dFile":
        """Find the one layout that fits the counts and the length of a file; MeshFileError if none or several do."""
        file.seek(0)
        values = None
        if b"\0" not in file.read(HEAD):
            values = np.concatenate([np.empty(0), *(placed.values for _, _, placed in _words(file, report))])
        fit = list(_layouts(file, values))
        if not fit:
            raise MeshFileError("its length fits no sizes of blocks that its first numbers tell; it is damaged")
        if len(fit) > 1:
            raise MeshFileError("it could be stored in several ways; write it with another number of points")
        opened = cls(file, fit[0], report, values)
        for number, size in enumerate(opened.sizes, 1):
            if min(size) < 2:
                raise MeshFileError(f"block {number} of {' x '.join(map(str, size))} points has no cells")
        return opened

    @property
    def sizes(self) -> tuple[Size, ...]:
        """Number of points of each block along each axis; two axes if the grid has one layer of points."""
        flat = all(size[2:] == (1,) for size in self.layout.sizes)
        return tuple(size[:2] for size in self.layout.sizes) if flat else self.layout.sizes

    def points(self) -> FloatArray:
        """Return the coordinates (F, 3) of all points, block after block; z is 0 where the file has none."""
        coordinates, real = np.zeros((sum(map(prod, self.layout.sizes)), 3)), self.layout.real
        for at, axis, rows in self.layout.columns():
            count = rows.stop - rows.start
            if self.values is not None:
                coordinates[rows, axis] = self.values[at : at + count]
            elif real:
                self.file.seek(at)
                with np.errstate(invalid="ignore"):  # `Mesh` refuses coordinates that are not finite
                    coordinates[rows, axis] = np.frombuffer(self.file.read(count * real.itemsize), real)
            self.report(rows.stop / len(coordinates))
        return coordinates


def _words(file: BinaryIO, report: Callable[[float], None]) -> Iterator[tuple[int, bytes, Placed]]:
    size = file.seek(0, 2)
    for at, text in chunks(file, 0, size):
        if b"*" in text:
            raise MeshFileError("numbers are repeated by counts such as 3*0.5; write the grid with a format of its own")
        lines = numbers(text.translate(LIKE_FORTRAN), np.float64)
        yield at, text, Placed(lines.values.astype(np.float64), lines.begin, lines.end)
        report((at + len(text)) / size)


def _layouts(file: BinaryIO, values: FloatArray | None) -> Iterator[Layout]:
    """Yield the layouts that fit the counts and the length of a file; `values` are all numbers of a text."""
    if values is not None:
        yield from _fitting(partial(_whole_of_text, values), len(values), [None], False)
        return
    for order, records in product("<>", (False, True)):
        kinds = [np.dtype(f"{order}{real}") for real in ("f4", "f8")]
        yield from _fitting(partial(_whole, file, order), file.seek(0, 2), kinds, records)


def _fitting(
    whole: Callable[[int, int], IntArray], size: int, kinds: Sequence[np.dtype[Any] | None], records: bool
) -> Iterator[Layout]:
    for counted, axes in product((True, False), (3, 2)):
        sizes = _sizes(whole, MARKER if kinds[0] else 1, MARKER * records, (counted, axes), size)
        for real, blanked in product(kinds, (False, True)) if sizes else ():
            layout = Layout(sizes, counted, blanked, real, records)
            if layout.begins[-1] == size and (not records or _has_markers(whole, layout)):
                yield layout


def _sizes(
    whole: Callable[[int, int], IntArray], step: int, mark: int, how: tuple[bool, int], size: int
) -> tuple[Size, ...]:
    """Return the sizes of the blocks for one way of storing them; nothing if the numbers cannot be sizes."""
    (counted, axes), at, blocks = how, mark, 1
    if counted:
        blocks, at = int(whole(at, 1).max(initial=-1)), at + step + 2 * mark
    if not 1 <= blocks <= size // (axes * step):
        return ()
    numbers = whole(at, axes * blocks)
    if len(numbers) < axes * blocks or numbers.min() < 1:
        return ()
    rows = numbers.reshape(blocks, axes)
    fits = rows.astype(np.float64).prod(axis=1).sum() <= size and (axes > 2 or rows.min() > 1)  # curves are no grids
    return tuple(map(tuple, rows.tolist())) if fits else ()


def _whole(file: BinaryIO, order: str, at: int, count: int) -> IntArray:
    """Return whole numbers that begin at a byte; fewer at the end of the file."""
    file.seek(at)
    data = file.read(count * MARKER)
    return np.frombuffer(data[: len(data) // MARKER * MARKER], f"{order}i4").astype(np.intp)


def _whole_of_text(values: FloatArray, at: int, count: int) -> IntArray:
    """Return the numbers of a text as whole numbers; -1 for others."""
    some = values[at : at + count]
    return np.where((np.abs(some) < EXACT) & (some == np.rint(some)), some, -1.0).astype(np.intp)


def _has_markers(whole: Callable[[int, int], IntArray], layout: Layout) -> bool:
    """Whether each record has its length before and after it."""
    begins = accumulate((length + 2 * MARKER for length in layout.lengths), initial=0)
    pairs = zip(begins, layout.lengths, strict=False)
    return all([*whole(at, 1), *whole(at + MARKER + n, 1)] == [n, n] for at, n in pairs)


class IndexRange(NamedTuple):
    """A face of a block: points `first` to `last`, counted from 0 on three axes, one of which is constant."""

    block: int
    first: tuple[int, ...]
    last: tuple[int, ...]
    axis: int

    def plane(self, size: Size) -> BlockFace:
        """Return the faces of the range, given the block's size."""
        others = [axis for axis in range(len(size)) if axis != self.axis]
        low = [min(self.first[axis], self.last[axis]) for axis in others]
        high = [max(self.first[axis], self.last[axis]) - 1 for axis in others]
        rows = points_in(low, high, tuple(size[axis] - 1 for axis in others))
        return BlockFace(self.axis, self.first[self.axis], rows)


class MapEntry(NamedTuple):
    """A line of a map: its type, such as ``one_to_one``, the name of a patch, and one face or two that meet."""

    kind: str
    name: str
    ranges: tuple[IndexRange, ...]


def map_of(path: Path, sizes: Sequence[Size]) -> tuple[MapEntry, ...]:
    """Read the map beside a grid, such as ``wing.nmf`` for ``wing-deflected.p3d``; errors as of `entries`."""
    for beside in maps(path):
        with about(beside):
            return tuple(entries(beside.read_text("utf-8", "replace"), sizes))
    return ()


def maps(path: Path) -> Iterator[Path]:
    """Yield the files beside a grid that may be its map, the longest name first."""
    parts = re.split(r"(?=[^0-9A-Za-z])", path.name)
    stems = ("".join(parts[:i]) for i in range(len(parts), 0, -1))
    yield from (file for file in (path.with_name(f"{stem}.nmf") for stem in stems if stem) if file.is_file())


def entries(text: str, sizes: Sequence[Size]) -> Iterator[MapEntry]:
    """Yield the entries of a map; MeshFileError for wrong lines and for blocks of other sizes."""
    lines = [
        (i, words, line) for i, line in enumerate(text.splitlines(), 1) if (words := COMMENT.sub("", line).strip())
    ]
    head = list(takewhile(lambda line: all(map(NUMBER.fullmatch, line[1].split())), lines[: 1 + len(sizes)]))
    _check_head(" ".join(line[1] for line in head).split(), sizes)
    for number, words, line in lines[len(head) :]:
        try:
            yield _entry(words, "".join(COMMENT.findall(line)[:1]).strip(), sizes)
        except MeshFileError as error:
            raise MeshFileError(f"line {number}: {error}") from error


def _check_head(given: Sequence[str], sizes: Sequence[Size]) -> None:
    wanted = [len(sizes), *(n for i, size in enumerate(sizes, 1) for n in (i, *size, *[1] * (3 - len(size))))]
    if list(map(int, given)) != wanted:
        first, said = (" ".join(map(str, all[:9])) + " ..." * (len(all) > 9) for all in (wanted, given))
        raise MeshFileError(
            f"should begin with {first}, the number and the sizes of the grid's blocks, but has {said or 'none'}; it "
            "is of another grid, or damaged"
        )


def _entry(line: str, comment: str, sizes: Sequence[Size]) -> MapEntry:
    match = ENTRY.match(line)
    values = [int(word) for word in match[2].split()] if match else []
    if not match or len(values) not in (6, 12):
        raise MeshFileError(f"{line[:60]!r} is no type with the block, the face and the range of one face or of two")
    name = match[1].strip("'\" ")
    kind = re.sub(r"[-_ ]+", "_", name.lower())
    ranges = tuple(_range(values[i : i + 6], sizes) for i in range(0, len(values), 6))
    if (kind in (ONE_TO_ONE, PATCHED)) != (len(ranges) == 2):
        raise MeshFileError(f"{name} has {len(ranges)} faces; interfaces have two, boundaries one")
    return MapEntry(kind, comment or name or kind, ranges)


def _range(values: Sequence[int], sizes: Sequence[Size]) -> IndexRange:
    block, face, *ends = values
    if not 1 <= block <= len(sizes) or face not in FACES:
        raise MeshFileError(f"there is no face {face} of block {block}; there are 6 of {len(sizes)} blocks")
    size, (axis, far) = (*sizes[block - 1], 1)[:3], FACES[face]
    first, last = [0, 0, 0], [0, 0, 0]
    first[axis] = last[axis] = size[axis] - 1 if far else 0
    for other, begin, end in (((axis + 1) % 3, *ends[:2]), ((axis + 2) % 3, *ends[2:])):
        if min(begin, end) < 1 or max(begin, end) > size[other] or abs(end - begin) + 1 < min(2, size[other]):
            raise MeshFileError(f"face {face} of block {block} has points 1 to {size[other]}, but not {begin} to {end}")
        first[other], last[other] = begin - 1, end - 1
    return IndexRange(block - 1, tuple(first), tuple(last), axis)


def join_blocks(points: FloatArray, sizes: Sequence[Size], said: Sequence[MapEntry]) -> Fitted:
    """Return the mesh of blocks whose points (F, 3) follow one another; ValueError if some are not finite."""
    starts = np.cumsum([0, *map(prod, sizes)])
    parts, free, same = [], [], []
    for i, size in enumerate(sizes):
        block_points = points[starts[i] : starts[i + 1]]
        part, rest = _block(i, size, block_points, said)
        parts.append(part)
        free += [faces.nodes + starts[i] for faces in rest]
        same.append(equal_neighbours(block_points, size) + starts[i])
    same.append(meeting(points, np.concatenate(free)) if free else np.empty((0, 2), np.intp))
    touching = np.unique(np.searchsorted(starts, same[-1], side="right") - 1, axis=0).tolist()
    for entry in said:
        if entry.kind in (ONE_TO_ONE, PATCHED) and entry.ranges[0].axis < len(sizes[0]):
            rows = _meeting_points(points, entry.ranges, sizes, starts) if entry.kind == ONE_TO_ONE else same[-1][:0]
            if rows is not None:
                same.append(rows)
                touching.append([end.block for end in entry.ranges])
    return fit_zones(parts, touching, list(filter(len, same)))


def _block(number: int, size: Size, points: FloatArray, said: Sequence[MapEntry]) -> tuple[ZoneMesh, list[Cells]]:
    """Return a block by itself, and the faces that it may share with another block."""
    block, title = cells(size), f"block{number + 1}"
    turned = orient(points, block)
    left_handed = bool(2 * np.count_nonzero(turned.nodes[:, 1] != block.nodes[:, 1]) > len(block))
    sides = [(axis, at) for axis in range(len(size)) for at in (0, size[axis] - 1)]
    free = {(axis, at): np.ones(prod(np.delete(size, axis) - 1), dtype=np.bool_) for axis, at in sides}
    named: dict[str, list[Cells]] = {}
    for entry, plane in _boundaries(number, size, said):
        mask = free[plane.axis, plane.at]
        rows = plane.rows[mask[plane.rows]]
        mask[rows] = False
        if entry.kind not in WITHOUT and len(rows):
            named.setdefault(entry.name, []).append(faces(size, BlockFace(plane.axis, plane.at, rows), left_handed))
    patches = [Patch(name, tuple(blocks)) for name, blocks in named.items()]
    rest = []
    for (axis, at), mask in free.items():
        if mask.any():
            rest.append(faces(size, BlockFace(axis, at, np.flatnonzero(mask)), left_handed))
            patches.append(Patch(f"{title}/{AXES[axis]}{'max' if at else 'min'}", (rest[-1],)))
    return ZoneMesh(title, Mesh(points, (turned,), tuple(patches)), frozenset(named), block=True), rest


def _boundaries(number: int, size: Size, said: Sequence[MapEntry]) -> Iterator[tuple[MapEntry, BlockFace]]:
    """Yield the entries of a map on a block, each with its faces; interfaces are left out."""
    for entry in said:
        for end in () if entry.kind in (ONE_TO_ONE, UNPROCESSED) else entry.ranges:
            if end.block == number and end.axis < len(size):
                yield entry, end.plane(size)


def _meeting_points(
    points: FloatArray, ends: Sequence[IndexRange], sizes: Sequence[Size], starts: IntArray
) -> IntArray | None:
    """Return pairs (K, 2) of equal points of two faces; None if the faces lie apart, as on a periodic interface."""
    n = len(sizes[0])
    here, there = (points_in(e.first[:n], e.last[:n], sizes[e.block]) + starts[e.block] for e in ends)
    gap, nearest = cKDTree(points[there]).query(points[here])
    distance = np.linalg.norm(points[here], axis=1)
    if len(here) != len(there) or np.any(gap > NEAR * np.maximum(distance, np.median(distance))):
        return None
    return np.stack([here, there[nearest]], axis=1)
