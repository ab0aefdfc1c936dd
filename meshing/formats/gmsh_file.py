"""Gmsh's own files: their version, their sections, and the numbers and nodes in them."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import IntArray, distinct
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.errors import FLUENT

from .numbers import NumberLines, Placed, numbers
from .shapes import places
from .tables import FileTable, MemoryTable

REAL = "f8"
CONVERT = "`gmsh FILE -save -format msh22 -o NEW.msh` converts it"
# Bytes from the beginning that contain the version.
HEAD = 4096
# Numbers of nodes compared at a time.
ROWS = 1 << 20
# A transformation in version 2.2; Gmsh breaks its line after 255 letters where it copies it, within a number.
AFFINE = re.compile(rb"^[ \t]*Affine[^\n]*\n(?:[^\n]*\.[^\n]*\n)*", re.MULTILINE)
NAME = re.compile(rb"\s*\$(\w+)[ \t\r]*\n")
VERSIONS = {"2": 22, "2.0": 22, "2.1": 22, "2.2": 22, "4.1": 41}
# Dimension of two entities, tag of the one and of its source; numbers (K, 2) of its nodes and those of the source.
Link = tuple[list[int], IntArray]


class TextCursor:
    """Reader of the numbers of a section in text; `placed` are the coordinates with their places in the text."""

    def __init__(self, content: bytes, offset: int, name: str) -> None:
        self.words: NumberLines = numbers(content, np.float64)
        if not np.isfinite(self.words.values).all():
            raise MeshFileError(f"section ${name} holds numbers that are not finite")
        self.offset, self.name, self.at = offset, name, 0
        self.placed: list[Placed] = []

    def reals(self, count: int) -> Placed:
        """The next `count` numbers."""
        rows = slice(self.at, self.at + count)
        self.at += count
        if count < 0 or self.at > len(self.words.values):
            raise _ended(self.name)
        values = np.asarray(self.words.values[rows], dtype=np.float64)
        return Placed(values, self.offset + self.words.begin[rows], self.offset + self.words.end[rows])

    def ints(self, count: int) -> IntArray:
        """The next `count` integers."""
        with np.errstate(invalid="ignore"):
            return self.reals(count).values.astype(np.intp)

    sizes = ints

    def columns(self, count: int, width: int, kind: str, chosen: slice) -> MemoryTable:
        """Columns of the next `count` rows of `width` numbers: points if their kind is real, else integers."""
        placed = self.reals(count * width)
        begin, end = (ends.reshape(count, width)[:, chosen] for ends in (placed.begin, placed.end))
        table = Placed(placed.values.reshape(count, width)[:, chosen], begin, end)
        if kind == REAL:
            self.placed.append(table)
            return MemoryTable(table.values)
        with np.errstate(invalid="ignore"):
            return MemoryTable(table.values.astype(np.intp))


class ByteCursor:
    """Reader of the numbers of a section in binary: bytes `at` to `end` - 1 of the file at `path`."""

    def __init__(self, file: "GmshFile", name: str) -> None:
        self.data, self.path, self.order, self.name = file.data, file.path, file.order, name
        self.at, self.end = file.section(name)

    def line(self) -> int:
        """The integer on a line of text, as version 2.2 has them between binary data."""
        end = self.data.find(b"\n", self.at, self.end) + 1 or self.end
        text, self.at = self.data[self.at : end], end
        return int(text)

    def skip(self, size: int) -> int:
        """Skip the next `size` bytes, and return where they begin."""
        begin = self.at
        self.at += size
        if size < 0 or self.at > self.end:
            raise _ended(self.name)
        return begin

    def raw(self, count: int, kind: str) -> NDArray[Any]:
        """The next `count` numbers of a type, in the file's byte order."""
        dtype = np.dtype(kind).newbyteorder(self.order)  # type: ignore[arg-type]
        begin = self.skip(count * dtype.itemsize)
        return np.frombuffer(self.data[begin : self.at], dtype)

    def reals(self, count: int) -> NDArray[Any]:
        """The next `count` real numbers."""
        return self.raw(count, REAL)

    def ints(self, count: int) -> IntArray:
        """The next `count` integers of 4 bytes."""
        return self.raw(count, "i4").astype(np.intp)

    def peek(self, count: int) -> IntArray:
        """The next integers, without moving on."""
        at, values = self.at, self.ints(count)
        self.at = at
        return values

    def sizes(self, count: int) -> IntArray:
        """The next `count` integers of 8 bytes."""
        return self.raw(count, "i8").astype(np.intp)

    def columns(self, count: int, width: int, kind: str, chosen: slice) -> FileTable:
        """Columns of the next `count` rows of `width` numbers of a type; they stay in the file."""
        size = np.dtype(kind).itemsize
        begin, (first, last, _) = self.skip(size * width * count), chosen.indices(width)
        return FileTable(self.path, begin + size * first, f"{self.order}{kind}", count, last - first, size * width)


Cursor = TextCursor | ByteCursor


def _ended(name: str) -> MeshFileError:
    return MeshFileError(f"section ${name} holds fewer numbers than it announces; the file is truncated or damaged")


@dataclass(frozen=True, slots=True, eq=False)
class GmshFile:
    """The bytes of a file, and the places of its sections.

    Parameters
    ----------
    path : The file.
    data : All its bytes.
    version : 22 or 41.
    order : ``"<"`` or ``">"`` for binary files, empty for text.
    sections : First and last byte (exclusive) of the content of each section, by name.
    """

    path: Path
    data: bytes | mmap = field(repr=False)
    version: int
    order: str
    sections: dict[str, tuple[int, int]]

    def section(self, name: str) -> tuple[int, int]:
        """Return the first and the last byte (exclusive) of a section; MeshFileError if it is not there."""
        if name not in self.sections and f"Parametric{name}" in self.sections:
            raise MeshFileError(f"section $Parametric{name} is not read; {CONVERT}")
        if name not in self.sections:
            raise MeshFileError(f"there is no section ${name}; the file is truncated or holds no mesh")
        return self.sections[name]

    def content(self, name: str) -> bytes:
        """Return the bytes of a section; MeshFileError if it is not there."""
        return self.data[slice(*self.section(name))]

    def cursor(self, name: str) -> Cursor:
        """Read the numbers of a section one after another."""
        return ByteCursor(self, name) if self.order else TextCursor(self.content(name), self.section(name)[0], name)


@contextmanager
def gmsh_file(path: Path) -> Iterator[GmshFile]:
    """Memory-map a file; errors as of `open_gmsh`."""
    with path.open("rb") as file:
        if not os.fstat(file.fileno()).st_size:
            yield open_gmsh(path, b"")
            return
        with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
            yield open_gmsh(path.resolve(), data)


def open_gmsh(path: Path, data: bytes | mmap) -> GmshFile:
    """Find the sections of a file; MeshFileError if it is no Gmsh file, of an unsupported version, or truncated."""
    if not NAME.match(data):
        if data[:HEAD].lstrip()[:1] == b"(":
            raise MeshFileError(f"is a mesh of Fluent, not of Gmsh; {FLUENT}")
        raise MeshFileError("is not a mesh of Gmsh: it does not begin with $MeshFormat")
    if data[:HEAD].lstrip().startswith(b"$NOD"):
        raise MeshFileError(f"is of Gmsh's version 1, which is not read; {CONVERT}")
    sections = _sections(data)
    if "MeshFormat" not in sections:
        raise MeshFileError("has no section $MeshFormat; the file is damaged")
    begin, end = sections["MeshFormat"]
    head, _, mark = data[begin:end].partition(b"\n")
    words = head.decode("ascii", "replace").split()
    if len(words) < 3 or words[0] not in VERSIONS:
        raise MeshFileError(f"is of version {' '.join(words[:1])}; 2.2 and 4.1 are read: {CONVERT}")
    if words[2] != "8":
        raise MeshFileError(f"numbers of {words[2]} bytes are not read, only those of 8")
    order = "" if words[1] == "0" else "<" if mark[:4] == b"\1\0\0\0" else ">"
    return GmshFile(path, data, VERSIONS[words[0]], order, sections)


def _sections(data: bytes | mmap) -> dict[str, tuple[int, int]]:
    sections: dict[str, tuple[int, int]] = {}
    at = 0
    while header := NAME.match(data, at):
        name = header[1].decode("ascii", "replace")
        end = data.find(b"$End" + header[1], header.end())
        if end < 0:
            raise MeshFileError(f"section ${name} does not end; the file is truncated")
        sections.setdefault(name, (header.end(), end))
        at = end + len(name) + 4
    if data[at:].strip():
        raise MeshFileError(f"{data[at : at + 20].strip()!r} between sections is not supported: delete it")
    return sections


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """The numbers of nodes and their points, part by part; for text also the places of the points.

    `known` (N,) are the numbers of all nodes in the file's order; None if they count from 1.
    """

    points: Sequence[FileTable | MemoryTable]
    known: IntArray | None
    placed: Sequence[Placed] = ()

    @property
    def count(self) -> int:
        """Number of nodes."""
        return sum(table.rows for table in self.points)

    def index(self, numbers: IntArray, what: str = "elements") -> IntArray:
        """Return the index of each node (M, k) from its number; MeshFileError, about `what`, if there is none."""
        if self.known is None:
            index = numbers - 1
            there = (index >= 0) & (index < self.count)
        else:
            index, there = places(numbers, self.known)
        if missing := np.count_nonzero(~there.all(axis=1)):
            raise MeshFileError(f"{missing} {what} name nodes that are not among the {self.count}")
        return index


def nodes(file: GmshFile) -> Nodes:
    """Return the nodes; MeshFileError if they are truncated, or two have the same number."""
    cursor = file.cursor("Nodes")
    parts = list(_nodes22(cursor) if file.version == 22 else _nodes41(cursor))
    points = [part for _, part in parts]
    placed = cursor.placed if isinstance(cursor, TextCursor) else ()
    if _in_order([part for part, _ in parts]):
        return Nodes(points, None, placed)
    known = np.concatenate([np.empty(0, np.intp), *(part.integers()[:, 0] for part, _ in parts)])
    if twice := len(known) - len(distinct(known)):
        raise MeshFileError(f"{twice} of {len(known)} nodes have the number of another")
    return Nodes(points, known, placed)


def _in_order(tags: Sequence[FileTable | MemoryTable]) -> bool:
    """Return whether nodes are numbered 1, 2, ... in the file's order."""
    first = 1
    for table in tags:
        for start in range(0, table.rows, ROWS):
            part = table.read(start, min(start + ROWS, table.rows)).ravel()
            if not np.array_equal(part, np.arange(first, first + len(part))):
                return False
            first += len(part)
    return True


def _nodes22(cursor: Cursor) -> Iterator[tuple[FileTable | MemoryTable, FileTable | MemoryTable]]:
    if isinstance(cursor, TextCursor):
        count, at = int(cursor.ints(1)[0]), cursor.at
        tags = cursor.columns(count, 4, "i4", slice(1))
        cursor.at = at
        yield tags, cursor.columns(count, 4, REAL, slice(1, 4))
        return
    count = cursor.line()
    begin = cursor.skip(28 * count)
    path, order = cursor.path, cursor.order
    yield FileTable(path, begin, f"{order}i4", count, 1, 28), FileTable(path, begin + 4, f"{order}f8", count, 3, 28)


def _nodes41(cursor: Cursor) -> Iterator[tuple[FileTable | MemoryTable, FileTable | MemoryTable]]:
    for _ in range(int(cursor.sizes(4)[0])):
        dimension, _, parametric = cursor.ints(3).tolist()
        count = int(cursor.sizes(1)[0])
        tags = cursor.columns(count, 1, "i8", slice(1))
        if not 0 <= dimension <= 3:
            raise MeshFileError(f"$Nodes has an entity of dimension {dimension}; the file is damaged")
        points = cursor.columns(count, 3 + (dimension if parametric else 0), REAL, slice(3))
        if count:
            yield tags, points


def periodic(file: GmshFile, dimension: int) -> Iterator[tuple[str, IntArray]]:
    """Yield name and node numbers (K, 2), a node and its image, of each link of entities of a dimension.

    MeshFileError if the section is truncated.
    """
    if "Periodic" not in file.sections:
        return
    as_text = file.version == 22 or b"Affine" in file.content("Periodic")  # copied as it was read
    links = _links22(file) if as_text else _links41(file.cursor("Periodic"))
    for (entity_dimension, entity, source), nodes in links:
        if entity_dimension == dimension:
            yield f"{'curve' if entity_dimension == 1 else 'surface'}s {source} and {entity}", nodes[:, ::-1]


def _links22(file: GmshFile) -> Iterator[Link]:
    """Yield the links of version 2.2: text, even in binary files; a transformation may begin with a word."""
    content, (begin, _) = file.content("Periodic"), file.sections["Periodic"]
    cursor = TextCursor(AFFINE.sub(b"", content), begin, "Periodic")
    for _ in range(_links(int(cursor.ints(1)[0]))):
        entities = cursor.ints(3).tolist()
        yield entities, cursor.ints(2 * int(cursor.ints(1)[0])).reshape(-1, 2)


def _links41(cursor: Cursor) -> Iterator[Link]:
    for _ in range(_links(int(cursor.sizes(1)[0]))):
        entities = cursor.ints(3).tolist()
        cursor.reals(int(cursor.sizes(1)[0]))
        yield entities, cursor.sizes(2 * int(cursor.sizes(1)[0])).reshape(-1, 2)


def _links(count: int) -> int:
    if count < 0:
        raise MeshFileError(f"$Periodic announces {count} links; the file is damaged")
    return count
