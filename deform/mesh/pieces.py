"""A mesh file that is read some points or cells at a time, and what part of it a mesh in memory is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from sdm_deflect.deform.base import threads
from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.threads import HERE, Progress, Runner, silent

if TYPE_CHECKING:
    from pathlib import Path

    from sdm_deflect.deform.base.states import States

    from .cells import Cells, Patch, Periodic, Zone
    from .polyhedra import SomePolyhedra


class Pieces(Protocol):
    """Points and cells of a mesh file, none of them in memory: a small value, which other processes can be sent."""

    @property
    def source(self) -> str:
        """Path of the file."""

    @property
    def files(self) -> States:
        """The files that are read, as they were at first (`check_unchanged`)."""

    @property
    def points(self) -> int:
        """Number of points."""

    @property
    def blocks(self) -> tuple[tuple[str, int], ...]:
        """Shape and number of the cells of each block; the shape of polyhedra is ``"polyhedron"``."""

    def coordinates(self, start: int, stop: int) -> FloatArray:
        """Return the coordinates (stop - start, 3) of points start to stop - 1."""

    def places(self, nodes: IntArray) -> FloatArray:
        """Return the coordinates (K, 3) of points in any order, as often as they are named."""

    def cells_of(self, block: int, start: int, stop: int) -> Cells | SomePolyhedra:
        """Return cells start to stop - 1 of a block, with the mesh's numbers of nodes, counted from 0."""

    def rewrite(
        self, nodes: IntArray, points: FloatArray, out: Path, progress: Progress = silent, runner: Runner = HERE
    ) -> None:
        """Write a copy of the file with sorted nodes (K,) at `points` (K, 3); all other bytes stay.

        `out` appears whole or not at all. Coordinates that did not change keep their bytes.
        """


@dataclass(frozen=True, slots=True, eq=False)
class MeshInPieces:
    """A mesh of which the boundary is in memory, and all else in a file.

    Attributes
    ----------
    name : the file, for messages.
    pieces : points and cells.
    patches, zones, notes, periodic : those of `Mesh`, as reading the whole file gives them.
    """

    name: str
    pieces: Pieces
    patches: tuple[Patch, ...] = field(repr=False)
    zones: tuple[Zone, ...]
    notes: tuple[str, ...] = ()
    periodic: tuple[Periodic, ...] = field(default=(), repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class Whole:
    """The mesh that an excerpt was taken from, which may be larger than memory.

    Parameters
    ----------
    pieces : Its points and cells, in a file.
    nodes : (N,) rising index in it of each point of the excerpt.
    rows : For each block, the rising index in it of each cell of the excerpt.
    orientation, inverted : For each block, those of `TouchedCells`: of all its cells.
    """

    pieces: Pieces
    nodes: IntArray = field(repr=False)
    rows: tuple[IntArray, ...] = field(default=(), repr=False)
    orientation: tuple[float, ...] = ()
    inverted: tuple[int, ...] = ()


def gathered(pieces: Pieces, nodes: IntArray) -> FloatArray:
    """Return the coordinates (K, 3) of sorted nodes, range by range."""
    points = np.empty((len(nodes), 3))
    for start in range(0, pieces.points, threads.LIMITS.points) if len(nodes) else ():
        first, end = np.searchsorted(nodes, (start, start + threads.LIMITS.points))
        if end > first:
            low = int(nodes[first])
            points[first:end] = pieces.coordinates(low, int(nodes[end - 1]) + 1)[nodes[first:end] - low]
    return points
