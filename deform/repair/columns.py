"""Columns of layers: each node keeps its distance from the node below it, wherever that goes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.compiled import compiled_exactly
from sdm_deflect.deform.base.vectors import dot, minus, norm, plus, row_of
from sdm_deflect.deform.mesh.touched import TouchedCells, layers


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """The nodes of layers over walls.

    Attributes
    ----------
    levels : of each layer, from the wall outwards, its nodes with the one below each, (K, 2).
    forked : (F,) sorted nodes of the first layer that are above several nodes of the walls.
    """

    levels: tuple[IntArray, ...] = field(default=(), repr=False)
    forked: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)

    @classmethod
    def of(cls, touched: TouchedCells, walls: IntArray) -> Columns:
        """Follow flat cells from the nodes of walls (W,) outwards, until there are none."""
        levels: list[IntArray] = []
        forked = np.empty(0, dtype=np.intp)
        for base, top, _ in layers(touched, walls):
            pairs = np.unique(np.column_stack([top, base]), axis=0)
            nodes, first, count = np.unique(pairs[:, 0], return_index=True, return_counts=True)
            forked = forked if levels else nodes[count > 1]
            levels.append(pairs[first[count == 1]])
        return cls(tuple(levels), forked)

    def closed(self, nodes: IntArray, size: int) -> IntArray:
        """Return nodes (K,), sorted, with all that are above them; `size` is the number of nodes of the mesh."""
        mark = np.zeros(size, dtype=np.bool_)
        mark[nodes] = True
        for pairs in self.levels:
            mark[pairs[mark[pairs[:, 1]], 0]] = True
        return np.flatnonzero(mark)


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """The heights of layers, kept while K nodes of them move; from the wall outwards.

    Attributes
    ----------
    rows, below : (K,) rows of the nodes, and of those below them; -1 for one that stays.
    fixed : (K, 3) where the nodes below are if they stay.
    arms : (K, 3) from the nodes below to the nodes, to begin with.
    """

    rows: IntArray = field(repr=False)
    below: IntArray = field(repr=False)
    fixed: FloatArray = field(repr=False)
    arms: FloatArray = field(repr=False)

    @classmethod
    def of(cls, columns: Columns, points: FloatArray, nodes: IntArray) -> Heights:
        """Take the heights over nodes (U,) that move, at points (N, 3)."""
        place = np.full(len(points), -1, dtype=np.intp)
        place[nodes] = np.arange(len(nodes))
        pairs = np.concatenate([np.empty((0, 2), dtype=np.intp), *columns.levels])
        above, below = pairs[place[pairs[:, 0]] >= 0].T
        return cls(place[above], place[below], points[below], points[above] - points[below])

    def keep(self, places: FloatArray) -> FloatArray:
        """Move places (U, 3) along the line from the node below; return the arms (K, 3) before.

        Nodes whose arm is as it was keep their bits.
        """
        arms = np.empty_like(self.arms)
        _keep(self.rows, self.below, self.fixed, self.arms, places, arms)
        return arms

    def pull(self, arms: FloatArray, gradient: FloatArray) -> None:
        """Turn the gradient (U, 3) by the places kept into that by the places before, given the arms of `keep`."""
        _pull(self.rows, self.below, self.arms, arms, gradient)


@compiled_exactly
def _keep(
    rows: IntArray, below: IntArray, fixed: FloatArray, arms: FloatArray, places: FloatArray, out: FloatArray
) -> None:  # pragma: no cover - machine code
    for k in range(len(rows)):
        foot = row_of(places, below[k], 0) if below[k] >= 0 else row_of(fixed, k, 0)
        before, arm = row_of(arms, k, 0), minus(row_of(places, rows[k], 0), foot)
        for c in range(3):
            out[k, c] = arm[c]
        if arm != before:
            stretch = norm(before) / norm(arm)
            for c in range(3):
                places[rows[k], c] = foot[c] + stretch * arm[c]


@compiled_exactly
def _pull(
    rows: IntArray, below: IntArray, before: FloatArray, arms: FloatArray, gradient: FloatArray
) -> None:  # pragma: no cover - machine code
    for k in range(len(rows) - 1, -1, -1):
        arm, whole = row_of(arms, k, 0), row_of(gradient, rows[k], 0)
        length = norm(arm)
        outward = (arm[0] / length, arm[1] / length, arm[2] / length)
        across = plus(whole, -dot(whole, outward), outward)
        stretch = norm(row_of(before, k, 0)) / length
        for c in range(3):
            gradient[rows[k], c] = stretch * across[c]
            if below[k] >= 0:
                gradient[below[k], c] += whole[c] - stretch * across[c]
