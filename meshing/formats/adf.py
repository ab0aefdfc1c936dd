"""CGNS files in ADF, which came before HDF5: a tree of nodes, each with a label, data and children.

Tables in the file say where the bytes of each node's data are, so that coordinates are replaced where they stand and
every other byte stays. That is why they are read here, and not by way of a conversion to HDF5 and back: that would
make another file of it, and need a program that pip does not install.

A pointer is the number of a block of 4096 bytes and a place in it. Files of version A (``A02011``) hold all numbers of
the tables as hexadecimal text: 8 digits and 4 for a pointer, 8 for a size. Files of version B (``B02012``, of libraries
for large files) hold pointers and sizes of data as binary integers in the file's order of bytes: 8 bytes and 4 for a
pointer, 8 for a size; counts stay text.
Source: ADF User's Guide, and the layout of tables in the ADF core of the CGNS library (``ADF_internals``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import prod
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.meshing.formats.format import MeshFileError

MARK = b"ADF Database"
HEADER, NODE, ENTRY, POINTER, TAG = 186, 246, 44, 12, 4
"""Bytes of the file's header, of a node's, of an entry in the table of its children, of a pointer, of a tag."""
BLOCK = 4096
ORDER: dict[str, Literal[">", "<"]] = {"B": ">", "L": "<"}
"""Order of bytes by the letter in the header; the other letters are of machines that are no more."""
KINDS = {"C1": "i1", "B1": "u1", "I4": "i4", "I8": "i8", "U4": "u4", "U8": "u8", "R4": "f4", "R8": "f8"}
"""NumPy's types by ADF's."""


@dataclass(frozen=True, slots=True)
class NodeData:
    """Data of a node.

    Attributes
    ----------
    name : the node's.
    shape : numbers in each direction, the last one fastest: the reverse of ADF's order.
    dtype : with the file's order of bytes.
    pieces : place and length of each run of bytes that holds them, in order.
    """

    tree: Tree = field(repr=False)
    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    pieces: tuple[tuple[int, int], ...]

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return prod(self.shape)

    def __getitem__(self, everything: tuple[()]) -> NDArray[Any]:
        """Return all numbers; MeshFileError if the file ends before."""
        data = b"".join(self.tree.bytes_at(place, length) for place, length in self.pieces)
        return np.frombuffer(data, self.dtype).reshape(self.shape)


@dataclass(frozen=True, eq=False)
class Node:
    """A node by its header, which begins at `place`; its name is that of the whole path."""

    tree: Tree = field(repr=False)
    name: str
    place: int

    @cached_property
    def _header(self) -> bytes:
        header = self.tree.tagged(self.place, b"NoDe", NODE)
        if not header.endswith(b"TaiL"):
            raise MeshFileError(f"the node {self.name} has no end; the file is damaged")
        return header

    @property
    def label(self) -> str:
        """What the node is."""
        return _text(self._header[36:68])

    @property
    def kind(self) -> str:
        """Type of its data: a key of `KINDS`, MT for none, LK for a link."""
        return _text(self._header[96:128])

    @cached_property
    def children(self) -> dict[str, Node]:
        """The children by name, in the file's order; MeshFileError if their table is damaged."""
        count = _number(self._header[68:76])
        if not count:
            return {}
        place = self.tree.pointer(self._header[84:96])
        table = self.tree.tagged(place, b"SNTb", TAG + POINTER + count * ENTRY)
        found = {}
        for start in range(TAG + POINTER, len(table), ENTRY):
            name = _text(table[start : start + 32])
            place = self.tree.pointer(table[start + 32 : start + ENTRY])
            if name in found or self.tree.parents.setdefault(place, self.place) != self.place:
                raise MeshFileError(f"the node {self.name}/{name} is there twice; the file is damaged")
            found[name] = Node(self.tree, f"{self.name}/{name}", place)
        return found

    @property
    def data(self) -> NodeData | None:
        """Where the data are, None if the node has none; MeshFileError if the file is too short for them."""
        if self.kind == "MT":
            return None
        if self.kind not in KINDS:
            raise MeshFileError(f"{self.name} holds data of type {self.kind!r}, expected one of {', '.join(KINDS)}")
        dimensions = _number(self._header[128:130])
        if not 1 <= dimensions <= 12:
            raise MeshFileError(
                f"{self.name} has data in {dimensions} dimensions, expected 1 to 12; the file is damaged"
            )
        shape = tuple(self.tree.integer(self._header[130 + 8 * i : 138 + 8 * i]) for i in reversed(range(dimensions)))
        kind = np.dtype(KINDS[self.kind]).newbyteorder(self.tree.order)
        return NodeData(self.tree, self.name, shape, kind, self._pieces(prod(shape) * kind.itemsize))

    def _pieces(self, size: int) -> tuple[tuple[int, int], ...]:
        """Place and length of the runs of bytes that hold `size` bytes of data."""
        pointer = self.tree.pointer
        count, place = _number(self._header[226:230]), pointer(self._header[230:242])
        chunks = [(place, pointer(self.tree.tagged(place, b"DaTa", TAG + POINTER)[TAG:]))] if count == 1 else []
        if count > 1:
            table = self.tree.tagged(place, b"DCtb", TAG + POINTER + 2 * count * POINTER)[TAG + POINTER :]
            ends = [pointer(table[at : at + POINTER]) for at in range(0, len(table), POINTER)]
            chunks = list(zip(ends[::2], ends[1::2], strict=True))
        found, left = [], size
        if self.place not in self.tree.known:
            self.tree.known.add(self.place)
            self.tree.held += size
        if self.tree.held > self.tree.size:
            raise MeshFileError(f"{self.name} and other nodes have more data than the file; the file is damaged")
        for begin, end in chunks:
            first = begin + TAG + POINTER
            length = min(left, end - first)
            if length < 0 or first + length > self.tree.size:
                break
            found.append((first, length))
            left -= length
        if left:
            raise MeshFileError(f"{self.name} should have {size} bytes of data; the file is truncated or damaged")
        return tuple(found)


class Tree:
    """An open file and the first of its nodes."""

    def __init__(self, file: BinaryIO) -> None:
        """Read the header; MeshFileError if it is damaged, or of a machine whose numbers are none of today's."""
        self.file, self.size = file, file.seek(0, 2)
        self.parents: dict[int, int] = {}
        self.known: set[int] = set()
        self.held = 0
        header = self.bytes_at(0, HEADER)
        if header[32:36] != b"AdF0" or header[182:186] != b"AdF5":
            raise MeshFileError("the header of this ADF file is damaged")
        letter = header[100:101].decode("latin-1")
        if letter not in ORDER:
            raise MeshFileError(f"its numbers are in the format {letter!r}, expected B or L (IEEE); convert the file")
        self.order, self.binary = ORDER[letter], header[25:26] == b"B"
        if self.size <= (end := self.pointer(header[146:158])):
            raise MeshFileError(f"the file is truncated: it has {self.size} of {end + 1} bytes")
        self.root = Node(self, "", self.pointer(header[134:146]))

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


def _text(letters: bytes) -> str:
    return letters.decode("utf-8", "replace").rstrip(" \0")


def _number(digits: bytes) -> int:
    try:
        return int(digits, 16)
    except ValueError:
        raise MeshFileError(f"{digits[:12]!r} is no number in hexadecimal digits; the file is damaged") from None
