"""Text of an SU2 file: where its sections lie, and the numbers on their lines."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import numpy as np

from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.mesh import FloatArray, IntArray

CHUNK = 1 << 22
"""Bytes of text handled at a time."""
SPACE = 32
"""Bytes up to this one separate numbers."""
COMMENT = re.compile(rb"%[^\r\n]*")


@dataclass(frozen=True, slots=True)
class Section:
    """A line ``KEYWORD= value``, and the lines after it up to the next one: bytes begin to end - 1."""

    keyword: str
    value: str
    begin: int
    end: int

    @property
    def count(self) -> int:
        """The first number of the value, as in ``NPOIN= 14 14``; MeshFileError if there is none."""
        first = self.value.split()[:1]
        if not first or not first[0].isdecimal():
            raise MeshFileError(f"{self.keyword}= {self.value} is not a count")
        return int(first[0])


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Numbers on lines of text; lines without numbers are left out.

    Parameters
    ----------
    values
        (T,) all numbers.
    first
        (L + 1,) where each line begins in `values`, and where the last one ends.
    begin, end
        (T,) the bytes of the text that each number takes.
    """

    values: FloatArray | IntArray = field(repr=False)
    first: IntArray = field(repr=False)
    begin: IntArray = field(repr=False)
    end: IntArray = field(repr=False)

    def __len__(self) -> int:
        return len(self.first) - 1


def sections(file: BinaryIO) -> list[Section]:
    """Find all keyword lines of a file, in its order."""
    found: list[tuple[str, str, int, int]] = []
    size = file.seek(0, 2)
    for start, text in chunks(file, 0, size):
        found += [(keyword, value, start + line, start + after) for keyword, value, line, after in _keywords(text)]
    ends = [*(line for _, _, line, _ in found[1:]), size]
    return [Section(keyword, value, begin, end) for (keyword, value, _, begin), end in zip(found, ends, strict=True)]


def _keywords(text: bytes) -> Iterator[tuple[str, str, int, int]]:
    at = text.find(b"=")
    while at >= 0:
        begin = text.rfind(b"\n", 0, at) + 1
        end = text.find(b"\n", at) + 1 or len(text)
        keyword, equals, value = COMMENT.sub(b"", text[begin:end]).decode("utf-8", "replace").partition("=")
        if equals:
            yield keyword.strip().upper(), value.strip(), begin, end
        at = text.find(b"=", end)


def chunks(file: BinaryIO, begin: int, end: int) -> Iterator[tuple[int, bytes]]:
    """Read bytes begin to end - 1 as pieces of whole lines, each with the offset of its first byte."""
    file.seek(begin)
    carried, left = b"", end - begin
    while left > 0:
        text = file.read(min(CHUNK, left))
        if not text:
            break
        left -= len(text)
        text = carried + text
        cut = text.rfind(b"\n") + 1 if left else len(text)
        carried = text[cut:]
        if cut:
            yield begin, text[:cut]
            begin += cut
    if carried:
        yield begin, carried


def numbers(text: bytes, kind: type[np.float64 | np.int64]) -> Lines:
    """Read the numbers on lines of text; ``%`` begins a comment.

    Raises
    ------
    MeshFileError
        With the first piece of text that is no number.
    """
    if b"%" in text:
        text = COMMENT.sub(lambda comment: b" " * len(comment[0]), text)
    letters = np.frombuffer(text, dtype=np.uint8)
    solid = np.concatenate([[False], letters > SPACE, [False]])
    edges = np.flatnonzero(solid[1:] != solid[:-1])
    begin, end = edges[0::2], edges[1::2]
    line = np.searchsorted(np.flatnonzero(letters == ord("\n")), begin)
    first = np.append(np.flatnonzero(np.diff(line, prepend=-1)), len(begin))
    try:
        values: Any = np.fromstring(text, dtype=kind, sep=" ")[: len(begin)]  # blank text reads as one 0
    except ValueError:
        raise MeshFileError(f"{_not_number(text, kind)!r} is not a number") from None
    if len(values) != len(begin):
        raise MeshFileError(f"{_not_number(text, kind)!r} is not a number")
    return Lines(values, first, begin, end)


def _not_number(text: bytes, kind: type[np.float64 | np.int64]) -> str:
    for word in text.split():
        try:
            (int if kind is np.int64 else float)(word)
        except ValueError:
            return word.decode("utf-8", "replace")
    return text[:20].decode("utf-8", "replace")
