"""What a repair is to bring about, and what it did: how good cells are, and were before the deflection."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.mesh import polyhedra
from sdm_deflect.deform.mesh.cells import Polyhedra
from sdm_deflect.deform.mesh.quality import Quality
from sdm_deflect.deform.mesh.touched import CellScores, TouchedCells
from sdm_deflect.deform.repair.freedom import FreeNodes

WORST = 1e-3
"""Least quality that cells are weighted by."""
CARE = 0.95
"""Share of its quality that a good cell shall keep while others are mended."""
LOST = 0.005
"""How far the mean quality of all touched cells of a type, and what 99 % of them exceed, may fall for the worst."""


@dataclass(frozen=True, slots=True, eq=False)
class QualityGoal:
    """What some of the touched cells should be like.

    Attributes
    ----------
    touched : the cells.
    floor : (C,) least quality, before the deflection, of the good cells of each one's type; 0 where the cell itself was
        no better, and -inf where it was inverted already or no node can move: nothing is asked of such cells.
    weights : (C,) of the cells' energies, by which cells of all types come to their floors at once. The energy of a
        corner is at least the inverse square of its scaled Jacobian over that of its target, that of a tetrahedron the
        inverse cube of its mean ratio.
    """

    touched: TouchedCells = field(repr=False)
    floor: FloatArray = field(repr=False)
    weights: FloatArray = field(repr=False)

    @classmethod
    def of(cls, touched: TouchedCells, freedom: FreeNodes) -> QualityGoal:
        """Ask of the cells with a node that may move the least quality that their type had."""
        movable = np.zeros(len(touched.mesh.points), dtype=np.bool_)
        movable[freedom.nodes] = True
        quality, inverted = touched.before
        floor, weights = np.full(touched.count, -np.inf), np.empty(touched.count)
        free = np.concatenate([np.empty(0, np.bool_), *_with_any(touched, movable)])
        for name, own in touched.by_shape():
            least = float(quality[own & ~inverted & (quality > 0.0)].min(initial=1.0))
            floor[own & free & ~inverted] = least
            least = max(least, WORST)
            weights[own] = least**3 if name == "tetra" else (least / np.maximum(quality[own], least)) ** 2
        floor[(quality <= 0.0) & (floor > 0.0)] = 0.0
        return cls(touched, floor, weights)

    def among(self, cells: BoolArray) -> QualityGoal:
        """Return the same for some of the cells, a mask (C,)."""
        ends = np.cumsum([0, *(len(rows) for rows in self.touched.rows)])
        rows = tuple(own[cells[a:b]] for own, a, b in zip(self.touched.rows, ends, ends[1:], strict=False))
        return QualityGoal(replace(self.touched, rows=rows), self.floor[cells], self.weights[cells])

    def spread(self, found: CellScores) -> FloatArray:
        """Return the quality (T, 2) that 99 % of the cells of each type exceed, and its mean."""
        by_type = [found.quality[own] for _, own in self.touched.by_shape()]
        return np.array([[np.percentile(quality, 1.0), quality.mean()] for quality in by_type])

    def keeps(self, found: CellScores, spread: FloatArray | None) -> bool:
        """Return whether cells keep a spread (T, 2), but for `LOST`; of none, that they do."""
        return spread is None or bool((self.spread(found) >= spread - LOST).all())

    def weighted(self, found: CellScores, careful: bool) -> QualityGoal:
        """Return the same, if careful with weights by which each good cell shall keep a share `CARE` of its quality."""
        if not careful:
            return self
        weights = self.weights.copy()
        for name, own in self.touched.by_shape():
            rise = CARE * found.quality[own] / max(float(self.floor[own].max()), WORST)
            weights[own] *= np.maximum(rise, 1.0) ** (3 if name == "tetra" else 2)
        return replace(self, weights=weights)

    def judged(self, points: FloatArray) -> CellScores:
        """Judge the cells with the nodes at points (N, 3)."""
        return self.touched.judged(points)

    def missed(self, found: CellScores, share: float) -> BoolArray:
        """Return which cells (C,) are inverted, or below a share of their floor."""
        poor = (self.floor > 0.0) & (found.quality < share * np.maximum(self.floor, 0.0))
        return np.asarray((self.floor > -np.inf) & (found.inverted | poor))

    def least(self, found: CellScores) -> float:
        """Return the least quality of any cell over its floor."""
        own = self.floor > 0.0
        return float((found.quality[own] / self.floor[own]).min(initial=1.0))

    def rank(self, found: CellScores) -> tuple[int, float]:
        """Return what the better of two meshes has more of: cells that are not inverted, then the least quality."""
        return -int(self.missed(found, 0.0).sum()), self.least(found)


@dataclass(frozen=True, slots=True, eq=False)
class RepairResult:
    """A mesh after its repair.

    Attributes
    ----------
    start, points : (N, 3) coordinates before it, and after.
    freedom : the nodes that could move.
    quality : of the touched cells before it, by type.
    moved : (K,) sorted indices of the nodes that were moved.
    spoiled : number of cells that were inverted, or below the share of their type's least quality.
    left : number of them that still are.
    inverted : (I,) rows, among the touched cells, of those that are still inverted and were not before the deflection.
    steps : steps of all searches.
    seconds : time it took, without compilation.
    """

    start: FloatArray = field(repr=False)
    points: FloatArray = field(repr=False)
    freedom: FreeNodes = field(repr=False)
    quality: tuple[Quality, ...]
    moved: IntArray = field(repr=False)
    spoiled: int
    left: int
    inverted: IntArray = field(repr=False)
    steps: int = 0
    seconds: float = 0.0

    @classmethod
    def of(
        cls, start: FloatArray, points: FloatArray, touched: TouchedCells, freedom: FreeNodes, share: float
    ) -> RepairResult:
        """Judge a mesh before and after its repair, which is not carried out; parameters as in `repaired`."""
        goal = QualityGoal.of(touched, freedom)
        before, after = goal.judged(start), goal.judged(points)
        moved = np.flatnonzero((points != start).any(axis=1))
        spoiled, left = (int(goal.missed(one, share).sum()) for one in (before, after))
        inverted = np.flatnonzero(after.inverted & ~touched.before.inverted)
        return cls(start, points, freedom, touched.quality(start), moved, spoiled, left, inverted)


def _with_any(touched: TouchedCells, mask: BoolArray) -> list[BoolArray]:
    """Return which of the touched cells have a node in the mask (N,), block by block."""
    found = []
    for block, rows in zip(touched.mesh.cells, touched.rows, strict=True):
        if isinstance(block, Polyhedra):
            found.append(np.isin(rows, polyhedra.touching(block, mask), assume_unique=True))
        else:
            found.append(np.asarray(mask[block.nodes[rows]].any(axis=1)))
    return found
