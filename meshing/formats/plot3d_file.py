"""PLOT3D grid files: how one is stored, its blocks and their coordinates.

The number of blocks if there are several, the size of each, then for each block all x, all y, all z and perhaps all
IBLANK, the first index fastest. Source: Plot3d File Format for Grid and Solution Files, NASA Glenn (NPARC Alliance CFD
Verification and Validation); the User's Manual is NASA TM 101067.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import accumulate, product
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.meshing.formats.cgns_blocks import Size
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.numbers import NumberLines, Placed, chunks, numbers
from sdm_deflect.meshing.formats.rewriting import Change
from sdm_deflect.meshing.formats.tables import FileTable
from sdm_deflect.meshing.formats.ugrid_file import EXACT

MARKER = 4
"""Bytes of a Fortran record's length, before and after it, and of a whole number."""
HEAD = 4096
"""Bytes by which text is told from binary."""
DIMENSIONS = (3, 2)
EXPONENT = re.compile(rb"[eEdD]")
LIKE_FORTRAN = bytes.maketrans(b"Dd,", b"Ee ")
"""Exponents and separators that Fortran has beside C's."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How a file is stored.

    Parameters
    ----------
    sizes : Points of each block along each axis.
    counted : Whether the number of blocks stands first.
    blanked : Whether each block has a whole number IBLANK for each point.
    real : Type of coordinates; None for text.
    records : Whether the count, the sizes and each block are one Fortran record each.
    """

    sizes: tuple[Size, ...]
    counted: bool
    blanked: bool
    real: np.dtype[Any] | None = None
    records: bool = False

    @property
    def axes(self) -> int:
        """Number of coordinates of a point."""
        return len(self.sizes[0])

    @property
    def lengths(self) -> list[int]:
        """Length of each record, or of what would be one, in bytes; in numbers for text."""
        whole, real = (MARKER, self.real.itemsize) if self.real else (1, 1)
        head = [whole] * self.counted + [whole * self.axes * len(self.sizes)]
        return head + [prod(size) * (self.axes * real + whole * self.blanked) for size in self.sizes]

    @property
    def begins(self) -> list[int]:
        """Where the coordinates of each block begin, and where the file ends, in bytes or numbers."""
        around = 2 * MARKER * self.records
        ends = list(accumulate((length + around for length in self.lengths), initial=0))
        return [*(begin + around // 2 for begin in ends[1 + self.counted : -1]), ends[-1]]

    def __str__(self) -> str:
        kind = "text" if self.real is None else f"{8 * self.real.itemsize}-bit {ORDERS[self.real.str[0]]}"
        words = [kind] + ["in Fortran records"] * self.records + ["with IBLANK"] * self.blanked
        what = f"{len(self.sizes)} blocks" if self.counted else "one block"
        return f"{what} of {self.axes} dimensions ({', '.join(words)})"


ORDERS = {"<": "little-endian", ">": "big-endian", "|": ""}


@dataclass(frozen=True, slots=True, eq=False)
class Plot3dFile:
    """An open file and its layout; `values` are all numbers of a text."""

    file: BinaryIO = field(repr=False)
    layout: Layout
    report: Callable[[float], None] = field(repr=False)
    values: FloatArray | None = field(default=None, repr=False)

    @classmethod
    def opened(cls, file: BinaryIO, report: Callable[[float], None]) -> Plot3dFile:
        """Find the one layout that fits the counts and the length of a file.

        MeshFileError if none does, or more than one, or the blocks have no volume.
        """
        file.seek(0)
        binary = b"\0" in file.read(HEAD)
        values = None if binary else _read_text(file, report)
        fit = list(_binary_layouts(file) if values is None else _text_layouts(values))
        if not fit:
            raise MeshFileError(
                "its length fits no sizes of blocks that its first numbers tell; it is truncated, damaged, or no grid "
                "of PLOT3D"
            )
        if len(fit) > 1:
            listed = "; ".join(map(str, fit))
            raise MeshFileError(f"it could be each of these: {listed}; write it with another number of points")
        found = fit[0]
        opened = cls(file, found, report, values)
        for number, size in enumerate(opened.sizes, 1):
            if min(size) < 2:
                sides = " x ".join(map(str, size))
                raise MeshFileError(f"block {number} of {sides} points has no cells; 2 are needed along each axis")
        return opened

    @property
    def sizes(self) -> tuple[Size, ...]:
        """Points of each block along each axis; along two if the grid has one layer of points."""
        flat = self.layout.axes == 3 and all(size[2] == 1 for size in self.layout.sizes)
        return tuple(size[:2] for size in self.layout.sizes) if flat else self.layout.sizes

    def points(self) -> FloatArray:
        """Return the coordinates (F, 3) of all points, block after block; z is 0 where the file has none."""
        found = np.zeros((sum(map(prod, self.layout.sizes)), 3))
        start = 0
        for begin, size in zip(self.layout.begins, self.layout.sizes, strict=False):
            rows = found[start : start + prod(size)]
            for axis in range(self.layout.axes):
                with np.errstate(invalid="ignore"):  # `Mesh` refuses coordinates that are not finite
                    rows[:, axis] = self._stored(begin, axis, len(rows))
            start += len(rows)
            self.report(start / len(found))
        return found

    def changes(self, path: Path, points: FloatArray, changed: BoolArray) -> Iterator[Change]:
        """Yield the changes of a binary file that put coordinates of `points` (F, 3) where `changed` (F, 3) is true."""
        start = 0
        for begin, size in zip(self.layout.begins, self.layout.sizes, strict=False):
            count = prod(size)
            for axis in range(self.layout.axes):
                rows = np.flatnonzero(changed[start : start + count, axis])
                table = FileTable(path, begin + axis * count * self._real.itemsize, self._real.str, count)
                yield Change(table, rows, points[start + rows, axis, None])
            start += count

    def moved(self, points: FloatArray, changed: BoolArray) -> FloatArray:
        """Return all numbers of a text with coordinates of `points` (F, 3) where `changed` (F, 3) is true."""
        assert self.values is not None
        moved, start = self.values.copy(), 0
        for begin, size in zip(self.layout.begins, self.layout.sizes, strict=False):
            count = prod(size)
            for axis in range(self.layout.axes):
                rows = np.flatnonzero(changed[start : start + count, axis])
                moved[begin + axis * count + rows] = points[start + rows, axis]
            start += count
        return moved

    def placed(self) -> Iterator[tuple[int, bytes, Placed]]:
        """Yield where a piece of text begins, the piece, and its numbers."""
        done = 0
        for at, text, lines in _words(self.file):
            yield at, text, Placed(np.asarray(lines.values, np.float64), lines.begin, lines.end)
            done += len(text)
            self.report(done / self.file.seek(0, 2))

    @property
    def _real(self) -> np.dtype[Any]:
        assert self.layout.real is not None
        return self.layout.real

    def _stored(self, begin: int, axis: int, count: int) -> Any:
        """One coordinate (count,) of the points of a block, as it is stored."""
        if self.values is not None:
            return self.values[begin + axis * count :][:count]
        self.file.seek(begin + axis * count * self._real.itemsize)
        return np.frombuffer(self.file.read(count * self._real.itemsize), self._real)


def kind_of(file: BinaryIO) -> list[np.dtype[Any]]:
    """Return the type of the coordinates of a binary file; nothing for text."""
    file.seek(0)
    binary = b"\0" in file.read(HEAD)
    layout = Plot3dFile.opened(file, lambda _: None).layout if binary else None
    return [layout.real] if layout and layout.real else []


def styled(word: bytes, value: float) -> bytes:
    """Return a number with all digits that it needs, with an exponent where a word has one, and as wide if it fits."""
    found = EXPONENT.search(word)
    text = np.format_float_scientific(value, exp_digits=2).encode().replace(b"e", found[0]) if found else b"%r" % value
    return text.rjust(len(word))


def _words(file: BinaryIO) -> Iterator[tuple[int, bytes, NumberLines]]:
    """Yield where a piece of text begins, the piece, and its numbers."""
    for at, text in chunks(file, 0, file.seek(0, 2)):
        if b"*" in text:
            raise MeshFileError("numbers are repeated by counts such as 3*0.5; write the grid with a format of its own")
        yield at, text, numbers(text.translate(LIKE_FORTRAN), np.float64)


def _read_text(file: BinaryIO, report: Callable[[float], None]) -> FloatArray:
    found = [np.empty(0)]
    size = file.seek(0, 2)
    for _, _, lines in _words(file):
        found.append(np.asarray(lines.values, dtype=np.float64))
        report(file.tell() / max(size, 1))
    return np.concatenate(found)


def _text_layouts(values: FloatArray) -> Iterator[Layout]:
    for counted, axes in product((True, False), DIMENSIONS):
        blocks = int(_whole(values[:1]).max(initial=-1)) if counted else 1
        sizes = _sizes(_whole(values[counted:][: axes * blocks]), axes, blocks, len(values)) if blocks > 0 else ()
        for blanked in (False, True) if sizes else ():
            layout = Layout(sizes, counted, blanked)
            if layout.begins[-1] == len(values):
                yield layout


def _whole(values: FloatArray) -> IntArray:
    """Whole numbers; -1 for others."""
    fits = (np.abs(values) < EXACT) & (values == np.rint(values))
    return np.where(fits, values, -1.0).astype(np.intp)


def _binary_layouts(file: BinaryIO) -> Iterator[Layout]:
    size = file.seek(0, 2)
    for order, records, counted, axes in product("<>", (False, True), (True, False), DIMENSIONS):
        sizes = _binary_sizes(file, np.dtype(f"{order}i4"), records, counted, axes, size)
        for real, blanked in product(("f4", "f8"), (False, True)) if sizes else ():
            layout = Layout(sizes, counted, blanked, np.dtype(f"{order}{real}"), records)
            if layout.begins[-1] == size and _has_markers(file, layout):
                yield layout


def _binary_sizes(
    file: BinaryIO, whole: np.dtype[Any], records: bool, counted: bool, axes: int, size: int
) -> tuple[Size, ...]:
    """Sizes of the blocks as one way of storing them has it; none if they are no sizes."""
    at, blocks = MARKER * records, 1
    if counted:
        blocks = int(_ints(file, at, whole, 1).max(initial=-1))
        at += whole.itemsize + 2 * MARKER * records
    if not 1 <= blocks <= size // (axes * whole.itemsize):
        return ()
    return _sizes(_ints(file, at, whole, axes * blocks), axes, blocks, size)


def _ints(file: BinaryIO, at: int, whole: np.dtype[Any], count: int) -> IntArray:
    file.seek(at)
    data = file.read(count * whole.itemsize)
    return np.frombuffer(data[: len(data) - len(data) % whole.itemsize], whole).astype(np.intp)


def _sizes(values: IntArray, axes: int, blocks: int, most: int) -> tuple[Size, ...]:
    """Sizes of so many blocks with no more than `most` points; none if the numbers are no such sizes."""
    if len(values) < axes * blocks or values.min() < 1:
        return ()
    rows = values.reshape(blocks, axes)
    fits = rows.astype(np.float64).prod(axis=1).sum() <= most and (axes > 2 or rows.min() > 1)  # curves are no grids
    return tuple(map(tuple, rows.tolist())) if fits else ()


def _has_markers(file: BinaryIO, layout: Layout) -> bool:
    """Whether the length of each record stands before and after it."""
    if not layout.records:
        return True
    assert layout.real is not None
    whole = np.dtype("i4").newbyteorder(layout.real.byteorder)
    at = 0
    for length in layout.lengths:
        around = [*_ints(file, at, whole, 1), *_ints(file, at + MARKER + length, whole, 1)]
        if around != [length, length]:
            return False
        at += length + 2 * MARKER
    return True
