"""Nodes of a CGNS file in ADF, which came before HDF5: tables in the file say where the data of each node are.

A pointer is the number of a block of 4096 bytes and a place in it. Files of version A (``A02011``) hold all numbers of
the tables as hexadecimal text: 8 digits and 4 for a pointer, 8 for a size. Files of version B (``B02012``, of libraries
for large files) hold pointers and sizes of data as binary integers in the file's order of bytes: 8 bytes and 4 for a
pointer, 8 for a size; counts stay text.
Source: ADF User's Guide, and the layout of tables in the ADF core of the CGNS library (``ADF_internals``).

Only coordinates are written, where they stand (`AdfCoordinates`); converted to HDF5 and back, it would be another file.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import DTypeLike

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.mesh.precision import fewest_bits

from .cgns_nodes import LINK, Array, Node, Stored, linked
from .coordinates import moved_coordinates
from .rewriting import Change, rewritten
from .tables import FileTable

# Mark at the beginning of a file.
MARK = b"ADF Database"
# Bytes of the file's header, of a node's, of an entry in the table of its children, of a pointer, of a tag.
HEADER, NODE, ENTRY, POINTER, TAG = 186, 246, 44, 12, 4
# Bytes of a block by the format: a pointer is the number of a block and a place in it.
BLOCK = 4096
# Order of bytes by the letter in the header; the other letters are of machines that are no more.
ORDER: dict[str, Literal[">", "<"]] = {"B": ">", "L": "<"}
# NumPy's types by ADF's; MT is a node without data.
KINDS = {"C1": "i1", "B1": "u1", "I4": "i4", "I8": "i8", "U4": "u4", "U8": "u8", "R4": "f4", "R8": "f8"}
EMPTY = "MT"
# Most dimensions of an array by the SIDS.
DIMENSIONS = 12


class AdfStored(Stored):
    """Numbers in runs of bytes: place and length of each, in order."""

    def __init__(self, tree: "Tree", shape: tuple[int, ...], dtype: np.dtype[Any], runs: Sequence[tuple[int, int]]):
        self.tree, self.shape, self.dtype, self.runs = tree, shape, dtype, runs
        self.begin = runs[0][0] if len(runs) == 1 else 0

    def read(self, kind: DTypeLike | None = None) -> Array:
        data = b"".join(self.tree.bytes_at(place, length) for place, length in self.runs)
        values = np.frombuffer(data, self.dtype).reshape(self.shape)
        return values.astype(kind) if kind is not None else values.astype(self.dtype.newbyteorder("="))

    def first(self) -> int | None:
        if not self.size:
            return None
        return int(np.frombuffer(self.tree.bytes_at(self.runs[0][0], self.dtype.itemsize), self.dtype)[0])

    def tables(self, path: Path) -> list[FileTable]:
        """Return the numbers as tables of the file, one after another; MeshFileError if a run ends within a number."""
        found = []
        for place, length in self.runs:
            count, rest = divmod(length, self.dtype.itemsize)
            if rest:
                raise MeshFileError("a coordinate stands in two places; convert the file: cgnsconvert -h IN OUT")
            found.append(FileTable(path, place, self.dtype.str, count))
        return found


class AdfNode(Node):
    """A node by its header, which begins at `place`."""

    def __init__(self, tree: "Tree", name: str, place: int) -> None:
        self.tree, self.name, self.place, self.file_size = tree, name, place, tree.size
        self._header = tree.tagged(place, b"NoDe", NODE)
        if not self._header.endswith(b"TaiL"):
            raise MeshFileError(f"the node {name} has no end; the file is damaged")
        self.label, self.kind = _text(self._header[36:68]), _text(self._header[96:128])

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def names(self) -> list[str]:
        return [*self._places]

    def find(self, name: str) -> "AdfNode | None":
        if self.kind == LINK:
            raise linked(self.name)
        if name not in self._places:
            return None
        found = AdfNode(self.tree, f"{self.name}/{name}".strip("/"), self._places[name])
        if found.kind == LINK:
            raise linked(found.name)
        return found

    @cached_property
    def _places(self) -> dict[str, int]:
        """Places of the children by name, in the file's order; MeshFileError if their table is damaged."""
        count, found = _number(self._header[68:76]), dict[str, int]()
        if not count:
            return found
        place = self.tree.pointer(self._header[84:96])
        table = self.tree.tagged(place, b"SNTb", TAG + POINTER + count * ENTRY)
        for start in range(TAG + POINTER, len(table), ENTRY):
            name = _text(table[start : start + 32])
            place = self.tree.pointer(table[start + 32 : start + ENTRY])
            if name in found or self.tree.parents.setdefault(place, self.place) != self.place:
                raise MeshFileError(f"the node {self.name}/{name} is there twice; the file is damaged")
            found[name] = place
        return found

    def stored(self) -> AdfStored | None:
        if self.kind == LINK:
            raise linked(self.name)
        if self.kind == EMPTY:
            return None
        if self.kind not in KINDS:
            raise MeshFileError(f"{self.name} holds data of type {self.kind!r}, expected one of {', '.join(KINDS)}")
        count = _number(self._header[128:130])
        if not 1 <= count <= DIMENSIONS:
            raise MeshFileError(
                f"{self.name} has data in {count} dimensions, expected 1 to {DIMENSIONS}; the file is damaged"
            )
        shape = tuple(self.tree.integer(self._header[130 + 8 * i : 138 + 8 * i]) for i in reversed(range(count)))
        kind = np.dtype(KINDS[self.kind]).newbyteorder(self.tree.order)
        return AdfStored(self.tree, shape, kind, self._runs(prod(shape) * kind.itemsize))

    def _runs(self, size: int) -> list[tuple[int, int]]:
        """Return place and length of the runs of bytes that hold `size` bytes of data."""
        pointer = self.tree.pointer
        count, place = _number(self._header[226:230]), pointer(self._header[230:242])
        ends = []
        if count == 1:
            ends = [place, pointer(self.tree.tagged(place, b"DaTa", TAG + POINTER)[TAG:])]
        elif count:
            table = self.tree.tagged(place, b"DCtb", TAG + POINTER + 2 * count * POINTER)[TAG + POINTER :]
            ends = [pointer(table[at : at + POINTER]) for at in range(0, len(table), POINTER)]
        self.tree.hold(self, size)
        found, left = [], size
        for begin, end in zip(ends[::2], ends[1::2], strict=True):
            first = begin + TAG + POINTER
            length = min(left, end - first)
            if length < 0 or first + length > self.tree.size:
                break
            found.append((first, length))
            left -= length
        if left:
            raise MeshFileError(f"{self.name} should have {size} bytes of data; the file is truncated or damaged")
        return found


class Tree:
    """An open file."""

    def __init__(self, file: BinaryIO) -> None:
        """Read the header; MeshFileError if it is damaged, or of a machine whose numbers are none of today's."""
        self.file, self.size = file, file.seek(0, 2)
        self.parents: dict[int, int] = {}
        self._held: set[int] = set()
        self._bytes = 0
        header = self.bytes_at(0, HEADER)
        if header[32:36] != b"AdF0" or header[182:186] != b"AdF5":
            raise MeshFileError("the header of this ADF file is damaged")
        letter = header[100:101].decode("latin-1")
        if letter not in ORDER:
            raise MeshFileError(f"its numbers are in the format {letter!r}, expected B or L (IEEE); convert the file")
        self.order, self.binary = ORDER[letter], header[25:26] == b"B"
        if self.size <= (end := self.pointer(header[146:158])):
            raise MeshFileError(f"the file is truncated: it has {self.size} of {end + 1} bytes")
        self.root = AdfNode(self, "", self.pointer(header[134:146]))

    def hold(self, node: AdfNode, size: int) -> None:
        """Note the data of a node; MeshFileError if those of all nodes so far are more than the file."""
        if node.place not in self._held:
            self._held.add(node.place)
            self._bytes += size
        if self._bytes > self.size:
            raise MeshFileError(f"{node.name} and other nodes have more data than the file; the file is damaged")

    def integer(self, stored: bytes) -> int:
        """Return a number in binary or in hexadecimal digits, as the file has them; MeshFileError if it is none."""
        if not self.binary:
            return _number(stored)
        return int.from_bytes(stored, "big" if self.order == ">" else "little")

    def pointer(self, stored: bytes) -> int:
        """Return the place in the file that a pointer (12 bytes) leads to; MeshFileError if it is none."""
        return self.integer(stored[:8]) * BLOCK + self.integer(stored[8:])

    def bytes_at(self, place: int, length: int) -> bytes:
        """Return bytes of the file; MeshFileError if it ends before."""
        if place + length > self.size:
            raise MeshFileError(
                f"the file is truncated or damaged: {place + length} bytes are needed, {self.size} there"
            )
        self.file.seek(place)
        return self.file.read(length)

    def tagged(self, place: int, tag: bytes, length: int) -> bytes:
        """Return a table, which begins with its tag; MeshFileError if it does not."""
        found = self.bytes_at(place, length)
        if not found.startswith(tag):
            raise MeshFileError(f"no {tag.decode()} at byte {place}; the file is damaged")
        return found


@dataclass(frozen=True, slots=True)
class Column:
    """One coordinate of the stored points start to stop - 1, in tables one after another."""

    tables: Sequence[FileTable]
    start: int
    stop: int
    axis: int

    def read(self) -> Array:
        """Return the numbers (stop - start, 1)."""
        return np.concatenate([table.read(0, table.rows) for table in self.tables])


@dataclass(frozen=True, slots=True, eq=False)
class AdfCoordinates:
    """Coordinates in a file; `index` and `stored` as in `hdf5.Datasets`."""

    path: Path
    parts: Sequence[Column]
    index: IntArray = field(repr=False)
    stored: IntArray = field(repr=False)

    @property
    def count(self) -> int:
        return len(self.stored)

    @property
    def kind(self) -> np.dtype[Any]:
        return fewest_bits(np.dtype(table.kind) for part in self.parts for table in part.tables)

    def copy(self, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        before = [part.read() for part in self.parts]
        places = [(part.start, part.stop, part.axis, part.axis + 1) for part in self.parts]
        moved = moved_coordinates(zip(places, before, strict=True), self.stored, points)
        changes = []
        for part in self.parts:
            nodes, first = self.index[part.start : part.stop], 0
            rows = np.flatnonzero(moved[nodes, part.axis])
            for table in part.tables:
                own = rows[(rows >= first) & (rows < first + table.rows)]
                if len(own):
                    changes.append(Change(table, own - first, points[nodes[own], part.axis, None]))
                first += table.rows
        rewritten(self.path, changes, out, progress)


def _text(letters: bytes) -> str:
    return letters.decode("utf-8", "replace").rstrip(" \0")


def _number(digits: bytes) -> int:
    if not digits.isalnum():  # int() takes signs and blanks
        raise _no_number(digits)
    try:
        return int(digits, 16)
    except ValueError:
        raise _no_number(digits) from None


def _no_number(digits: bytes) -> MeshFileError:
    return MeshFileError(f"{digits[:12]!r} is no number in hexadecimal digits; the file is damaged")
