"""Target edge length as a function of position: h(x) = min over sources of (h_i + growth |x - p_i|)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.meshing.mesh import FloatArray

# Sources whose sizes differ by less than this factor share a search tree.
LEVEL_RATIO = 1.12


@dataclass(frozen=True, slots=True, eq=False)
class SizeField:
    """A graded field of target edge lengths; `levels` are search trees of source points with their length."""

    levels: tuple[tuple[cKDTree, float], ...]
    growth: float
    largest: float

    @property
    def smallest(self) -> float:
        """The smallest target edge length anywhere, in metres."""
        return min(self.levels[0][1], self.largest) if self.levels else self.largest

    def __call__(self, points: FloatArray) -> FloatArray:
        """Target edge lengths (N,) in metres at points (N, 3)."""
        lengths = np.full(len(points), self.largest)
        for tree, length in self.levels:
            open_points = np.flatnonzero(lengths > length)
            if len(open_points):
                reach = (lengths[open_points].max() - length) / self.growth
                distance, _ = tree.query(points[open_points], distance_upper_bound=reach * 1.0001)
                grown = length + self.growth * distance
                lengths[open_points] = np.minimum(lengths[open_points], grown)
        return lengths


def size_field(points: FloatArray, lengths: FloatArray, growth: float, largest: float) -> SizeField:
    """Build the field of sources at points (S, 3) with target edge lengths (S,) in metres.

    Lengths are rounded down by at most LEVEL_RATIO; sources that others make superfluous are left out.
    """
    level = np.floor(np.log(lengths / lengths.min()) / np.log(LEVEL_RATIO) + 1e-9).astype(np.intp)
    field = SizeField((), growth, largest)
    for index in np.unique(level):
        members, length = points[level == index], float(lengths[level == index].min())
        needed = members[field(members) > length]
        if len(needed):
            field = SizeField((*field.levels, (cKDTree(needed), length)), growth, largest)
    return field
