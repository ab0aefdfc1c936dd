"""Columns of layers: each node keeps its distance from the node below it, wherever that goes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
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


class Level(NamedTuple):
    """Nodes of one layer: rows (K,), those of the nodes below (-1: one that stays, at `fixed`), arms (K, 3) between."""

    rows: IntArray
    below: IntArray
    fixed: FloatArray
    arms: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """The heights of layers, kept while nodes of them move.

    Attributes
    ----------
    levels : from the wall outwards.
    """

    levels: tuple[Level, ...] = field(repr=False)

    @classmethod
    def of(cls, columns: Columns, points: FloatArray, nodes: IntArray) -> Heights:
        """Take the heights over nodes (U,) that move, at points (N, 3)."""
        place = np.full(len(points), -1, dtype=np.intp)
        place[nodes] = np.arange(len(nodes))
        levels = []
        for pairs in columns.levels:
            above, below = pairs[place[pairs[:, 0]] >= 0].T
            if len(above):
                levels.append(Level(place[above], place[below], points[below], points[above] - points[below]))
        return cls(tuple(levels))

    def keep(self, places: FloatArray) -> list[FloatArray]:
        """Move places (U, 3) along the line from the node below; return the arms (K, 3) of each level before.

        Nodes whose arm is as it was keep their bits.
        """
        arms = []
        for one in self.levels:
            foot = np.where((one.below >= 0)[:, None], places[one.below], one.fixed)
            arm = places[one.rows] - foot
            moved = np.any(arm != one.arms, axis=1)
            places[one.rows[moved]] = (foot + _stretch(one.arms, arm) * arm)[moved]
            arms.append(arm)
        return arms

    def pull(self, arms: list[FloatArray], gradient: FloatArray) -> None:
        """Turn the gradient (U, 3) by the places kept into that by the places before, given the arms of `keep`."""
        for one, arm in zip(reversed(self.levels), reversed(arms), strict=True):
            outward = arm / np.linalg.norm(arm, axis=1, keepdims=True)
            whole = gradient[one.rows]
            across = whole - np.sum(whole * outward, axis=1, keepdims=True) * outward
            own = _stretch(one.arms, arm) * across
            moves = one.below >= 0
            np.add.at(gradient, one.below[moves], (whole - own)[moves])
            gradient[one.rows] = own


def _stretch(arms: FloatArray, arm: FloatArray) -> FloatArray:
    """Return (K, 1) what gives an arm the length of those before."""
    return np.asarray(np.linalg.norm(arms, axis=1, keepdims=True) / np.linalg.norm(arm, axis=1, keepdims=True))
