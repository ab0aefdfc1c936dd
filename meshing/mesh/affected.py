"""Affected cells, which a deformation may change, and their quality."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, union
from sdm_deflect.base.compiled import compiled
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import in_chunks

from . import polyhedra
from .cells import Polyhedra, Volume
from .mesh import Mesh
from .quality import Quality, by_shape, check_most, find_orientation, inverted_of, quality_and_inverted
from .standard import parts_of

# Work on the nodes of one cell in kernel pairs, by which `in_chunks` divides it.
WEIGHT = 10
# Quality up to which a cell is flat but for rounding.
FLAT = 1e-6


class CellScores(NamedTuple):
    """Quality (C,) of cells by the measure of their type, and which (C,) are inverted."""

    quality: FloatArray
    inverted: BoolArray

    def with_scores(self, cells: BoolArray, scores: CellScores) -> CellScores:
        """Return the scores with those of the cells in a mask (C,) replaced."""
        quality, inverted = self.quality.copy(), self.inverted.copy()
        quality[cells], inverted[cells] = scores
        return CellScores(quality, inverted)


@dataclass(frozen=True, eq=False)
class AffectedCells:
    """Cells with a node that may move.

    Attributes
    ----------
    mesh : The undeflected mesh.
    rows : For each block the rows of affected cells.
    orientation : For each block 1, or -1 if most of its cells have left-handed nodes.
    inverted : For each block the number of inverted cells of the whole undeflected mesh.
    places : (N, 3) nodes for heights and widths of cells; for a mesh one cell thick those in its plane.
    """

    mesh: Mesh
    rows: tuple[IntArray, ...] = field(repr=False)
    orientation: tuple[float, ...]
    inverted: tuple[int, ...]
    places: FloatArray = field(repr=False)

    @classmethod
    def of(cls, mesh: Mesh, inside: IntArray, places: FloatArray | None = None) -> AffectedCells:
        """Find the cells with a node of `inside` (K,), and judge all cells of the undeflected mesh."""
        moved = np.zeros(len(mesh.points), dtype=bool)
        moved[inside] = True
        rows = tuple(touching(block, moved) for block in mesh.cells)
        places = mesh.points if places is None else places
        if whole := mesh.whole:
            return cls(mesh, rows, whole.orientation, whole.inverted, places)
        orientations = [find_orientation(mesh.points, block) for block in mesh.cells]
        signs, counts = zip(*orientations, strict=True) if orientations else ((), ())
        return cls(mesh, rows, signs, counts, places)

    @classmethod
    def together(cls, parts: Sequence[AffectedCells]) -> AffectedCells:
        """Join the affected cells of several boxes in one mesh."""
        rows = zip(*(part.rows for part in parts), strict=True)
        return parts[0] if len(parts) == 1 else replace(parts[0], rows=tuple(union(*row) for row in rows))

    @property
    def count(self) -> int:
        """Number of affected cells."""
        return sum(len(rows) for rows in self.rows)

    @cached_property
    def before(self) -> CellScores:
        """Scores of the affected cells in the undeflected mesh."""
        return self.scores(self.mesh.points)

    def scores(self, points: FloatArray) -> CellScores:
        """Judge the affected cells with the nodes at `points` (N, 3), block by block."""
        parts = zip(self.mesh.cells, self.rows, self.orientation, strict=True)
        scored = [quality_and_inverted(points, *part) for part in parts if len(part[1])]
        quality = np.concatenate([np.empty(0), *(values for values, _ in scored)])
        return CellScores(quality, np.concatenate([np.empty(0, np.bool_), *(bad for _, bad in scored)]))

    def worst(self, points: FloatArray) -> IntArray:
        """Return the nodes (k,) of the worst cell, with the nodes at `points` (N, 3); none without cells."""
        least, worst = np.inf, np.empty(0, dtype=np.intp)
        for block, rows, orientation in zip(self.mesh.cells, self.rows, self.orientation, strict=True):
            if len(rows):
                quality, _ = quality_and_inverted(points, block, rows, orientation)
                row = int(rows[np.argmin(quality)])
                if quality.min() < least:
                    least = float(quality.min())
                    worst = polyhedra.nodes_of(block, row) if isinstance(block, Polyhedra) else block.nodes[row]
        return worst

    def newly_inverted(self, points: FloatArray) -> BoolArray:
        """Return which affected cells (C,) are newly inverted with the nodes at `points` (N, 3)."""
        parts = zip(self.mesh.cells, self.rows, self.orientation, strict=True)
        inverted = np.concatenate([np.empty(0, np.bool_), *(inverted_of(points, *part) for part in parts)])
        return inverted & ~self.before.inverted if any(self.inverted) else inverted

    def by_shape(self) -> Iterator[tuple[str, BoolArray]]:
        """Yield each type of affected cells, and which cells (C,) have it."""
        masks, start = dict[str, BoolArray](), 0
        for block, rows in zip(self.mesh.cells, self.rows, strict=True):
            for name, _, _, typed in parts_of(block, rows):
                masks.setdefault(name, np.zeros(self.count, dtype=np.bool_))[start : start + len(rows)][typed] = True
            start += len(rows)
        yield from masks.items()

    def least(self, points: FloatArray, quality: Sequence[Quality]) -> tuple[Least, ...]:
        """Return the least quality by type of the cells that were neither inverted nor flat before.

        Parameters
        ----------
        points : (N, 3) coordinates of the nodes.
        quality : Quality there of all affected cells, by type.
        """
        if all(summary.min > FLAT and not summary.inverted for summary in self.quality_before):
            return tuple(Least(summary.min, summary.cells) for summary in quality)
        kept = self._of_good(points).values()
        return tuple(Least(float(values.min(initial=np.inf)), len(values)) for values in kept)

    def count_below(self, points: FloatArray, shape: str, quality: float) -> int:
        """Return how many cells of a type have less than a quality, of those neither inverted nor flat before."""
        return int(np.count_nonzero(self._of_good(points)[shape] < quality))

    def _of_good(self, points: FloatArray) -> dict[str, FloatArray]:
        """Return the quality at points (N, 3) of the cells that were neither inverted nor flat before, by type."""
        good, now = ~self.before.inverted & (self.before.quality > FLAT), self.scores(points).quality
        return {shape: now[good & cells] for shape, cells in self.by_shape()}

    @cached_property
    def quality_before(self) -> tuple[Quality, ...]:
        """Quality of the affected cells in the undeflected mesh, by type."""
        return self.quality(self.mesh.points)

    def quality(self, points: FloatArray) -> tuple[Quality, ...]:
        """Return the quality of the affected cells by type, with the nodes at `points` (N, 3)."""
        parts = zip(self.mesh.cells, self.rows, self.orientation, strict=True)
        return by_shape(points, parts)

    def check(self, allow: bool = False) -> None:
        """Raise InputError if the undeflected mesh has inverted cells, unless they are allowed.

        More than half of the cells may never be inverted (`check_most`).
        """
        check_most(self.mesh.name, sum(self.inverted), sum(self.mesh.cell_counts))
        for block, size, count in zip(self.mesh.cells, self.mesh.cell_counts, self.inverted, strict=True):
            if count and not allow:
                shape = "polyhedra" if isinstance(block, Polyhedra) else f"cells ({block.shape})"
                raise InputError(
                    f"{self.mesh.name}: {count} of {size} {shape} are inverted in the file already; mend the "
                    "mesh, or take it as it is (allow_inverted)"
                )


class Least(NamedTuple):
    """Least quality and number of some cells; infinite quality without cells."""

    quality: float
    cells: int


def touching(block: Volume, moved: NDArray[np.bool_]) -> IntArray:
    """Return the rows of cells with a node in the mask `moved` (N,)."""
    if isinstance(block, Polyhedra):
        return polyhedra.touching(block, moved)
    mask = np.empty(len(block), dtype=np.bool_)

    def chunk(start: int, stop: int) -> None:
        _have_one(block.nodes[start:stop], moved, mask[start:stop])

    in_chunks(chunk, len(block), WEIGHT)
    return np.flatnonzero(mask)


@compiled
def _have_one(
    nodes: IntArray, moved: NDArray[np.bool_], mask: NDArray[np.bool_]
) -> None:  # pragma: no cover - machine code
    """Find the cells with a node (R, k) in the mask `moved` (N,)."""
    for i in range(len(nodes)):
        any_moved = False
        for k in range(nodes.shape[1]):
            any_moved |= moved[nodes[i, k]]
        mask[i] = any_moved
