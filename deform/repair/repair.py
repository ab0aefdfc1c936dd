"""The repair: patches of nodes around spoiled cells, as large as need be, go to where these cells are good."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import chain, repeat
from math import nan
from time import perf_counter
from typing import NamedTuple

import numpy as np

from sdm_deflect.deform import polyhedra
from sdm_deflect.deform.mesh import BoolArray, FloatArray, IntArray, Polyhedra
from sdm_deflect.deform.progress import Progress, silent
from sdm_deflect.deform.quality import POLYHEDRON, Quality, judged
from sdm_deflect.deform.rbf.threads import single_threaded_blas
from sdm_deflect.deform.repair.columns import Heights
from sdm_deflect.deform.repair.elements import Elements, Tetrahedra
from sdm_deflect.deform.repair.energy import Energy
from sdm_deflect.deform.repair.freedom import Freedom
from sdm_deflect.deform.repair.minimise import minimise
from sdm_deflect.deform.touched import TouchedCells
from sdm_deflect.deform.volume.sliding import SlidingSurface

RINGS = (3, 6, 12, 24)
"""Rings of cells around spoiled ones whose nodes move; then all that may."""
MANY = 0.2
"""Spoiled cells over nodes that move, above which the next larger patch is taken at once."""
WORST = 1e-3
"""Least quality that cells are weighted by."""
FAR, SMALL = 500, 10_000
"""Nodes for each cell below a level, beyond which they are too far away to help, unless it is inverted; so many nodes
are never too many."""
STEPS, TOLERANCE = 25, 1e-5
"""Of the search at one eps and power: most steps, and the least share by which each has to lower the energy."""
WIDEST, LEAST_EPS = 0.01, 1e-6
"""Least eps at the start, over a target's determinant, and where untangling is given up."""
NARROWER, NARROWEST = 0.5, 0.2
"""What is left of eps for the next search; and if this one ended by itself."""
POWERS = (1, 2, 4, 8)
"""Powers of the energy, one after another, once nothing is inverted: the worst cells weigh more and more."""
EASY = (0.35, 0.6, 0.75)
"""Least shares of a cell's quality in its floor, about, from which the first powers are left out; but for tetrahedra,
whose energy is their quality, one power at most."""
WORTH, PATIENCE = 0.02, 8
"""Share by which a search at the largest power has to raise the least quality to be followed by another; searches that
may pass without fewer inverted elements."""
LEVELS = (0.0, 0.5, 0.7, 0.8, 0.85)
"""Shares of the least quality before to which all cells are brought, one after another, up to the one that is asked
for; first none is inverted."""
LOSS = 0.02
"""Share of its floor that the worst cell may lose where fewer cells are below the level."""
VAIN = 2
"""Patches without a gain after which a level is given up."""
REST = 0.1
"""Share of inverted or spoiled cells at which a patch that could be smaller around them is left; if more are left, a
level is the last."""
FEWER = 0.5
"""Share of the spoiled cells that may be left for the next patch to be as small as can be again, not larger."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """Where unknown nodes are, given how far each is to go: those that slide are put on their shapes.

    Attributes
    ----------
    base : (U, 3) where they are to begin with.
    slides : rows (K,) of nodes that slide, and their shapes.
    heights : of the layers, kept after that.
    """

    base: FloatArray = field(repr=False)
    slides: tuple[tuple[IntArray, SlidingSurface], ...] = field(repr=False)
    heights: Heights

    @classmethod
    def of(cls, points: FloatArray, nodes: IntArray, freedom: Freedom) -> Chart:
        """Take some of the nodes (U,) that are free to move, at points (N, 3)."""
        slides, order = [], np.argsort(nodes)
        for one in freedom.slides:
            own = one.nodes[np.isin(one.nodes, nodes, assume_unique=True)]
            if len(own):
                rows = order[np.searchsorted(nodes, own, sorter=order)]
                slides.append((rows, one.shape))
        return cls(points[nodes], tuple(slides), Heights.of(freedom.columns, points, nodes))

    def place(self, way: FloatArray) -> FloatArray:
        """Return the places (U, 3)."""
        return self._placed(way)[0]

    def pulled(self, way: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return the gradient (U, 3) by the way, given that by the places."""
        if self.heights.levels:
            self.heights.pull(self._placed(way)[1], gradient)
        for rows, shape in self.slides:
            gradient[rows] = shape.rate(self.base[rows], way[rows], gradient[rows])
        return gradient

    def _placed(self, way: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
        """Return the places (U, 3), and the arms of the layers' nodes."""
        out = self.base + way
        for rows, shape in self.slides:
            out[rows] = self.base[rows] + shape.projected(self.base[rows], way[rows])
        return out, self.heights.keep(out)


def repaired(
    points: FloatArray, touched: TouchedCells, freedom: Freedom, share: float, progress: Progress = silent
) -> Repaired:
    """Mend the cells that are inverted, or whose quality is below a share of their type's least before.

    Around them nodes move until all cells of the patch are as good as the worst was before, or nothing more is won.
    While cells miss their share, the next patch is larger. If a node leaves the plane face that it slides on, all is
    done again with the nodes of this face where they were.

    Parameters
    ----------
    points : (N, 3) the deflected mesh.
    touched : the cells that may change, and the mesh before.
    freedom : the nodes that may move.
    """
    begin = perf_counter()
    made = _repaired(points, touched, freedom, share, progress)
    while beyond := made.freedom.left_by(points, made.points):
        made = _repaired(points, touched, made.freedom.without(beyond), share, progress)
    return replace(made, seconds=perf_counter() - begin)


def _repaired(
    points: FloatArray, touched: TouchedCells, freedom: Freedom, share: float, progress: Progress
) -> Repaired:
    """Bring the cells to one level after another; parameters as in `repaired`."""
    goal = Goal.of(touched, freedom)
    parts = zip(touched.mesh.cells, touched.rows, touched.orientation, strict=True)
    tetrahedra = Tetrahedra.of(touched.mesh.points, parts)
    found = start = goal.judged(points)
    here, steps = points, 0
    everything = (len(points),)
    for level in (*(level for level in LEVELS if level < share), share, 1.0):
        sizes = (*RINGS, *everything) if level <= share else RINGS[:1]
        before = goal.missed(found, level).sum()
        here, found, count = _raised(here, found, tetrahedra, freedom, goal, Level(level, sizes, progress))
        steps += count
        if goal.missed(found, level).sum() > REST * before:
            break
    if goal.missed(found, share).any() and len(freedom.nodes) < SMALL:
        whole = Level(share, everything, progress)
        there, other, count = _raised(points, start, tetrahedra, freedom, goal, whole)
        steps += count
        if goal.rank(other) > goal.rank(found):
            here, found = there, other
    made = Repaired.of(points, here, touched, freedom, share)
    return replace(made, steps=steps)


class Level(NamedTuple):
    """A share of their floor that cells shall reach, the sizes of patches in rings that are tried, and who is told."""

    share: float
    rings: tuple[int, ...]
    progress: Progress


def _raised(
    points: FloatArray, found: Judged, tetrahedra: Tetrahedra, freedom: Freedom, goal: Goal, wanted: Level
) -> tuple[FloatArray, Judged, int]:
    """Bring all cells to a level if that can be done; return all points (N, 3), their cells, and the steps.

    The patch is as small as it may be for the number of cells below the level. It grows while that number does not
    fall by half, until nothing is won any more.
    """
    movable = np.zeros(len(points), dtype=np.bool_)
    movable[freedom.nodes] = True
    level, sizes, progress = wanted
    size, last, steps, vain = 0, -1, 0, 0
    below = goal.missed(found, level)
    while below.any() and size < len(sizes) and vain < VAIN:
        unknown = freedom.columns.closed(_around(tetrahedra, below, movable, sizes[size]), len(points))
        count = int(below.sum())
        if len(unknown) == last or (sizes[size] < len(points) and count > MANY * len(unknown)):
            size += 1
            continue
        if level and len(unknown) > max(FAR * count, SMALL):
            break
        progress(f"repair: {count} cells, {len(unknown)} nodes", nan)
        patch = Patch.of(points, tetrahedra, unknown, freedom, goal)
        new, taken = _mended(patch, level, REST if size else 0.0)
        after = found.replaced(patch.cells, patch.goal.judged(new))
        steps, last, left = steps + taken, len(unknown), goal.missed(after, level)
        gain = goal.least(after) - goal.least(found)
        fewer = int(left.sum()) < count
        better = (fewer and gain >= -LOSS) or gain > WORTH if level else fewer
        size = 0 if better and left.sum() <= FEWER * count else size + 1
        vain = 0 if better else vain + 1
        if better:
            points, found, below = new, after, left
    return points, found, steps


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """Nodes that move together, and the cells around them.

    Attributes
    ----------
    points : (N, 3) the mesh at the start.
    unknown : (U,) the nodes that move.
    energy, chart : of its elements, and where nodes may go.
    cells, goal : its cells, a mask (C,), and what they should be like.
    local : (M, 3) places of the elements' nodes, the unknown ones first, those last asked for.
    """

    points: FloatArray = field(repr=False)
    unknown: IntArray = field(repr=False)
    energy: Energy = field(repr=False)
    chart: Chart = field(repr=False)
    cells: BoolArray = field(repr=False)
    goal: Goal = field(repr=False)
    local: FloatArray = field(repr=False)

    @classmethod
    def of(cls, points: FloatArray, tetrahedra: Tetrahedra, nodes: IntArray, freedom: Freedom, goal: Goal) -> Patch:
        """Let some nodes (U,) move, with the mesh at points (N, 3)."""
        elements = Elements.of(tetrahedra, nodes, goal.touched.mesh.points, goal.weights)
        cells = np.zeros(len(goal.floor), dtype=np.bool_)
        cells[elements.cells] = True
        unknown = elements.used[: elements.unknown]
        chart = Chart.of(points, unknown, freedom)
        return cls(points, unknown, Energy(elements), chart, cells, goal.among(cells), points[elements.used])

    def at(self, way: FloatArray) -> FloatArray:
        """Return the places (M, 3) of the elements' nodes when the unknown ones go a way (U, 3)."""
        self.local[: len(self.unknown)] = self.chart.place(way)
        return self.local

    def everywhere(self, way: FloatArray) -> FloatArray:
        """Return the places (N, 3) of all nodes."""
        out = self.points.copy()
        out[self.unknown] = self.chart.place(way)
        return out

    def below(self, way: FloatArray, level: float) -> int:
        """Return how many cells are inverted, or below a share of their floor."""
        return int(self.goal.missed(self.goal.judged(self.everywhere(way)), level).sum())

    def least(self, way: FloatArray) -> float:
        """Return the least mean ratio of an element to its target; 0 if one is inverted."""
        return self.energy.least(self.at(way))

    @property
    def simple(self) -> bool:
        """True if all cells are tetrahedra."""
        parts = zip(self.goal.touched.mesh.cells, self.goal.touched.rows, strict=True)
        return all(getattr(block, "shape", POLYHEDRON) == "tetra" for block, rows in parts if len(rows))

    @property
    def inverted(self) -> int:
        """Number of elements that are inverted at the place last evaluated."""
        return int(np.count_nonzero(self.energy.determinants <= 0.0))

    def search(self, way: FloatArray, eps: float, power: int) -> tuple[FloatArray, int]:
        """Lower the energy, beginning at a way (U, 3); return where that ended, and the steps."""

        def function(way: FloatArray) -> tuple[float, FloatArray]:
            value, gradient = self.energy(self.at(way), eps, power)
            return value, self.chart.pulled(way, gradient) if np.isfinite(value) else gradient

        with single_threaded_blas():
            found = minimise(function, way, self.energy.curvature(self.at(way), eps, power), STEPS, TOLERANCE)
        return found.place, found.steps


def _mended(patch: Patch, level: float, rest: float) -> tuple[FloatArray, int]:
    """Move a patch until its cells are at a level or nothing more is won; return all points (N, 3), and the steps.

    While cells are inverted eps shrinks, from twice the worst determinant; then the power grows. The patch is left to
    smaller ones when no more than a share `rest` of the inverted cells, or then of those below the level, is left.
    """
    way, steps = np.zeros((len(patch.unknown), 3)), 0
    least, below = patch.least(way), patch.below(way, level)
    first = inverted = patch.inverted
    eps, vain = max(WIDEST, -2.0 * float(patch.energy.determinants.min())), 0
    while inverted > rest * first and vain < PATIENCE and eps > LEAST_EPS:
        way, count = patch.search(way, eps, POWERS[0])
        least, steps = patch.least(way), steps + count
        eps *= NARROWER if count == STEPS else NARROWEST
        inverted, vain = patch.inverted, 0 if patch.inverted < inverted else vain + 1
    if inverted:
        return patch.everywhere(way), steps
    easy = int(np.searchsorted(EASY if patch.simple else EASY[:1], least))
    for power in chain(POWERS[easy:], repeat(POWERS[-1])):
        if patch.below(way, level) <= rest * below:
            break
        way, count = patch.search(way, 0.0, power)
        before, least, steps = least, patch.least(way), steps + count
        if power == POWERS[-1] and least < before * (1.0 + WORTH):
            break
    return patch.everywhere(way), steps


def _around(tetrahedra: Tetrahedra, spoiled: BoolArray, movable: BoolArray, rings: int) -> IntArray:
    """Return the sorted nodes (U,) that may move within so many rings of cells around spoiled ones."""
    if rings >= len(movable):
        return np.flatnonzero(movable)
    near = np.zeros(len(movable), dtype=np.bool_)
    near[tetrahedra.nodes[spoiled[tetrahedra.cells]]] = True
    for _ in range(rings - 1):
        near[tetrahedra.nodes[near[tetrahedra.nodes].any(axis=1)]] = True
    return np.flatnonzero(near & movable)


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
