"""SU2 meshes (.su2) in two and three dimensions: found by keywords such as ``NPOIN=``, read, rewritten, written."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError, short_list
from sdm_deflect.base.files import fresh
from sdm_deflect.base.threads import HERE, Progress, Runner, silent
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.mesh.cells import CORNERS, Cells, Patch, Polyhedra, Zone
from sdm_deflect.meshing.mesh.mesh import Mesh, Warned
from sdm_deflect.meshing.mesh.pieces import MeshOnDisk
from sdm_deflect.meshing.mesh.precision import DOUBLE

from .coordinates import Words
from .format import Format, fitting_names, whole
from .numbers import CHUNK, COMMENT, NumberLines, Placed, chunks, numbers, table
from .shapes import simple_faces
from .table_pieces import CellTable, PointRange, TablePieces
from .tables import FileTable, MemoryTable, gather_tables

# Smallest section, in bytes, for which loading compiled code pays.
LARGE = 1 << 24
SOLIDS = {10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid"}
FACES = {5: "triangle", 9: "quad"}
# Cells and boundary faces, by dimension.
KINDS = {3: (SOLIDS, FACES), 2: (FACES, {3: "line"})}
# Marker of points of other processes; it is no boundary.
PARALLEL = "SEND_RECEIVE"
BOXES = (
    "the free-form boxes of the file ({}) are those of the undeflected mesh, and SU2_DEF would put the surface back: "
    "make them again by SU2_DEF with DV_KIND= FFD_SETTING"
)
HALO = (
    "the file has points beyond its periodic markers (SEND_RECEIVE), whose images are not read; take the mesh from "
    "before SU2_MSH, and name the markers by --periodic"
)
NUMBERS = {shape: number for number, shape in (SOLIDS | FACES | {3: "line"}).items()}
# Characters that a marker's name must not contain: SU2 drops blanks, and separates markers by the others.
UNFIT = r"[\s(),%=]"
Blocks = list[tuple[str, IntArray]]
Read = Callable[[bytes, type[np.float64 | np.int64]], NumberLines]
Rows = TypeVar("Rows", Placed, Blocks)


@dataclass(frozen=True, slots=True)
class KeywordBlock:
    """A line ``KEYWORD= value``, and the lines after it up to the next one: bytes begin to end - 1."""

    keyword: str
    value: str
    begin: int
    end: int

    @property
    def count(self) -> int:
        """First number of the value, as in ``NPOIN= 14 14``; MeshFileError without one."""
        first = self.value.split()[:1]
        if not first or not first[0].isdecimal():
            raise MeshFileError(f"{self.keyword}= {self.value} is not a count")
        return int(first[0])


def sections(file: BinaryIO) -> list[KeywordBlock]:
    """Find all keyword lines of a file, in its order."""
    blocks: list[tuple[str, str, int, int]] = []
    size = file.seek(0, 2)
    for start, text in chunks(file, 0, size):
        blocks += [(keyword, value, start + line, start + after) for keyword, value, line, after in _keywords(text)]
    ends = [*(line for _, _, line, _ in blocks[1:]), size]
    return [
        KeywordBlock(keyword, value, begin, end) for (keyword, value, _, begin), end in zip(blocks, ends, strict=False)
    ]


def _keywords(text: bytes) -> Iterator[tuple[str, str, int, int]]:
    at = text.find(b"=")
    while at >= 0:
        begin = text.rfind(b"\n", 0, at) + 1
        end = text.find(b"\n", at) + 1 or len(text)
        keyword, equals, value = COMMENT.sub(b"", text[begin:end]).decode("utf-8", "replace").partition("=")
        if equals:
            yield keyword.strip().upper(), value.strip(), begin, end
        at = text.find(b"=", end)


@dataclass(frozen=True, slots=True)
class Su2File:
    """An open file with its sections and its dimension; `report` is called with the fraction read so far."""

    file: BinaryIO
    sections: tuple[KeywordBlock, ...]
    dimension: int
    report: Callable[[float], None]

    @classmethod
    def open(cls, file: BinaryIO, report: Callable[[float], None]) -> Su2File:
        """Find the sections of a file; MeshFileError if it is no SU2 mesh, or of another dimension than 2 or 3."""
        file.seek(0)
        if b"\0" in file.read(4096):
            raise MeshFileError("this is a binary file; an SU2 mesh is text")
        blocks = tuple(sections(file))
        dimensions = [section.count for section in blocks if section.keyword == "NDIME"]
        if not dimensions:
            raise MeshFileError("no NDIME= line; this is not an SU2 mesh, or it is truncated")
        if dimensions[0] not in KINDS or len(set(dimensions)) > 1:
            raise MeshFileError(f"NDIME= {', '.join(map(str, dimensions))}; it must be 2 or 3, the same for all zones")
        return cls(file, blocks, dimensions[0], report)

    def coordinates(self, sections: Sequence[KeywordBlock]) -> Iterator[tuple[int, bytes, Placed]]:
        """Yield the begin of each piece of the text of sections, the piece, and the coordinates (R, d) on its lines.

        MeshFileError if a line has another number of coordinates, or a section another number of points.
        """
        for section in sections:
            yield from self._tables(section, np.float64, partial(_coordinates, dimension=self.dimension))

    def elements(self, section: KeywordBlock, shapes: Mapping[int, str], points: int) -> Iterator[tuple[str, IntArray]]:
        """Yield shapes and nodes (R, k) of elements, some at a time; the order within a shape is the file's.

        MeshFileError if a type is not among the `shapes`, if a node is not below `points`, or, at the end, if the
        section has more or fewer elements than it says.
        """
        for _, _, blocks in self._tables(section, np.int64, partial(_blocks, shapes=shapes, points=points)):
            yield from blocks

    def _tables(
        self, section: KeywordBlock, kind: type[np.float64 | np.int64], rows_of: Callable[[NumberLines], Rows]
    ) -> Iterator[tuple[int, bytes, Rows]]:
        """Yield the begin of each piece of the text of a section, the piece, and the numbers on its lines."""
        texts = (text for _, text in chunks(self.file, section.begin, section.end))

        def work(text: bytes, read: Read = numbers) -> tuple[bytes, int, Rows]:
            lines = read(text, kind)
            return text, len(lines), rows_of(lines)

        parsed: Iterator[tuple[bytes, int, Rows]] = map(work, texts)
        if section.end - section.begin > LARGE:
            from .numbers import ahead, many_numbers  # loads the compiler

            parsed = ahead(partial(work, read=many_numbers), texts)
        total, at = 0, section.begin
        for text, count, rows in parsed:
            total += count
            yield at, text, rows
            at += len(text)
            self.report(at / self.sections[-1].end)
        if total != section.count:
            cause = "truncated or damaged" if total < section.count else "damaged"
            raise MeshFileError(
                f"{section.keyword}= {section.count}, but {total} lines of numbers follow; the file is {cause}"
            )


def _coordinates(lines: NumberLines, dimension: int) -> Placed:
    """Return coordinates (R, d) from lines; the rest of a line is ignored, as in SU2."""
    if (np.diff(lines.first) < dimension).any():
        raise MeshFileError(
            f"lines of points have fewer than {dimension} coordinates; the file is truncated or damaged"
        )
    return Placed(*(lines.columns(each, 0, dimension) for each in (lines.values, lines.begin, lines.end)))


def _blocks(lines: NumberLines, shapes: Mapping[int, str], points: int) -> Blocks:
    """Return one block of each shape, in the order in which shapes first appear."""
    kinds = np.asarray(lines.values[lines.first[:-1]], dtype=np.int64)
    blocks = []
    for kind in dict.fromkeys([*kinds[:1].tolist(), *kinds[1:][np.diff(kinds) != 0].tolist()]):
        rows = np.flatnonzero(kinds == kind)
        if kind not in shapes:
            wanted = ", ".join(f"{number} ({shape})" for number, shape in shapes.items())
            raise MeshFileError(f"{len(rows)} elements of type {kind} where there can be {wanted}")
        blocks.append((shapes[kind], _nodes(lines, rows, shapes[kind], points)))
    return blocks


def notes_of(blocks: Sequence[KeywordBlock]) -> tuple[str, ...]:
    """Return notes on points behind periodic markers, which SU2 before version 7 added, and on free-form boxes."""
    moved = [
        block for block in blocks if block.keyword == "NPERIODIC" and block.value.split()[:1] not in ([], ["0"], ["1"])
    ]
    boxes = [block.value for block in blocks if block.keyword == "FFD_TAG"]
    return (*([HALO] if moved else []), *(Warned(BOXES.format(short_list(boxes))) for _ in boxes[:1]))


def zones_of(blocks: Sequence[KeywordBlock]) -> dict[str, list[KeywordBlock]]:
    """Return sections by zone; in a file without zones, all sections of a zone without a name."""
    zones: dict[str, list[KeywordBlock]] = {}
    name = ""
    for section in blocks:
        if section.keyword == "IZONE":
            name = f"zone {section.count}"
            if name in zones:
                raise MeshFileError(f"IZONE= {section.count} is there twice")
        zones.setdefault(name, []).append(section)
    if len(zones) > 1:
        zones.pop("", None)
    announced = [section.count for section in blocks if section.keyword == "NZONE"]
    if announced and announced[0] != len(zones):
        counts = f"NZONE= {announced[0]}, but there are {len(zones)} zones"
        raise MeshFileError(f"{counts}; the file is truncated or damaged")
    return zones


def zone_of(source: Su2File, zone: Sequence[KeywordBlock], scratch: Path | None) -> TablePieces:
    """Return the points and cells of a zone as tables in an empty folder, or in memory if that is None."""
    points = points_of(source, [only(zone, "NPOIN")])
    place = gather_tables([("points", points)], lambda _: len(points), scratch)["points"]
    kind = np.int32 if scratch and len(points) <= np.iinfo(np.int32).max else np.intp
    tables = elements_of(source, only(zone, "NELEM"), KINDS[source.dimension][0], len(points), scratch, kind)
    cells = tuple(CellTable(shape, table, 0) for shape, table in tables.items())
    return TablePieces("", len(points), (PointRange(0, len(points), place),), cells).orient()


def only(zone: Sequence[KeywordBlock], keyword: str) -> KeywordBlock:
    """Return the section with a keyword; MeshFileError if there is none or several."""
    matching = [section for section in zone if section.keyword == keyword]
    if len(matching) != 1:
        raise MeshFileError(
            f"{len(matching)} lines {keyword}= where there must be one; the file is truncated or damaged"
        )
    return matching[0]


def points_of(source: Su2File, sections: Sequence[KeywordBlock]) -> FloatArray:
    """Return the points (N, 3) of sections."""
    possible = sum(min(section.count, (section.end - section.begin) // len("0 0") + 1) for section in sections)
    points = np.zeros((possible, 3))  # a damaged count may be any number
    start = 0
    for _, _, placed in source.coordinates(sections):
        coordinates = placed.values[: len(points) - start]
        points[start : start + len(coordinates), : source.dimension] = coordinates
        start += len(coordinates)
    return points


def patches_of(source: Su2File, zone: Sequence[KeywordBlock], points: int) -> tuple[Patch, ...]:
    """Return the markers among a zone's sections."""
    patches = []
    tags = [i for i, section in enumerate(zone) if section.keyword == "MARKER_TAG"]
    announced = only(zone, "NMARK").count
    if announced != len(tags):
        raise MeshFileError(f"NMARK= {announced}, but there are {len(tags)} markers; the file is truncated or damaged")
    for i in tags:
        name = zone[i].value
        if name == PARALLEL:
            continue
        if zone[i + 1 : i + 2] == [] or zone[i + 1].keyword != "MARKER_ELEMS":
            raise MeshFileError(f"marker {name} has no MARKER_ELEMS= line; the file is truncated or damaged")
        try:
            faces = elements_of(source, zone[i + 1], KINDS[source.dimension][1], points)
            patches.append(Patch(name, tuple(Cells(shape, table.integers()) for shape, table in faces.items())))
        except MeshFileError as error:
            raise MeshFileError(f"marker {name}: {error}") from error
    return tuple(patches)


def elements_of(
    source: Su2File,
    section: KeywordBlock,
    shapes: Mapping[int, str],
    points: int,
    scratch: Path | None = None,
    kind: type[np.signedinteger[Any]] = np.intp,
) -> dict[str, FileTable | MemoryTable]:
    """Return a table of each shape, in order of first appearance; cells of a shape keep the file's order."""

    def most(shape: str) -> int:
        return min(section.count, (section.end - section.begin) // (2 * CORNERS[shape] + 2) + 1)

    parts = ((shape, nodes.astype(kind, copy=False)) for shape, nodes in source.elements(section, shapes, points))
    return gather_tables(parts, most, scratch)


def _nodes(lines: NumberLines, rows: IntArray, shape: str, points: int) -> IntArray:
    """Return nodes (R, k) from lines of one shape: type, k nodes, and a rest that SU2 ignores."""
    corners = CORNERS[shape]
    if (np.diff(lines.first)[rows] <= corners).any():
        raise MeshFileError(f"lines of {shape} elements have fewer than {corners} nodes")
    nodes: IntArray = lines.columns(lines.values, 1, corners + 1, rows).astype(np.intp, copy=False)
    if nodes.min() < 0 or nodes.max() >= points:
        missing = np.count_nonzero(((nodes < 0) | (nodes >= points)).any(axis=1))
        known = f"the {points} (0 to {points - 1})"
        raise MeshFileError(f"{missing} {shape} elements name points that are not among {known}")
    return nodes


class Su2(Format):
    """Text with one line for each point, cell and boundary face; markers by name, several zones in one file.

    Points of other processes (markers SEND_RECEIVE), free-form boxes, periodic data and comments are no part of the
    mesh; a rewritten file keeps them. Cells are one block of each shape, in the file's order within the shape.
    """

    name = "su2"
    suffixes = (".su2",)

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshOnDisk | None:
        """See `Format.layout`; None for a plane mesh, and for several zones."""
        with about(path), path.open("rb") as file:
            source = Su2File.open(file, partial(progress, f"reading {path.name}"))
            zones = zones_of(source.sections)
            if source.dimension != 3 or len(zones) > 1:
                return None
            return _layout(path.resolve(), source, *zones.popitem(), scratch)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        with about(path), path.open("rb") as file:
            source = Su2File.open(file, partial(progress, f"reading {path.name}"))
            zones = zones_of(source.sections)
            parts = [whole(_layout(path, source, name, zone), lambda _: None) for name, zone in zones.items()]
            if len(parts) == 1:
                return parts[0]
            from .zones import join_zones

            return replace(join_zones(list(zones), parts), notes=notes_of(source.sections))

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        return DOUBLE

    def coordinates(self, path: Path) -> Words:
        with path.open("rb") as file:
            text = Su2File.open(file, lambda _: None)
            return Words(path, sum(section.count for section in _points(text)), _words, text.dimension)

    def points_of_copy(self, path: Path, source: Path) -> FloatArray:
        """See `Format.points_of_copy`; the cells are the source's and are not parsed again."""
        with about(path), path.open("rb") as new, source.open("rb") as old:
            texts = [Su2File.open(file, lambda _: None) for file in (new, old)]
            for here, there in zip(*map(_around, texts), strict=True):
                if not _same(new, old, here, there):
                    raise MeshFileError("its text differs from the source, not in its points alone")
            return points_of(texts[0], _points(texts[0]))

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; MeshFileError for polyhedra of other shapes, and for faces of five corners."""
        from .polyhedra import standard_cells
        from .zones import unwritten

        with fresh(out) as beside, about(out), beside.open("wb") as file:
            usual = replace(mesh, cells=standard_cells(mesh))
            renamed = write_mesh(usual, file, partial(progress, f"writing {out.name}"))
        lost = [f"patch {old} is marker {new}" for old, new in renamed.items()]
        if len(mesh.zones) > 1:
            lost.append("SU2 numbers its zones; the names " + short_list(z.name for z in mesh.zones) + " are lost")
        if mesh.plane and mesh.points[:, 2].any():
            lost.append(f"SU2 has no z in a plane mesh; z = {mesh.points[0, 2]:g} is lost")
        return (*lost, *unwritten(mesh.periodic))


class Su2Pieces(TablePieces):
    """See `Pieces`: the numbers are in tables; a copy is written from the text alone."""

    __slots__ = ()

    def rewrite(
        self, nodes: IntArray, points: FloatArray, out: Path, progress: Progress = silent, runner: Runner = HERE
    ) -> None:
        source = Path(self.source)
        with about(source), source.open("rb") as file:
            text = Su2File.open(file, lambda _: None)
            everything = points_of(text, _points(text))
        everything[nodes] = points
        Su2().rewrite(source, everything, out, progress)


def _layout(
    path: Path, source: Su2File, name: str, zone: Sequence[KeywordBlock], scratch: Path | None = None
) -> MeshOnDisk:
    """Return a zone of a file.

    MeshFileError or ValueError if a section is missing, damaged or contradicts another.
    """
    tables = zone_of(source, zone, scratch)
    pieces = Su2Pieces(str(path), tables.points, tables.ranges, tables.cells)
    patches = patches_of(source, zone, tables.points)
    return MeshOnDisk(path.name, pieces, patches, (Zone(name, 0, tables.points),), notes_of(source.sections))


def _words(file: BinaryIO, report: Callable[[float], None]) -> Iterator[tuple[int, bytes, Placed]]:
    """Yield the pieces of the text with the coordinates of all zones (`Words`)."""
    text = Su2File.open(file, report)
    return text.coordinates(_points(text))


def _points(source: Su2File) -> list[KeywordBlock]:
    return [section for section in source.sections if section.keyword == "NPOIN"]


def _around(source: Su2File) -> list[tuple[int, int]]:
    """Return the bytes before, between and after the points."""
    points = _points(source)
    return list(
        zip(
            [0, *(section.end for section in points)],
            [*(section.begin for section in points), source.sections[-1].end],
            strict=True,
        )
    )


def _same(new: BinaryIO, old: BinaryIO, here: tuple[int, int], there: tuple[int, int]) -> bool:
    for file, (begin, _) in ((new, here), (old, there)):
        file.seek(begin)
    size = max(here[1] - here[0], there[1] - there[0])
    return all(new.read(min(CHUNK, size - at)) == old.read(min(CHUNK, size - at)) for at in range(0, size, CHUNK))


def write_mesh(mesh: Mesh, out: BinaryIO, report: Callable[[float], None]) -> dict[str, str]:
    """Write a mesh of shapes that SU2 has; return the markers of patches whose names SU2 cannot read.

    MeshFileError if it has polyhedra, or boundary faces of more than four corners.
    """
    from .zones import part

    if len(mesh.zones) > 1:
        out.write(b"NZONE= %d\n" % len(mesh.zones))
    renamed: dict[str, str] = {}
    for i, zone in enumerate(mesh.zones):
        if len(mesh.zones) > 1:
            out.write(b"IZONE= %d\n" % (i + 1))
        zone_mesh = part(mesh, zone)
        names = fitting_names([patch.name for patch in zone_mesh.patches], UNFIT, (PARALLEL,))
        renamed |= {name: marker for name, marker in names.items() if name != marker}
        for text, done in _zone(zone_mesh, names):
            out.write(text.encode())
            report((i + done) / len(mesh.zones))
    return renamed


def _zone(mesh: Mesh, names: dict[str, str]) -> Iterator[tuple[str, float]]:
    """Yield the text of one zone, and the fraction that is written."""
    dimension = 2 if mesh.plane else 3
    yield f"NDIME= {dimension}\nNELEM= {sum(len(block) for block in mesh.cells)}\n", 0.0
    number = 0
    for block in mesh.cells:
        if isinstance(block, Polyhedra):
            raise MeshFileError(f"SU2 holds no polyhedra, and the mesh has {len(block)}")
        yield from ((text, 0.7) for text in table(f"{NUMBERS[block.shape]}", block.nodes, number))
        number += len(block)
    yield f"NPOIN= {len(mesh.points)}\n", 0.7
    yield from ((text, 0.9) for text in table("", mesh.points[:, :dimension], 0))
    yield f"NMARK= {len(mesh.patches)}\n", 0.9
    for patch in mesh.patches:
        yield f"MARKER_TAG= {names[patch.name]}\nMARKER_ELEMS= {len(patch)}\n", 0.9
        for block in simple_faces(patch):
            yield from ((text, 0.9) for text in table(f"{NUMBERS[block.shape]}", block.nodes, None))
    yield "", 1.0
