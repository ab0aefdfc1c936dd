"""Numbers in the sections of Gmsh's files, one after another, in text or binary."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.su2_text import Lines, numbers
from sdm_deflect.meshing.mesh import FloatArray, IntArray

REAL = np.dtype("f8")


@dataclass(frozen=True, slots=True, eq=False)
class Reals:
    """Numbers (K,) and the bytes begin to end - 1 of the file that each takes."""

    values: FloatArray = field(repr=False)
    begin: IntArray = field(repr=False)
    end: IntArray = field(repr=False)


class TextCursor:
    """Numbers of a section in text, one after another."""

    def __init__(self, content: bytes, offset: int, name: str) -> None:
        self.words: Lines = numbers(content, np.float64)
        self.offset, self.name, self.at = offset, name, 0

    def reals(self, count: int) -> Reals:
        """The next `count` numbers."""
        own = slice(self.at, self.at + count)
        self.at += count
        if self.at > len(self.words.values):
            raise _ended(self.name)
        words = self.words
        values = np.asarray(words.values[own], dtype=np.float64)
        return Reals(values, self.offset + words.begin[own], self.offset + words.end[own])

    def ints(self, count: int) -> IntArray:
        """The next `count` integers."""
        with np.errstate(invalid="ignore"):
            return self.reals(count).values.astype(np.intp)

    sizes = ints


class ByteCursor:
    """Numbers of a section in binary, one after another."""

    def __init__(self, content: bytes, offset: int, name: str, order: str) -> None:
        self.content, self.offset, self.name, self.order, self.at = content, offset, name, order, 0

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

    def reals(self, count: int) -> Reals:
        """The next `count` numbers."""
        begin = self.offset + self.at + REAL.itemsize * np.arange(count)
        return Reals(self.raw(count, "f8").astype(np.float64), begin, begin + REAL.itemsize)

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
