"""What a repair is to bring about, and what it did: how good cells are, and were before the deflection."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sdm_deflect.deform import polyhedra
from sdm_deflect.deform.mesh import BoolArray, FloatArray, IntArray, Polyhedra
from sdm_deflect.deform.quality import POLYHEDRON, Quality, judged
from sdm_deflect.deform.repair.freedom import Freedom
from sdm_deflect.deform.touched import TouchedCells

WORST = 1e-3
"""Least quality that cells are weighted by."""


class Judged(NamedTuple):
    """Quality (C,) of cells, each by the measure of its type, and which (C,) are inverted."""

    quality: FloatArray
    inverted: BoolArray

    def replaced(self, cells: BoolArray, found: Judged) -> Judged:
        """Return the same with what was found of some cells, a mask (C,), in their place."""
        quality, inverted = self.quality.copy(), self.inverted.copy()
        quality[cells], inverted[cells] = found
        return Judged(quality, inverted)


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """What some of the touched cells should be like.

    Attributes
    ----------
    touched : the cells.
    floor : (C,) least quality, before the deflection, of the cells of each one's type; -inf where no node can move.
    weights : (C,) of the cells' energies, by which cells of all types come to their floors at once. The energy of a
        corner is at least the inverse square of its scaled Jacobian over that of its target, that of a tetrahedron the
        inverse cube of its mean ratio.
    """

    touched: TouchedCells = field(repr=False)
    floor: FloatArray = field(repr=False)
    weights: FloatArray = field(repr=False)

    @classmethod
    def of(cls, touched: TouchedCells, freedom: Freedom) -> Goal:
        """Ask of the cells with a node that may move the least quality that their type had."""
        movable = np.zeros(len(touched.mesh.points), dtype=np.bool_)
        movable[freedom.nodes] = True
        quality = _judged(touched, touched.mesh.points).quality
        floor, weights = np.full(touched.count, -np.inf), np.empty(touched.count)
        free = np.concatenate([np.empty(0, np.bool_), *_with_any(touched, movable)])
        for name, own in _by_shape(touched):
            least = float(quality[own].min())
            floor[own & free] = max(least, 0.0)
            least = max(least, WORST)
            weights[own] = least**3 if name == "tetra" else (least / np.maximum(quality[own], least)) ** 2
        return cls(touched, floor, weights)

    def among(self, cells: BoolArray) -> Goal:
        """Return the same for some of the cells, a mask (C,)."""
        ends = np.cumsum([0, *(len(rows) for rows in self.touched.rows)])
        rows = tuple(own[cells[a:b]] for own, a, b in zip(self.touched.rows, ends, ends[1:], strict=False))
        return Goal(replace(self.touched, rows=rows), self.floor[cells], self.weights[cells])

    def judged(self, points: FloatArray) -> Judged:
        """Judge the cells with the nodes at points (N, 3)."""
        return _judged(self.touched, points)

    def missed(self, found: Judged, share: float) -> BoolArray:
        """Return which cells (C,) are inverted, or below a share of their floor."""
        free = self.floor > -np.inf
        return np.asarray(free & (found.inverted | (found.quality < share * np.where(free, self.floor, 0.0))))

    def least(self, found: Judged) -> float:
        """Return the least quality of any cell over its floor."""
        own = self.floor > 0.0
        return float((found.quality[own] / self.floor[own]).min(initial=1.0))

    def rank(self, found: Judged) -> tuple[int, float]:
        """Return what the better of two meshes has more of: cells that are not inverted, then the least quality."""
        return -int(self.missed(found, 0.0).sum()), self.least(found)


@dataclass(frozen=True, slots=True, eq=False)
class Repaired:
    """A mesh after its repair.

    Attributes
    ----------
    start, points : (N, 3) coordinates before it, and after.
    freedom : the nodes that could move.
    quality : of the touched cells before it, by type.
    moved : (K,) sorted indices of the nodes that were moved.
    spoiled : number of cells that were inverted, or below the share of their type's least quality.
    left : number of them that still are.
    inverted : (I,) rows, among the touched cells, of those that are still inverted.
    steps : steps of all searches.
    seconds : time it took.
    """

    start: FloatArray = field(repr=False)
    points: FloatArray = field(repr=False)
    freedom: Freedom = field(repr=False)
    quality: tuple[Quality, ...]
    moved: IntArray = field(repr=False)
    spoiled: int
    left: int
    inverted: IntArray = field(repr=False)
    steps: int = 0
    seconds: float = 0.0

    @classmethod
    def of(
        cls, start: FloatArray, points: FloatArray, touched: TouchedCells, freedom: Freedom, share: float
    ) -> Repaired:
        """Judge a mesh before and after its repair, which is not carried out; parameters as in `repaired`."""
        goal = Goal.of(touched, freedom)
        before, after = goal.judged(start), goal.judged(points)
        moved = np.flatnonzero((points != start).any(axis=1))
        spoiled, left = (int(goal.missed(one, share).sum()) for one in (before, after))
        inverted = np.flatnonzero(after.inverted)
        return cls(start, points, freedom, touched.quality(start), moved, spoiled, left, inverted)


def _judged(touched: TouchedCells, points: FloatArray) -> Judged:
    """Judge the touched cells, block by block."""
    parts = zip(touched.mesh.cells, touched.rows, touched.orientation, strict=True)
    found = [judged(points, *part) for part in parts if len(part[1])]
    quality = np.concatenate([np.empty(0), *(values for values, _ in found)])
    return Judged(quality, np.concatenate([np.empty(0, np.bool_), *(bad for _, bad in found)]))


def _by_shape(touched: TouchedCells) -> Iterator[tuple[str, BoolArray]]:
    """Yield each type of the touched cells, and which (C,) are of it."""
    names = [getattr(block, "shape", POLYHEDRON) for block in touched.mesh.cells]
    for name in dict.fromkeys(name for name, rows in zip(names, touched.rows, strict=True) if len(rows)):
        yield name, np.repeat([one == name for one in names], [len(rows) for rows in touched.rows])


def _with_any(touched: TouchedCells, mask: BoolArray) -> list[BoolArray]:
    """Return which of the touched cells have a node in the mask (N,), block by block."""
    found = []
    for block, rows in zip(touched.mesh.cells, touched.rows, strict=True):
        if isinstance(block, Polyhedra):
            found.append(np.isin(rows, polyhedra.touching(block, mask), assume_unique=True))
        else:
            found.append(np.asarray(mask[block.nodes[rows]].any(axis=1)))
    return found
