"""An open SU2 file: its sections, and their lines of numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.su2_text import Lines, Section, chunks, numbers, sections
from sdm_deflect.meshing.mesh import IntArray


@dataclass(frozen=True, slots=True)
class Su2File:
    """An open file and where its sections lie; `report` is told the fraction of the file that has been read."""

    file: BinaryIO
    sections: tuple[Section, ...]
    report: Callable[[float], None]

    @classmethod
    def opened(cls, file: BinaryIO, report: Callable[[float], None]) -> Su2File:
        """Find the sections of a file.

        Raises
        ------
        MeshFileError
            If it is no SU2 mesh, or not a three-dimensional one.
        """
        file.seek(0)
        if b"\0" in file.read(4096):
            raise MeshFileError("this is a binary file; an SU2 mesh is text")
        found = tuple(sections(file))
        dimensions = [section for section in found if section.keyword == "NDIME"]
        if not dimensions:
            raise MeshFileError("no NDIME= line; this is not an SU2 mesh, or it is truncated")
        if any(section.count != 3 for section in dimensions):
            raise MeshFileError("the mesh is two-dimensional (NDIME= 2); only meshes in three dimensions can be read")
        return cls(file, found, report)

    def lines(self, section: Section, kind: type[np.float64 | np.int64]) -> Iterator[tuple[bytes, Lines]]:
        """Yield the text of a section and the numbers on its lines, some at a time.

        Raises
        ------
        MeshFileError
            At the end, if there are other than `section.count` lines of numbers.
        """
        total = 0
        for begin, text in chunks(self.file, section.begin, section.end):
            lines = numbers(text, kind)
            total += len(lines)
            yield text, lines
            self.report((begin + len(text)) / self.sections[-1].end)
        if total != section.count:
            cause = "truncated or damaged" if total < section.count else "damaged"
            raise MeshFileError(
                f"{section.keyword}= {section.count}, but {total} lines of numbers follow; the file is {cause}"
            )


def coordinates(lines: Lines) -> IntArray:
    """Index (L, 3) in `lines.values` of the coordinates on each line: three numbers, or four with the point's own.

    Raises
    ------
    MeshFileError
        If a line has another number of numbers.
    """
    sizes = np.diff(lines.first)
    bad = int(np.count_nonzero((sizes != 3) & (sizes != 4)))
    if bad:
        raise MeshFileError(f"{bad} lines of points have other than 3 coordinates")
    index: IntArray = lines.first[:-1, None] + np.arange(3)
    return index
