"""A region of nodes that move together until the cells around them are good.

The minimum is searched by L-BFGS; the first approximation has each node's second derivative alone. `QualityGoal`
requires a quality of cells; `RepairResult` describes a repair.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import chain, repeat
from typing import NamedTuple

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.threads import single_threaded_blas
from sdm_deflect.meshing.mesh import polyhedra
from sdm_deflect.meshing.mesh.affected import AffectedCells, CellScores
from sdm_deflect.meshing.mesh.cells import Polyhedra
from sdm_deflect.meshing.mesh.images import Images
from sdm_deflect.meshing.mesh.quality import Quality
from sdm_deflect.meshing.mesh.sliding import SlidingSurface
from sdm_deflect.meshing.mesh.standard import parts_of

from .elements import IntersectionCurve, RegionElements, Tetrahedra, Tracks
from .energy import Energy
from .freedom import FreeNodes, Heights

# Least quality by which cells are weighted.
WORST = 1e-3
# Share of its quality that a good cell should keep during a careful repair.
CARE = 0.95
# Largest loss of the mean quality of a type of cells, and of the quality that 99 % of them exceed.
LOST = 0.005
# Number of pairs of steps and gradient changes that L-BFGS keeps.
MEMORY = 12
# Share of the expected decrease that a step must reach (Armijo), and the shortest step that is tried.
ARMIJO, SHORTEST = 1e-4, 1e-6
Function = Callable[[FloatArray], tuple[float, FloatArray]]
# Most steps of a search at one eps and power, and the least relative decrease of the energy by each.
STEPS, TOLERANCE = 25, 1e-5
# Least eps at the start, over a target's determinant; smallest eps of untangling.
WIDEST, LEAST_EPS = 0.01, 1e-6
# Determinant over its target's, below which an element counts as tangled: powers of its energy overflow.
FLAT = 1e-3
# Factors of eps for the next search: if this one used all its steps, and if it converged.
NARROWER, NARROWEST = 0.5, 0.2
# Powers of the energy in turn, once nothing is inverted: the worst cells weigh more and more.
POWERS = (1, 2, 4, 8, 16)
# Approximate ratios of least quality to floor, from which the first powers are skipped. For tetrahedra at most one
# power is skipped, because their energy is their quality.
EASY = (0.35, 0.6, 0.75)
# Relative gain of least quality for which another search follows at the largest power; searches without fewer inverted
# elements before giving up.
WORTH, PATIENCE = 0.005, 8


@dataclass(frozen=True, slots=True, eq=False)
class QualityGoal:
    """The quality that some of the affected cells should reach.

    Attributes
    ----------
    affected : the cells.
    floor : (C,) for each cell the least quality of the good cells of its type before; 0 for a cell that was not better.
        It is -inf for a cell that was inverted or has no node that can move: nothing is required of it.
    weights : (C,) weights of the cells' energies, so that cells of all types reach their floors together. The energy of
        a corner is at least the squared inverse of its relative scaled Jacobian; a tetrahedron's is the cubed
        inverse of its mean ratio.
    """

    affected: AffectedCells = field(repr=False)
    floor: FloatArray = field(repr=False)
    weights: FloatArray = field(repr=False)

    @classmethod
    def of(cls, affected: AffectedCells, freedom: FreeNodes) -> QualityGoal:
        """Return the goal that cells with a node that may move reach the least quality of their type before."""
        movable = np.zeros(len(affected.mesh.points), dtype=np.bool_)
        movable[freedom.nodes] = True
        quality, inverted = affected.before
        floor, weights = np.full(affected.count, -np.inf), np.empty(affected.count)
        free = np.concatenate([np.empty(0, np.bool_), *_with_any(affected, movable)])
        for name, own in affected.by_shape():
            least = float(quality[own & ~inverted & (quality > 0.0)].min(initial=1.0))
            floor[own & free & ~inverted] = least
            least = max(least, WORST)
            weights[own] = least**3 if name == "tetra" else (least / np.maximum(quality[own], least)) ** 2
        floor[(quality <= 0.0) & (floor > 0.0)] = 0.0
        return cls(affected, floor, weights)

    def among(self, cells: BoolArray) -> QualityGoal:
        """Return the goal of the cells in a mask (C,)."""
        ends = np.cumsum([0, *(len(rows) for rows in self.affected.rows)])
        rows = tuple(row[cells[a:b]] for row, a, b in zip(self.affected.rows, ends, ends[1:], strict=False))
        return QualityGoal(replace(self.affected, rows=rows), self.floor[cells], self.weights[cells])

    def spread(self, scores: CellScores) -> FloatArray:
        """Return the 1st percentile and the mean (T, 2) of the quality of each type of cells."""
        by_type = [scores.quality[typed] for _, typed in self.affected.by_shape()]
        return np.array([[np.percentile(quality, 1.0), quality.mean()] for quality in by_type])

    def keeps(self, scores: CellScores, spread: FloatArray | None) -> bool:
        """Return whether no value of a spread (T, 2) falls by more than `LOST`; True without a spread."""
        return spread is None or bool((self.spread(scores) >= spread - LOST).all())

    def with_weights(self, scores: CellScores, careful: bool) -> QualityGoal:
        """Return the goal; if careful, with weights by which each good cell keeps a share `CARE` of its quality."""
        if not careful:
            return self
        weights = self.weights.copy()
        for name, typed in self.affected.by_shape():
            rise = CARE * scores.quality[typed] / max(float(self.floor[typed].max()), WORST)
            weights[typed] *= np.maximum(rise, 1.0) ** (3 if name == "tetra" else 2)
        return replace(self, weights=weights)

    def scores(self, points: FloatArray) -> CellScores:
        """Judge the cells with the nodes at points (N, 3)."""
        return self.affected.scores(points)

    def misses(self, scores: CellScores, share: float) -> BoolArray:
        """Return which cells (C,) are inverted, or below a share of their floor."""
        poor = (self.floor > 0.0) & (scores.quality < share * np.maximum(self.floor, 0.0))
        return np.asarray((self.floor > -np.inf) & (scores.inverted | poor))

    def least(self, scores: CellScores) -> float:
        """Return the least ratio of a cell's quality to its floor."""
        judged = self.floor > 0.0
        return float((scores.quality[judged] / self.floor[judged]).min(initial=1.0))

    def rank(self, scores: CellScores) -> tuple[int, float]:
        """Return a rank, larger for a better mesh: minus the number of inverted cells, then the least quality."""
        return -int(self.misses(scores, 0.0).sum()), self.least(scores)


@dataclass(frozen=True, slots=True, eq=False)
class RepairResult:
    """A mesh after its repair.

    Attributes
    ----------
    start, points : (N, 3) coordinates before and after.
    freedom : the nodes that could move.
    quality : quality of the affected cells before the repair, by type.
    moved : (K,) sorted indices of the moved nodes.
    spoiled : number of cells that were inverted, or below a share of their type's least quality before.
    left : number of them that still are.
    inverted : (I,) rows among the affected cells that are still newly inverted.
    steps : steps of all searches.
    seconds : time taken, without compilation.
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
        cls, start: FloatArray, points: FloatArray, affected: AffectedCells, freedom: FreeNodes, share: float
    ) -> RepairResult:
        """Return the result of no repair, with the mesh judged; parameters as for `repair_cells`."""
        goal = QualityGoal.of(affected, freedom)
        before, after = goal.scores(start), goal.scores(points)
        moved = np.flatnonzero((points != start).any(axis=1))
        spoiled, left = (int(goal.misses(one, share).sum()) for one in (before, after))
        inverted = np.flatnonzero(after.inverted & ~affected.before.inverted)
        return cls(start, points, freedom, affected.quality(start), moved, spoiled, left, inverted)


def _with_any(affected: AffectedCells, mask: BoolArray) -> list[BoolArray]:
    """Return which affected cells have a node in the mask (N,), for each block."""
    masks = []
    for block, rows in zip(affected.mesh.cells, affected.rows, strict=True):
        if isinstance(block, Polyhedra):
            masks.append(np.isin(rows, polyhedra.touching(block, mask), assume_unique=True))
        else:
            masks.append(np.asarray(mask[block.nodes[rows]].any(axis=1)))
    return masks


class Minimum(NamedTuple):
    """The end of a search: place, value and number of steps."""

    place: FloatArray
    value: float
    steps: int


def minimise(function: Function, place: FloatArray, blocks: FloatArray, steps: int, tolerance: float) -> Minimum:
    """Minimise a function of (U, 3) unknowns.

    Parameters
    ----------
    function : Returns the value and gradient (U, 3); the value may be infinite away from `place`.
    blocks : (U, 6) second derivative by each node, as upper triangles.
    steps : Largest number of steps.
    tolerance : The search ends when a step decreases the value by a smaller share.
    """
    solve = _inverses(blocks)
    pairs: list[tuple[FloatArray, FloatArray, float]] = []
    value, gradient = function(place)
    for count in range(steps):
        direction = -_approximate_inverse(gradient, pairs, solve)
        slope = float(np.vdot(gradient, direction))
        if not slope < 0.0:
            return Minimum(place, value, count)
        length = 1.0
        while True:
            trial = place + length * direction
            new, after = function(trial)
            if np.isfinite(new) and new <= value + ARMIJO * length * slope:
                break
            length *= 0.5
            if length < SHORTEST:
                return Minimum(place, value, count)
        step, change = trial - place, after - gradient
        curve = float(np.vdot(step, change))
        if curve > 0.0:
            pairs = [*pairs[1 - MEMORY :], (step, change, curve)]
        lowered = value - new
        place, value, gradient = trial, new, after
        if lowered < tolerance * abs(value):
            return Minimum(place, value, count + 1)
    return Minimum(place, value, steps)


def _approximate_inverse(
    gradient: FloatArray, pairs: list[tuple[FloatArray, FloatArray, float]], solve: FloatArray
) -> FloatArray:
    """Multiply a gradient (U, 3) by the inverse second derivative that the pairs define (Nocedal 1980)."""
    out, shares = gradient.copy(), []
    for step, change, curve in reversed(pairs):
        shares.append(float(np.vdot(step, out)) / curve)
        out -= shares[-1] * change
    out = np.einsum("uij,uj->ui", solve, out)
    if pairs:
        _, change, curve = pairs[-1]
        out *= curve / float(np.vdot(change, np.einsum("uij,uj->ui", solve, change)))
    for (step, change, curve), share in zip(pairs, reversed(shares), strict=True):
        out += (share - float(np.vdot(change, out)) / curve) * step
    return np.asarray(out)


def _inverses(blocks: FloatArray) -> FloatArray:
    """Return the inverses (U, 3, 3) of symmetric matrices given as upper triangles (U, 6).

    A node whose matrix underflows beside a nearly flat cell gets the stiffest matrix.
    """
    size = np.abs(blocks).max(axis=1, initial=0.0)
    scale = np.where(size > 0.0, size, 1.0)[:, None, None]  # determinants of very stiff matrices overflow
    matrices = blocks[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3) / scale
    flat = np.linalg.det(matrices) == 0.0
    matrices[flat], scale[flat] = np.eye(3), max(float(size.max(initial=0.0)), np.finfo(float).tiny)
    return np.asarray(np.linalg.inv(matrices) / scale)


@dataclass(frozen=True, slots=True, eq=False)
class FreeDisplacements:
    """Places of unknown nodes as functions of free displacements; sliding nodes are projected onto their shapes.

    Attributes
    ----------
    base : (U, 3) places at first.
    slides : rows (K,) of sliding nodes, and their shapes.
    edges : rows (K,) of nodes that slide along edges, and the edges.
    heights : heights of layers, restored last.
    images : groups of rows that move alike; None without any.
    """

    base: FloatArray = field(repr=False)
    slides: tuple[tuple[IntArray, SlidingSurface], ...] = field(repr=False)
    edges: tuple[IntArray, Tracks] = field(repr=False)
    heights: Heights
    images: Images | None = None

    @classmethod
    def of(cls, points: FloatArray, nodes: IntArray, freedom: FreeNodes) -> FreeDisplacements:
        """Return the free displacements of some of the free nodes (U,), at points (N, 3)."""
        slides, edges, order = [], [], np.argsort(nodes)
        for slide in freedom.slides:
            own = slide.nodes[np.isin(slide.nodes, nodes, assume_unique=True)]
            rows = order[np.searchsorted(nodes, own, sorter=order)]
            if isinstance(slide.shape, IntersectionCurve):
                edges.append((rows, slide.shape.tracks(points[own])))
            elif len(own):
                slides.append((rows, slide.shape))
        rows = np.concatenate([np.empty(0, dtype=np.intp), *(rows for rows, _ in edges)])
        tracks = Tracks.joined([tracks for _, tracks in edges])
        heights = Heights.of(freedom.columns, points, nodes)
        images = freedom.images.among(nodes) if len(freedom.images.nodes) else None
        return cls(points[nodes], tuple(slides), (rows, tracks), heights, images)

    def place(self, way: FloatArray) -> FloatArray:
        """Return the places (U, 3) for free displacements (U, 3)."""
        return self._places(way)[0]

    def pull_back(self, way: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return the gradient (U, 3) by the free displacements, given the gradient by the places."""
        if len(self.heights.rows):
            self.heights.pull(self._places(way)[1], gradient)
        for rows, shape in self.slides:
            gradient[rows] = shape.rate(self.base[rows], way[rows], gradient[rows])  # the derivative is symmetric
        rows, tracks = self.edges
        along = np.einsum("ij,ij->i", gradient[rows], tracks.slope(way[rows]))
        gradient[rows] = along[:, None] * tracks.tangent
        return self.images.projected(gradient) if self.images else gradient

    def _places(self, way: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the places (U, 3), and the arms (K, 3) of the nodes of layers."""
        out = self.base + (self.images.projected(way) if self.images else way)
        for rows, shape in self.slides:
            out[rows] = self.base[rows] + shape.projected(self.base[rows], way[rows])
        rows, tracks = self.edges
        out[rows] = self.base[rows] + tracks.projected(way[rows])
        return out, self.heights.keep(out)


@dataclass(frozen=True, slots=True, eq=False)
class RepairRegion:
    """Nodes that move together, and the cells around them.

    Attributes
    ----------
    points : (N, 3) mesh at the start.
    unknown : (U,) moving nodes.
    energy, chart : energy of the elements, and the places of nodes for free displacements.
    cells, goal : cells of the region, a mask (C,), and their goal.
    local : (M, 3) last places of the elements' nodes; unknown nodes come first.
    """

    points: FloatArray = field(repr=False)
    unknown: IntArray = field(repr=False)
    energy: Energy = field(repr=False)
    chart: FreeDisplacements = field(repr=False)
    cells: BoolArray = field(repr=False)
    goal: QualityGoal = field(repr=False)
    local: FloatArray = field(repr=False)

    @classmethod
    def of(
        cls, points: FloatArray, tetrahedra: Tetrahedra, nodes: IntArray, freedom: FreeNodes, goal: QualityGoal
    ) -> RepairRegion:
        """Return the region whose nodes (U,) move, with the mesh at points (N, 3)."""
        elements = RegionElements.of(tetrahedra, nodes, goal.affected.mesh.points, goal.weights)
        cells = np.zeros(len(goal.floor), dtype=np.bool_)
        cells[elements.cells] = True
        unknown = elements.used[: elements.unknown]
        chart = FreeDisplacements.of(points, unknown, freedom)
        return cls(points, unknown, Energy(elements), chart, cells, goal.among(cells), points[elements.used])

    def at(self, way: FloatArray) -> FloatArray:
        """Return the places (M, 3) of the elements' nodes for free displacements `way` (U, 3)."""
        self.local[: len(self.unknown)] = self.chart.place(way)
        return self.local

    def everywhere(self, way: FloatArray) -> FloatArray:
        """Return the places (N, 3) of all nodes."""
        out = self.points.copy()
        out[self.unknown] = self.chart.place(way)
        return out

    def below(self, way: FloatArray, level: float) -> int:
        """Return the number of cells that are inverted, or below a share of their floor."""
        return int(self.goal.misses(self.goal.scores(self.everywhere(way)), level).sum())

    def least(self, way: FloatArray) -> float:
        """Return the least mean ratio of an element to its target; 0 if one is inverted."""
        return self.energy.least(self.at(way))

    @property
    def simple(self) -> bool:
        """Whether all cells are tetrahedra."""
        parts = zip(self.goal.affected.mesh.cells, self.goal.affected.rows, strict=True)
        return {name for block, rows in parts for name, *_ in parts_of(block, rows)} <= {"tetra"}

    @property
    def inverted(self) -> int:
        """Number of inverted and nearly flat elements at the last evaluated place."""
        return int(np.count_nonzero(self.energy.determinants <= FLAT))

    def search(self, way: FloatArray, eps: float, power: int) -> tuple[FloatArray, int]:
        """Minimise the energy from `way` (U, 3); return the end and the number of steps."""

        def function(way: FloatArray) -> tuple[float, FloatArray]:
            value, gradient = self.energy(self.at(way), eps, power)
            return value, self.chart.pull_back(way, gradient) if np.isfinite(value) else gradient

        curvature = self.energy.curvature(self.at(way), eps, power)
        if not np.isfinite(curvature).all():
            return way, 0  # this power of the energy of a nearly flat cell overflows
        with single_threaded_blas():
            end = minimise(function, way, curvature, STEPS, TOLERANCE)
        return end.place, end.steps


def improve(region: RepairRegion, level: float, rest: float) -> tuple[FloatArray, int]:
    """Move a region until its cells reach a level or nothing more is gained; return points (N, 3) and the steps.

    While cells are inverted, eps falls from twice the worst determinant; then the power grows. When only a share `rest`
    of the inverted cells, or of those below the level, remains, the search ends: smaller regions follow.
    """
    way, steps = np.zeros((len(region.unknown), 3)), 0
    least, below = region.least(way), region.below(way, level)
    first = inverted = region.inverted
    eps, vain = max(WIDEST, -2.0 * float(region.energy.determinants.min(initial=0.0))), 0
    while inverted > rest * first and vain < PATIENCE and eps > LEAST_EPS:
        way, count = region.search(way, eps, POWERS[0])
        least, steps = region.least(way), steps + count
        eps *= NARROWER if count == STEPS else NARROWEST
        inverted, vain = region.inverted, 0 if region.inverted < inverted else vain + 1
    if inverted:
        return region.everywhere(way), steps
    easy = int(np.searchsorted(EASY if region.simple else EASY[:1], least))
    for power in chain(POWERS[easy:], repeat(POWERS[-1])):
        if region.below(way, level) <= rest * below:
            break
        way, count = region.search(way, 0.0, power)
        before, least, steps = least, region.least(way), steps + count
        if power == POWERS[-1] and least < before * (1.0 + WORTH):
            break
    return region.everywhere(way), steps
