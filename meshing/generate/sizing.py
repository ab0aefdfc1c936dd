"""Target edge lengths as a function of position, and the graded octrees that carry them to the mesh generators.

h(x) = min over sources of (h_i + growth |x - p_i|).
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.mesh.quality import signed_volumes

# Sources whose sizes differ by less than this factor share a search tree.
LEVEL_RATIO = 1.12

CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
ROOTS = 4
# Half the diagonal of a unit cube: how far a cube's corners are from its centre.
HALF_DIAGONAL = 0.87
# A cube is split for the background mesh if its edge exceeds this many target lengths.
COARSENESS = 2.5
# The same for seed points: a little sparse, because a mesher that has to refine is made to optimise, too.
SPACING = 1.9
JITTER = 0.05
# How far seed points stay from the surface and from the box's sides, in target lengths.
CLEARANCE = 0.7


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


def leaves(
    low: FloatArray, high: FloatArray, split: Callable[[FloatArray, float], BoolArray]
) -> tuple[FloatArray, FloatArray]:
    """Low corners (K, 3) and edge lengths (K,) of the cubes that cover a box, in metres.

    They are split as long as `split(centres, edge)` says so.
    """
    edge = float((high - low).max()) / ROOTS
    count = np.ceil((high - low) / edge - 1e-9).astype(np.intp)
    cubes = low + edge * np.array(list(itertools.product(*map(range, count))), dtype=np.float64)
    corners, edges = [], []
    while len(cubes):
        finer = split(cubes + 0.5 * edge, edge)
        corners.append(cubes[~finer])
        edges.append(np.full(len(corners[-1]), edge))
        edge *= 0.5
        cubes = (cubes[finer][:, None] + edge * CORNERS).reshape(-1, 3)
    return np.concatenate(corners), np.concatenate(edges)


def background(field: SizeField, low: FloatArray, high: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Points (N, 3), tetrahedra (M, 4) that cover a box, and the nodes' target edge lengths (N,), in metres."""

    def split(centres: FloatArray, edge: float) -> BoolArray:
        within = np.maximum(field(centres) - field.growth * HALF_DIAGONAL * edge, field.smallest)
        return np.asarray(edge > COARSENESS * within)

    cubes, edges = leaves(low, high, split)
    points = _cube_corners(cubes, edges)
    # Cube corners are cospherical, which Delaunay triangulations answer with flat cells.
    points += 1e-2 * edges.min() * (np.random.default_rng(0).random(points.shape) - 0.5)
    tets = Delaunay(points).simplices.astype(np.intp)
    volumes = signed_volumes(points, tets)
    tets[volumes < 0.0] = tets[volumes < 0.0][:, [0, 2, 1, 3]]
    return points, tets[np.abs(volumes) > 1e-9 * edges.min() ** 3], field(points)


def seeds(field: SizeField, low: FloatArray, high: FloatArray, surface: FloatArray) -> FloatArray:
    """Points (K, 3) of graded body-centred cubic lattices in a box, for the mesher to start from.

    Such lattices have the best-shaped Delaunay tetrahedra: the mesher's first guess is then better than what
    it reaches in five passes from a simple cubic one. The points keep away from the box's sides and from
    points (S, 3) of the surface.
    """
    cubes, edges = leaves(low, high, lambda centres, edge: edge > SPACING * field(centres))
    points = np.concatenate([cubes + 0.5 * edges[:, None], _cube_corners(cubes, edges)])
    lengths = field(points)[:, None]
    points = points + JITTER * lengths * (np.random.default_rng(0).random(points.shape) - 0.5)
    margin = CLEARANCE * lengths
    inside = ((points > low + margin) & (points < high - margin)).all(axis=1)
    distance, _ = cKDTree(surface).query(points)
    return np.asarray(points[inside & (distance > margin[:, 0])])


def _cube_corners(cubes: FloatArray, edges: FloatArray) -> FloatArray:
    """The distinct corners (N, 3) of cubes with low corners (K, 3) and edge lengths (K,)."""
    corners = (cubes[:, None] + edges[:, None, None] * CORNERS).reshape(-1, 3)
    grain = edges.min() / 64.0
    return np.asarray(grain * np.unique(np.round(corners / grain), axis=0))
