"""Where the coordinates of a mesh stand in its file, and copies of the file with other coordinates; all else stays."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.files import fresh
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.mesh.precision import DOUBLE, fewest_bits

from .numbers import Placed, copy_text
from .table_pieces import TablePieces


class Coordinates(Protocol):
    """Coordinates (N, 3) in a file, and their type of number; of several types the one with the fewest bits."""

    @property
    def count(self) -> int:
        """Number of nodes N."""
        ...

    @property
    def kind(self) -> np.dtype[Any]:
        """Type of the numbers; text has all digits that they need."""
        ...

    def copy(self, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """Write a copy of the file with coordinates `points` (N, 3), completely or not at all.

        Coordinates that did not change keep their bytes. MeshFileError or ValueError for coordinates that the file's
        numbers cannot hold.
        """


# Points of a file whose coordinates stand together, start to stop - 1, and which of the three, first to end - 1.
Places = tuple[int, int, int, int]


def moved_coordinates(parts: Iterable[tuple[Places, NDArray[Any]]], stored: IntArray, points: FloatArray) -> BoolArray:
    """Return which coordinates (N, 3) differ from those of the first stored point (N,) of each node.

    Each part has its places, and the coordinates in the file. Where several stored points are one node, all move if the
    first one does.
    """
    moved = np.zeros(points.shape, dtype=np.bool_)
    for (start, stop, first, end), values in parts:
        nodes = np.flatnonzero((stored >= start) & (stored < stop))
        own = values.reshape(stop - start, -1)[stored[nodes] - start]
        moved[nodes, first:end] = own != points[nodes, first:end]
    return moved


@dataclass(frozen=True, slots=True)
class ByteColumns:
    """Coordinates in rows of bytes at equal distances."""

    pieces: TablePieces

    @property
    def count(self) -> int:
        return self.pieces.points

    @property
    def kind(self) -> np.dtype[Any]:
        return fewest_bits(np.dtype(part.table.kind) for part in self.pieces.ranges)

    def copy(self, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        self.pieces.rewrite(np.arange(len(points)), points, out, progress)


@dataclass(frozen=True, slots=True)
class Words:
    """Coordinates that stand as words in a text; changed ones are written with as many digits as they need.

    Attributes
    ----------
    path : the file.
    count : number of nodes.
    read : function that reads an open file piece by piece, and reports the fraction read. It yields the place where a
        piece begins, its text, and the coordinates in it, node after node.
    dimension : number of coordinates of each node.
    """

    path: Path
    count: int
    read: Callable[[BinaryIO, Callable[[float], None]], Iterator[tuple[int, bytes, Placed]]]
    dimension: int = 3

    @property
    def kind(self) -> np.dtype[Any]:
        return DOUBLE

    def copy(self, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        report = partial(progress, f"writing {out.name}")
        with fresh(out, self.path) as beside, about(self.path), self.path.open("rb") as file, beside.open("wb") as copy:
            copy_text(file, self.read(file, report), points[:, : self.dimension].ravel(), copy)
