"""NASA's neutral map files (.nmf): which faces of blocks are boundaries, and which meet.

Source: The Neutral Map File, W. T. Jones, NASA Langley (GEOLAB); FUN3D Manual, PLOT3D Grids.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from sdm_deflect.deform.base.arrays import IntArray
from sdm_deflect.meshing.formats.cgns_blocks import BlockFace, Size, points_in
from sdm_deflect.meshing.formats.format import MeshFileError, about

SUFFIX = ".nmf"
LONGEST = 1 << 24
"""Bytes of a map."""
FACES = {1: (2, False), 2: (2, True), 3: (0, False), 4: (0, True), 5: (1, False), 6: (1, True)}
"""Axis along which a face has one number, and whether that is its last one; the two other axes follow it in turn."""
ONE_TO_ONE, PATCHED, UNPROCESSED = "one_to_one", "patched", "unprocessed"
WITHOUT = (PATCHED, "collapsed", "pole_dir1", "pole_dir2")
"""Kinds of faces that are on no patch: those that only touch others, and those without an area."""
COMMENT = re.compile(r"[#!](.*)")
ENTRY = re.compile(r"""\s*('[^']*'|"[^"]*"|[^\s\d]\S*)((?:\s+[+-]?\d{1,9}){6,12})\s*(\w*)\s*$""")
NUMBER = re.compile(r"\d{1,9}")


@dataclass(frozen=True, slots=True)
class IndexRange:
    """Points `first` to `last` (counted from 0) of a face of a block; along the face's own axis they are the same.

    They have three axes even where the block has two, which is one layer then.
    """

    block: int
    first: tuple[int, ...]
    last: tuple[int, ...]
    axis: int

    def points(self, size: Size) -> IntArray:
        """Return the numbers (K,) of its points in the block."""
        return points_in(self.first[: len(size)], self.last[: len(size)], size)

    def plane(self, size: Size) -> BlockFace:
        """Return its faces."""
        others = [axis for axis in range(len(size)) if axis != self.axis]
        low = [min(self.first[axis], self.last[axis]) for axis in others]
        high = [max(self.first[axis], self.last[axis]) - 1 for axis in others]
        return BlockFace(
            self.axis, self.first[self.axis], points_in(low, high, tuple(size[axis] - 1 for axis in others))
        )


@dataclass(frozen=True, slots=True)
class MapEntry:
    """What one line says.

    Parameters
    ----------
    kind : The type in lower case with underscores, such as ``"one_to_one"``.
    name : The comment at the end of the line, or the type as it is written.
    ranges : One for a boundary, two for faces that meet.
    """

    kind: str
    name: str
    ranges: tuple[IndexRange, ...]


def map_of(path: Path, sizes: Sequence[Size]) -> tuple[MapEntry, ...]:
    """Return what the map beside a grid says; nothing if there is none.

    The map of ``wing.p3d`` and ``wing-deflected.p3d`` is ``wing.nmf``: the file whose name is the longest beginning of
    the grid's. MeshFileError if it is damaged, or its blocks are not of these sizes.
    """
    beside = next(maps(path), None)
    if beside is None:
        return ()
    with about(beside):
        if beside.stat().st_size > LONGEST:
            raise MeshFileError(f"has more than {LONGEST} bytes; it is no neutral map file")
        return tuple(entries(beside.read_text("utf-8", "replace"), sizes))


def maps(path: Path) -> Iterator[Path]:
    """Yield the files beside a grid that may be its map, those of the longest names first."""
    parts = re.split(r"(?=[^0-9A-Za-z])", path.name)
    stems = ("".join(parts[:i]) for i in range(len(parts), 0, -1))
    yield from (one for one in (path.with_name(stem + SUFFIX) for stem in stems if stem) if one.is_file())


def entries(text: str, sizes: Sequence[Size]) -> Iterator[MapEntry]:
    """Yield what the lines of a map say; MeshFileError for wrong ones."""
    head: list[int] = []
    for number, line in enumerate(text.splitlines(), 1):
        comment = COMMENT.search(line)
        own = COMMENT.sub("", line).strip()
        words = own.split()
        if len(head) < 1 + 4 * len(sizes) and words and all(map(NUMBER.fullmatch, words)):
            head += map(int, words)
            continue
        if own:
            _check_head(head, sizes)
            try:
                yield _entry(own, comment[1].strip() if comment else "", sizes)
            except MeshFileError as error:
                raise MeshFileError(f"line {number}: {error}") from error
    _check_head(head, sizes)


def _check_head(head: Sequence[int], sizes: Sequence[Size]) -> None:
    expected = [len(sizes)]
    for number, size in enumerate(sizes, 1):
        expected += [number, *size, *[1] * (3 - len(size))]
    if list(head) != expected:
        wanted, given = (" ".join(map(str, numbers[:9])) + " ..." * (len(numbers) > 9) for numbers in (expected, head))
        raise MeshFileError(
            f"should begin with {wanted}, the number and the sizes of the grid's blocks, but has {given or 'none'}; it "
            "is of another grid, or damaged"
        )


def _entry(line: str, comment: str, sizes: Sequence[Size]) -> MapEntry:
    found = ENTRY.match(line)
    numbers = [int(word) for word in found[2].split()] if found else []
    if not found or len(numbers) not in (6, 12):
        raise MeshFileError(f"{line[:60]!r} is no type with the block, the face and the range of one face or of two")
    name = found[1].strip("'\" ")
    kind = re.sub(r"[-_ ]+", "_", name.lower())
    ranges = tuple(_range(numbers[i : i + 6], sizes) for i in range(0, len(numbers), 6))
    if (kind in (ONE_TO_ONE, PATCHED)) != (len(ranges) == 2):
        raise MeshFileError(f"{name} has {len(ranges)} faces; interfaces have two, boundaries one")
    return MapEntry(kind, comment or name or kind, ranges)


def _range(numbers: Sequence[int], sizes: Sequence[Size]) -> IndexRange:
    block, face, *ends = numbers
    if not 1 <= block <= len(sizes) or face not in FACES:
        raise MeshFileError(f"there is no face {face} of block {block}; there are 6 of {len(sizes)} blocks")
    size, (axis, far) = (*sizes[block - 1], 1)[:3], FACES[face]
    first, last = [0, 0, 0], [0, 0, 0]
    first[axis] = last[axis] = size[axis] - 1 if far else 0
    for other, begin, end in (((axis + 1) % 3, *ends[:2]), ((axis + 2) % 3, *ends[2:])):
        long_enough = abs(end - begin) + 1 >= min(2, size[other])
        if min(begin, end) < 1 or max(begin, end) > size[other] or not long_enough:
            raise MeshFileError(f"face {face} of block {block} has points 1 to {size[other]}, but not {begin} to {end}")
        first[other], last[other] = begin - 1, end - 1
    return IndexRange(block - 1, tuple(first), tuple(last), axis)
