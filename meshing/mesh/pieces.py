"""A mesh file that is read in pieces, and the whole mesh of a submesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from sdm_deflect.base import threads
from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.threads import HERE, Progress, Runner, silent

if TYPE_CHECKING:
    from pathlib import Path

    from sdm_deflect.base.states import States

    from .cells import Cells, Patch, Periodic, Zone
    from .polyhedra import SomePolyhedra


class Pieces(Protocol):
    """Points and cells that stay in their mesh file; a small value that can be sent to other processes."""

    @property
    def source(self) -> str:
        """Path of the file."""

    @property
    def files(self) -> States:
        """The files that are read, with their states at the beginning (`check_unchanged`)."""

    @property
    def points(self) -> int:
        """Number of points."""

    @property
    def blocks(self) -> tuple[tuple[str, int], ...]:
        """Shape and number of cells of each block; the shape of polyhedra is ``"polyhedron"``."""

    def coordinates(self, start: int, stop: int) -> FloatArray:
        """Return the coordinates (stop - start, 3) of points start to stop - 1."""

    def places(self, nodes: IntArray) -> FloatArray:
        """Return the coordinates (K, 3) of nodes (K,) in any order."""

    def cells_of(self, block: int, start: int, stop: int) -> Cells | SomePolyhedra:
        """Return cells start to stop - 1 of a block; nodes have the mesh's indices, counted from 0."""

    def rewrite(
        self, nodes: IntArray, points: FloatArray, out: Path, progress: Progress = silent, runner: Runner = HERE
    ) -> None:
        """Write a copy of the file with sorted nodes (K,) at `points` (K, 3); all other bytes stay.

        `out` appears whole or not at all. Coordinates that did not change keep their bytes.
        """


@dataclass(frozen=True, slots=True, eq=False)
class MeshOnDisk:
    """A mesh with its boundary in memory and the rest in a file.

    Attributes
    ----------
    name : name of the file, for messages.
    pieces : points and cells, in the file.
    patches, zones, notes, periodic : as in `Mesh`.
    """

    name: str
    pieces: Pieces
    patches: tuple[Patch, ...] = field(repr=False)
    zones: tuple[Zone, ...]
    notes: tuple[str, ...] = ()
    periodic: tuple[Periodic, ...] = field(default=(), repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class FullMesh:
    """The whole mesh of a submesh, which may be larger than memory.

    Parameters
    ----------
    pieces : Points and cells, in a file.
    nodes : (N,) rising indices of the submesh's points.
    rows : For each block the rising indices of the submesh's cells.
    orientation, inverted : As in `AffectedCells`, of all cells of each block.
    """

    pieces: Pieces
    nodes: IntArray = field(repr=False)
    rows: tuple[IntArray, ...] = field(default=(), repr=False)
    orientation: tuple[float, ...] = ()
    inverted: tuple[int, ...] = ()


def gather_points(pieces: Pieces, nodes: IntArray) -> FloatArray:
    """Return the coordinates (K, 3) of sorted nodes; one range is read at a time."""
    points = np.empty((len(nodes), 3))
    for start in range(0, pieces.points, threads.LIMITS.points) if len(nodes) else ():
        first, end = np.searchsorted(nodes, (start, start + threads.LIMITS.points))
        if end > first:
            low = int(nodes[first])
            points[first:end] = pieces.coordinates(low, int(nodes[end - 1]) + 1)[nodes[first:end] - low]
    return points
