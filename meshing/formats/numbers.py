"""Numbers in text and bytes: found, read, and others put in their place."""

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.meshing.formats.format import MeshFileError

SPACE = 32
"""Bytes up to this one separate numbers."""
COMMENT = re.compile(rb"%[^\r\n]*")
CHUNK = 1 << 18
"""Bytes of text handled at a time."""
ROWS = 1 << 15
"""Lines written at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class NumberLines:
    """Numbers on lines of text; lines without numbers are left out.

    Parameters
    ----------
    values : (T,) all numbers.
    first : (L + 1,) where each line begins in `values`, and where the last one ends.
    begin, end : (T,) the bytes of the text that each number takes.
    """

    values: FloatArray | IntArray = field(repr=False)
    first: IntArray = field(repr=False)
    begin: IntArray = field(repr=False)
    end: IntArray = field(repr=False)

    def __len__(self) -> int:
        return len(self.first) - 1

    def columns(self, of: Any, start: int, stop: int, rows: Any = slice(None)) -> Any:
        """Return numbers start to stop - 1 of lines, (L, stop - start), from `of` (T,); they must have so many."""
        sizes = np.diff(self.first)
        if len(sizes) and (sizes == sizes[0]).all():
            return of.reshape(-1, sizes[0])[rows, start:stop]
        return of[self.first[:-1][rows, None] + np.arange(start, stop)]


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Numbers of a file, and the bytes begin to end - 1 that hold each: three arrays of one shape."""

    values: FloatArray = field(repr=False)
    begin: IntArray = field(repr=False)
    end: IntArray = field(repr=False)

    def replaced(self, data: bytes, values: FloatArray, kind: np.dtype[np.generic] | None) -> bytes:
        """Return the file with other values in its binary numbers of type `kind`, in its text if that is None."""
        changed = self.values != values
        rising = np.argsort(self.begin[changed])
        begin, end, new = (each[changed][rising] for each in (self.begin, self.end, values))
        if kind is None:
            return with_numbers(data, begin, end, new)
        copy = np.frombuffer(data, dtype=np.uint8).copy()
        raw = np.ascontiguousarray(new, dtype=kind).view(np.uint8).reshape(len(new), kind.itemsize)
        for column in range(kind.itemsize):
            copy[begin + column] = raw[:, column]
        return copy.tobytes()


def numbers(text: bytes, kind: type[np.float64 | np.int64]) -> NumberLines:
    """Read the numbers on lines of text (``%`` begins a comment); MeshFileError with the first word that is none."""
    if b"%" in text:
        text = COMMENT.sub(lambda comment: b" " * len(comment[0]), text)
    letters = np.frombuffer(text, dtype=np.uint8)
    solid = np.concatenate([[False], letters > SPACE, [False]])
    edges = np.flatnonzero(solid[1:] != solid[:-1])
    begin, end = edges[0::2], edges[1::2]
    line = np.searchsorted(np.flatnonzero(letters == ord("\n")), begin)
    first = np.append(np.flatnonzero(np.diff(line, prepend=-1)), len(begin))
    values: Any = np.empty(0, kind)
    with suppress(ValueError):
        values = np.fromstring(text, dtype=kind, sep=" ")[: len(begin)]  # blank text reads as one 0
    if len(values) != len(begin):
        raise MeshFileError(f"{_not_number(text, kind)!r} is not a number")
    return NumberLines(values, first, begin, end)


def _not_number(text: bytes, kind: type[np.float64 | np.int64]) -> str:
    for word in text.split():
        try:
            (int if kind is np.int64 else float)(word)
        except ValueError:
            return word[:40].decode("utf-8", "replace")
    return text[:20].decode("utf-8", "replace")


def with_numbers(data: bytes, begin: IntArray, end: IntArray, values: FloatArray) -> bytes:
    """Return text with numbers `values` (K,) in the bytes begin[i] to end[i] - 1, rising; with the digits they need."""
    if not len(values):
        return data
    first, last = begin.tolist(), end.tolist()
    pieces = [b""] * (2 * len(first) + 1)
    pieces[0::2] = [data[a:b] for a, b in zip([0, *last], [*first, len(data)], strict=True)]
    pieces[1::2] = [repr(value).encode() for value in values.tolist()]
    return b"".join(pieces)


def chunks(file: BinaryIO, begin: int, end: int) -> Iterator[tuple[int, bytes]]:
    """Read bytes begin to end - 1 as pieces of whole lines, each with the offset of its first byte."""
    carried, at = [b""], begin
    while at < end:
        file.seek(at)  # another pass may have read in between
        text = file.read(min(CHUNK, end - at))
        if not text:
            break
        at += len(text)
        cut = text.rfind(b"\n") + 1 if at < end else len(text)
        carried.append(text[:cut])
        if cut:
            whole = b"".join(carried)
            yield begin, whole
            begin += len(whole)
            carried.clear()
        carried.append(text[cut:])
    if any(carried):
        yield begin, b"".join(carried)


def copy_text(file: BinaryIO, pieces: Iterator[tuple[int, bytes, Placed]], values: FloatArray, out: BinaryIO) -> None:
    """Copy a file of text with other numbers; only the characters of those that changed differ.

    Parameters
    ----------
    pieces : Rising parts of the text: where each begins, its bytes, and the numbers in it that may change.
    values : The new numbers (K,), in the order of those in the pieces.
    """
    at = done = 0
    for begin, text, placed in pieces:
        copy_bytes(file, at, begin, out)
        new = values[done : done + placed.values.size].reshape(placed.values.shape)
        done += new.size
        changed = placed.values != new
        first, last = (each[changed] for each in (placed.begin, placed.end))
        out.write(with_numbers(text, first, last, new[changed]))
        at = begin + len(text)
    copy_bytes(file, at, file.seek(0, 2), out)


def copy_bytes(file: BinaryIO, begin: int, end: int, out: BinaryIO) -> None:
    """Copy bytes begin to end - 1 of a file."""
    for at in range(begin, end, CHUNK):
        file.seek(at)  # another pass may have read in between
        out.write(file.read(min(CHUNK, end - at)))


def table(prefix: str, rows: FloatArray | IntArray, number: int | None) -> Iterator[str]:
    """Lines of a prefix, the rows' values (floats so that they read back exactly), and the row's number if wanted."""
    words = [prefix] * bool(prefix) + ["%r"] * rows.shape[1] + ["%d"] * (number is not None)
    line = " ".join(words) + "\n"
    width = line.count("%")
    for start in range(0, len(rows), ROWS):
        own = rows[start : start + ROWS]
        values: list[float] = [0] * (width * len(own))
        for i, column in enumerate(own.T):
            values[i::width] = column.tolist()
        if number is not None:
            values[width - 1 :: width] = range(number + start, number + start + len(own))
        yield (line * len(own)) % tuple(values)
