"""UGRID files: encodings and arrays.

Source: UG_IO SimSys UGRID 3D Grid File Type and UG_IO File Names (encodings), Mississippi State University.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.mesh.cells import CORNERS

from .numbers import NumberLines, Placed, chunks, numbers, table
from .tables import FileTable, MemoryTable

SUFFIX = ".ugrid"
POINTS, SURFACE = "points", "surface"
# Names of the first seven numbers of a file, which are counts.
COUNTED = (POINTS, "triangle", "quad", "tetra", "pyramid", "wedge", "hexahedron")
# The arrays after them: coordinates, nodes (from 1) of boundary faces, their surface ids, nodes of cells.
ORDER = (POINTS, "triangle", "quad", SURFACE, "tetra", "pyramid", "wedge", "hexahedron")
# Length of a Fortran record, before and after it.
MARKER = np.dtype("i4")
# Bytes of a record, and numbers, that four bytes can hold.
LONGEST = 2**31 - 1
# Whole numbers below this one are exact in double precision.
EXACT = 2.0**53
# Rows read or written at a time.
ROWS = 1 << 16
HEADER = re.compile(rb"\s*(\d{1,18})" + rb"\s+(\d{1,18})" * 6 + rb"(?=\s|$)")
# Bytes from the beginning of a text that contain its counts.
HEAD = 4096
Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Encoding:
    """An encoding of numbers in binary.

    Parameters
    ----------
    real : Type of coordinates.
    whole : Type of all other numbers.
    records : Whether the counts are one Fortran record, and all arrays another.
    """

    real: np.dtype[Any]
    whole: np.dtype[Any]
    records: bool

    @property
    def begin(self) -> int:
        """First byte of the coordinates."""
        return len(COUNTED) * self.whole.itemsize + 3 * MARKER.itemsize * self.records

    def kind(self, name: str) -> np.dtype[Any]:
        """Return the type of an array's numbers."""
        return self.real if name == POINTS else self.whole

    def body(self, shapes: Mapping[str, tuple[int, int]]) -> int:
        """Return the length of all arrays in bytes."""
        return sum(rows * width * self.kind(name).itemsize for name, (rows, width) in shapes.items())

    def size(self, shapes: Mapping[str, tuple[int, int]]) -> int:
        """Return the length, in bytes, of a file with nothing but these arrays."""
        return self.begin + self.body(shapes) + MARKER.itemsize * self.records

    def marker(self, length: int) -> bytes:
        """Return the marker before and after a record of `length` bytes; MeshFileError if it is too long."""
        if length > LONGEST:
            raise MeshFileError(
                f"its record of {length / 1e9:.1f} GB is too long for Fortran; store it as C does, .b8{SUFFIX}"
            )
        return np.array(length, MARKER.newbyteorder(self.whole.byteorder)).tobytes() if self.records else b""


# By the word before the suffix: little-endian (l) or big-endian, as C (b) or Fortran (r) writes it, coordinates of 8 or
# 4 bytes, other numbers of 8 (l) or of 4.
ENCODINGS = {
    f"{letter}{kind}": Encoding(
        np.dtype(f"{order}f{kind[1]}"), np.dtype(f"{order}i{8 if kind[2:] else 4}"), kind[0] == "r"
    )
    for letter, order in (("", ">"), ("l", "<"))
    for kind in ("b8", "b4", "r8", "r4", "b8l")
}


def encoding_of(path: Path) -> str:
    """Return the key in `ENCODINGS` that a file's name contains; empty for text."""
    word = Path(path.stem).suffix[1:].lower()
    return word if word in ENCODINGS else ""


def ending(path: Path) -> str:
    """Return the suffix of a file, with the encoding if it has one, as in ``.b8.ugrid``."""
    inner = path.suffix.lower() == SUFFIX and encoding_of(path)
    return Path(path.stem).suffix + path.suffix if inner else path.suffix


@dataclass(frozen=True, slots=True, eq=False)
class UgridFile:
    """An open file, its encoding (a key of `ENCODINGS`, empty for text) and the shapes of its arrays."""

    file: BinaryIO = field(repr=False)
    encoding: str
    shapes: dict[str, tuple[int, int]]
    report: Callable[[float], None] = field(repr=False)

    @classmethod
    def open(cls, file: BinaryIO, encoding: str, report: Callable[[float], None]) -> UgridFile:
        """Open a file whose counts fit its length.

        MeshFileError if it is too short, damaged, or of another encoding.
        """
        size = file.seek(0, 2)
        shapes = _shapes(file, encoding)
        needed = _size(shapes, encoding) if shapes else 0
        if (shapes is None or needed != size) and (other := _fitting(file, size, encoding)):
            raise MeshFileError(f"is stored as .{other}{SUFFIX} says; give it that name in place of {_named(encoding)}")
        if shapes is None:
            raise MeshFileError(f"does not begin with seven counts as {_named(encoding)} says; it is no such mesh")
        if needed > size:
            raise MeshFileError(
                f"should have {needed} bytes or more for {shapes[POINTS][0]} points and its cells, but has {size}; it "
                f"is truncated, damaged, or stored otherwise than {_named(encoding)} says"
            )
        ugrid = cls(file, encoding, shapes, report)
        ugrid.check_records()
        return ugrid

    def check_records(self) -> None:
        """Raise MeshFileError if the lengths of Fortran records contradict the counts."""
        if not self.encoding or not ENCODINGS[self.encoding].records:
            return
        encoding = ENCODINGS[self.encoding]
        lengths = (len(COUNTED) * encoding.whole.itemsize, encoding.body(self.shapes))
        at = 0
        for length in lengths:
            for place in (at, at + MARKER.itemsize + length):
                self.file.seek(place)
                if self.file.read(MARKER.itemsize) != encoding.marker(length):
                    raise MeshFileError(f"the Fortran record of {length} bytes has another length; the file is damaged")
            at += 2 * MARKER.itemsize + length

    def tables(self, path: Path) -> dict[str, FileTable | MemoryTable]:
        """Return the arrays as tables in the file at `path`, or in memory if it is text.

        MeshFileError if a text ends early or has other words.
        """
        if not self.encoding:
            return {name: MemoryTable(values) for name, values in self._arrays().items()}
        encoding = ENCODINGS[self.encoding]
        tables: dict[str, FileTable | MemoryTable] = {}
        begin = encoding.begin
        for name, (rows, width) in self.shapes.items():
            tables[name] = table = FileTable(path, begin, encoding.kind(name).str, rows, width)
            begin += rows * table.step
        return tables

    def _arrays(self) -> dict[str, Array]:
        """Return the arrays of a text: points (N, 3), and whole numbers (M, k) for each other shape."""
        arrays: dict[str, Array] = {
            name: np.empty(shape, np.dtype(float if name == POINTS else np.intp)) for name, shape in self.shapes.items()
        }
        wanted = len(COUNTED) + sum(values.size for values in arrays.values())
        for first, _, _, lines in self._words():
            begin = len(COUNTED)
            for name, values in arrays.items():
                read_now = slice(max(first - begin, 0), max(first + len(lines.values) - begin, 0))
                part = values.ravel()[read_now]
                at = max(begin - first, 0)
                part[:] = _check_whole(name, lines.values[at : at + len(part)])
                begin += values.size
            self.report(min(1.0, (first + len(lines.values)) / wanted))
            if first + len(lines.values) >= wanted:
                return arrays
        raise MeshFileError(f"{wanted} numbers should be there, but the file ends before them; it is truncated")

    def coordinates(self) -> Iterator[tuple[int, bytes, Placed]]:
        """Yield each piece's begin, its text and its coordinates; MeshFileError if the text ends early."""
        begin, end = len(COUNTED), len(COUNTED) + 3 * self.shapes[POINTS][0]
        for first, at, text, lines in self._words():
            inside = slice(max(begin - first, 0), max(end - first, 0))
            yield at, text, Placed(np.asarray(lines.values[inside], np.float64), lines.begin[inside], lines.end[inside])
            self.report(min(1.0, first / end))
            if first + len(lines.values) >= end:
                return
        raise MeshFileError("the coordinates end too early; the file is truncated")

    def _words(self) -> Iterator[tuple[int, int, bytes, NumberLines]]:
        """Yield the number of words before each piece of text, its begin, the piece, and its words."""
        first = 0
        for at, text in chunks(self.file, 0, self.file.seek(0, 2)):
            lines = numbers(text, np.float64)
            yield first, at, text, lines
            first += len(lines.values)


def check_range(points: FloatArray, kind: np.dtype[Any]) -> None:
    """Raise ValueError if coordinates are too large for a type."""
    if np.abs(points).max(initial=0.0) > np.finfo(kind).max:
        raise ValueError("coordinates are too large for numbers of 4 bytes; name a file of 8 bytes, such as .b8.ugrid")


def encode(arrays: Mapping[str, Any], encoding: str) -> Iterator[bytes]:
    """Yield the bytes of a file with arrays in the order of `UgridFile.tables`.

    MeshFileError if there are more nodes than the encoding can number, or more data than a record can hold.
    """
    counts = np.array([[len(arrays[name]) for name in COUNTED]])
    if not encoding:
        yield from (text.encode() for values in (counts, *arrays.values()) for text in table("", values, None))
        return
    layout = ENCODINGS[encoding]
    if counts.max() > np.iinfo(layout.whole).max:
        raise MeshFileError(f"{counts.max()} points or cells are too many for numbers of {layout.whole.itemsize} bytes")
    check_range(arrays[POINTS], layout.real)
    around = layout.marker(counts.size * layout.whole.itemsize)
    yield around + counts.astype(layout.whole).tobytes() + around
    around = layout.marker(layout.body({name: arrays[name].shape for name in ORDER}) if layout.records else 0)
    yield around
    for name in ORDER:
        for start in range(0, len(arrays[name]), ROWS):
            yield arrays[name][start : start + ROWS].astype(layout.kind(name)).tobytes()
    yield around


def _shapes(file: BinaryIO, encoding: str) -> dict[str, tuple[int, int]] | None:
    """Return the shapes of all arrays by the counts; None if there are no counts."""
    file.seek(0)
    head = file.read(HEAD)
    if not encoding:
        match = None if b"\0" in head else HEADER.match(head)
        counts = [int(word) for word in match.groups()] if match else []
    else:
        layout = ENCODINGS[encoding]
        at = MARKER.itemsize * layout.records
        data = head[at : at + len(COUNTED) * layout.whole.itemsize]
        counts = np.frombuffer(data, layout.whole).tolist() if len(data) == len(COUNTED) * layout.whole.itemsize else []
    if not counts or min(counts) < 0:
        return None
    rows = dict(zip(COUNTED, counts, strict=True))
    rows[SURFACE] = rows["triangle"] + rows["quad"]
    return {name: (rows[name], {POINTS: 3, SURFACE: 1}.get(name) or CORNERS[name]) for name in ORDER}


def _size(shapes: Mapping[str, tuple[int, int]], encoding: str) -> int:
    """Return the least length of a file, in bytes."""
    if encoding:
        return ENCODINGS[encoding].size(shapes)
    return 2 * (len(COUNTED) + sum(rows * width for rows, width in shapes.values())) - 1


def _fitting(file: BinaryIO, size: int, encoding: str) -> str:
    """Return the binary encoding in which a file's counts give its exact length; None without one."""
    for other in ENCODINGS:
        shapes = _shapes(file, other) if other != encoding else None
        if shapes and _size(shapes, other) == size:
            return other
    return ""


def _named(encoding: str) -> str:
    return f".{encoding}{SUFFIX}" if encoding else f"{SUFFIX} (text)"


def _check_whole(name: str, values: Array) -> Array:
    """Return an array; MeshFileError if it has other than whole numbers and is not that of the coordinates."""
    if name == POINTS:
        return values
    if bad := np.count_nonzero(~(np.abs(values) < EXACT) | (values != np.rint(values))):
        raise MeshFileError(f"{bad} nodes or surface ids of {name} are no whole numbers; the file is damaged")
    return values
