"""Gmsh's own files: their version, their sections, and the numbers and nodes in them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from mmap import mmap

import numpy as np

from sdm_deflect.deform.base.arrays import IntArray
from sdm_deflect.deform.base.sets import distinct
from sdm_deflect.meshing.formats.format import FLUENT, MeshFileError
from sdm_deflect.meshing.formats.numbers import Lines, Placed, numbers

REAL = np.dtype("f8")
AFFINE = re.compile(rb"^[ \t]*Affine[^\n]*\n(?:[^\n]*\.[^\n]*\n)*", re.MULTILINE)
"""A transformation in version 2.2; Gmsh breaks its line after 255 letters where it copies it, within a number."""
NAME = re.compile(rb"\s*\$(\w+)[ \t\r]*\n")
VERSIONS = {"2": 22, "2.0": 22, "2.1": 22, "2.2": 22, "4.1": 41}


class TextCursor:
    """Numbers of a section in text, one after another."""

    def __init__(self, content: bytes, offset: int, name: str) -> None:
        self.words: Lines = numbers(content, np.float64)
        if not np.isfinite(self.words.values).all():
            raise MeshFileError(f"section ${name} holds numbers that are not finite")
        self.offset, self.name, self.at = offset, name, 0

    def reals(self, count: int) -> Placed:
        """The next `count` numbers."""
        own = slice(self.at, self.at + count)
        self.at += count
        if count < 0 or self.at > len(self.words.values):
            raise _ended(self.name)
        values = np.asarray(self.words.values[own], dtype=np.float64)
        return Placed(values, self.offset + self.words.begin[own], self.offset + self.words.end[own])

    def ints(self, count: int) -> IntArray:
        """The next `count` integers."""
        with np.errstate(invalid="ignore"):
            return self.reals(count).values.astype(np.intp)

    sizes = ints


class ByteCursor:
    """Numbers of a section in binary, one after another."""

    def __init__(self, content: bytes | mmap, offset: int, name: str, order: str, at: int = 0) -> None:
        self.content, self.offset, self.name, self.order, self.at = content, offset, name, order, at

    def line(self) -> int:
        """The integer on a line of text, as version 2.2 has them between binary data."""
        end = self.content.find(b"\n", self.at) + 1
        text, self.at = self.content[self.at : end], end or len(self.content)
        return int(text)

    def raw(self, count: int, kind: str) -> np.ndarray[tuple[int, ...], np.dtype[np.void]]:
        """The next `count` values of a NumPy type such as ``"i4,3f8"``, in the file's byte order."""
        own = np.dtype(kind).newbyteorder(self.order)  # type: ignore[arg-type]
        end = self.at + count * own.itemsize
        if count < 0 or end > len(self.content):
            raise _ended(self.name)
        values = np.frombuffer(self.content[self.at : end], own)
        self.at = end
        return values

    def passed(self, size: int) -> int:
        """Pass by the next `size` bytes, and return where they begin."""
        begin = self.at
        self.at += size
        if size < 0 or self.at > len(self.content):
            raise _ended(self.name)
        return begin

    def reals(self, count: int) -> Placed:
        """The next `count` numbers."""
        at, values = self.at, self.raw(count, "f8")
        begin = self.offset + at + REAL.itemsize * np.arange(count)
        return Placed(values.astype(np.float64), begin, begin + REAL.itemsize)

    def ints(self, count: int) -> IntArray:
        """The next `count` integers of 4 bytes."""
        return self.raw(count, "i4").astype(np.intp)

    def peek(self, count: int) -> IntArray:
        """The same, to be read again."""
        at, values = self.at, self.ints(count)
        self.at = at
        return values

    def sizes(self, count: int) -> IntArray:
        """The next `count` integers of 8 bytes."""
        return self.raw(count, "i8").astype(np.intp)


Cursor = TextCursor | ByteCursor


def _ended(name: str) -> MeshFileError:
    return MeshFileError(f"section ${name} holds fewer numbers than it announces; the file is truncated or damaged")


@dataclass(frozen=True, slots=True, eq=False)
class GmshFile:
    """The bytes of a file and where its sections are.

    Parameters
    ----------
    data : All bytes.
    version : 22 or 41.
    order : ``"<"`` or ``">"`` for binary files, empty for text.
    sections : First and last byte (exclusive) of the content of each section, by name.
    """

    data: bytes | mmap = field(repr=False)
    version: int
    order: str
    sections: dict[str, tuple[int, int]]

    def content(self, name: str) -> bytes:
        """Return the bytes of a section; MeshFileError if it is not there."""
        if name not in self.sections:
            raise MeshFileError(f"there is no section ${name}; the file is truncated or holds no mesh")
        begin, end = self.sections[name]
        return self.data[begin:end]

    def cursor(self, name: str) -> Cursor:
        """Read the numbers of a section one after another."""
        content, (begin, _) = self.content(name), self.sections[name]
        return ByteCursor(content, begin, name, self.order) if self.order else TextCursor(content, begin, name)


def opened(data: bytes) -> GmshFile:
    """Find the sections of a file; MeshFileError if it is not of Gmsh, of a version that is not read, or truncated."""
    if not NAME.match(data):
        if data.lstrip()[:1] == b"(":
            raise MeshFileError(f"is a mesh of Fluent, not of Gmsh; {FLUENT}")
        raise MeshFileError("is not a mesh of Gmsh: it does not begin with $MeshFormat")
    sections = _sections(data)
    if "MeshFormat" not in sections:
        raise MeshFileError("has no section $MeshFormat; Gmsh's versions before 2 are not read")
    begin, end = sections["MeshFormat"]
    head, _, one = data[begin:end].partition(b"\n")
    words = head.decode("ascii", "replace").split()
    if len(words) < 3 or words[0] not in VERSIONS:
        raise MeshFileError(
            f"is of version {' '.join(words[:1])}; 2.2 and 4.1 are read: convert it with gmsh -save -format msh41"
        )
    if words[2] != "8":
        raise MeshFileError(f"numbers of {words[2]} bytes are not read, only those of 8")
    order = "" if words[1] == "0" else "<" if one[:4] == b"\1\0\0\0" else ">"
    return GmshFile(data, VERSIONS[words[0]], order, sections)


def _sections(data: bytes) -> dict[str, tuple[int, int]]:
    found: dict[str, tuple[int, int]] = {}
    at = 0
    while header := NAME.match(data, at):
        name = header[1].decode("ascii", "replace")
        end = data.find(b"$End" + header[1], header.end())
        if end < 0:
            raise MeshFileError(f"section ${name} does not end; the file is truncated")
        found.setdefault(name, (header.end(), end))
        at = end + len(name) + 4
    if data[at:].strip():
        raise MeshFileError(f"{data[at : at + 20].strip()!r} between sections is not supported: delete it")
    return found


def nodes(file: GmshFile) -> tuple[IntArray, Placed]:
    """Return numbers (N,) and coordinates (N, 3) of the nodes, in the file's order.

    MeshFileError if they are truncated, or two have the same number.
    """
    cursor = file.cursor("Nodes")
    tags, points = _nodes22(cursor) if file.version == 22 else _nodes41(cursor)
    if twice := len(tags) - len(distinct(tags)):
        raise MeshFileError(f"{twice} of {len(tags)} nodes have the number of another")
    return tags, points


def _nodes22(cursor: Cursor) -> tuple[IntArray, Placed]:
    if isinstance(cursor, TextCursor):
        count = int(cursor.ints(1)[0])
        table = cursor.reals(4 * count)
        with np.errstate(invalid="ignore"):
            tags = table.values[::4].astype(np.intp)
        return tags, _columns(table, 4, slice(1, 4))
    count = cursor.line()
    first = cursor.offset + cursor.at + 4
    records = cursor.raw(count, "i4,3f8")
    begin = first + 28 * np.arange(count)[:, None] + 8 * np.arange(3)
    return records["f0"].astype(np.intp), Placed(records["f1"].astype(np.float64), begin, begin + 8)


def _nodes41(cursor: Cursor) -> tuple[IntArray, Placed]:
    tags, found = [np.empty(0, dtype=np.intp)], []
    for _ in range(int(cursor.sizes(4)[0])):
        dimension, _, parametric = cursor.ints(3).tolist()
        count = int(cursor.sizes(1)[0])
        tags.append(cursor.sizes(count))
        width = node_width(dimension, parametric)
        found.append(_columns(cursor.reals(width * count), width, slice(3)))
    none = np.empty((0, 3), dtype=np.intp)
    begin, end = (np.concatenate([none, *(getattr(own, name) for own in found)]) for name in ("begin", "end"))
    points = np.concatenate([np.empty((0, 3)), *(own.values for own in found)])
    return np.concatenate(tags), Placed(points, begin, end)


def node_width(dimension: int, parametric: int) -> int:
    """Return how many numbers there are for a node of an entity: its coordinates, and its parameters on the entity."""
    if not 0 <= dimension <= 3:
        raise MeshFileError(f"$Nodes has an entity of dimension {dimension}; the file is damaged")
    return 3 + (dimension if parametric else 0)


def _columns(table: Placed, width: int, chosen: slice) -> Placed:
    """Columns of a table of `width`: coordinates have a node's number before them, or parameters after them."""
    begin, end = (places.reshape(-1, width)[:, chosen] for places in (table.begin, table.end))
    return Placed(table.values.reshape(-1, width)[:, chosen], begin, end)


def periodic(file: GmshFile, dimension: int) -> Iterator[tuple[str, IntArray]]:
    """Yield name and node numbers (K, 2), a node and its image, of each link of entities of a dimension.

    MeshFileError if the section is truncated.
    """
    if "Periodic" not in file.sections:
        return
    as_text = file.version == 22 or b"Affine" in file.content("Periodic")  # copied as it was read
    links = _links22(file) if as_text else _links41(file.cursor("Periodic"))
    for (own, entity, source), nodes in links:
        if own == dimension:
            yield f"{'curve' if own == 1 else 'surface'}s {source} and {entity}", nodes[:, ::-1]


Link = tuple[list[int], IntArray]
"""Dimension of two entities, tag of the one and of its source; numbers (K, 2) of its nodes and those of the source."""


def _links22(file: GmshFile) -> Iterator[Link]:
    """Version 2.2 has text in binary files, too; a line with the transformation may begin with a word."""
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
