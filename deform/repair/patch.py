"""Nodes that move together: they go to where the cells around them are good."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain, repeat

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.threads import single_threaded_blas
from sdm_deflect.deform.mesh.images import Images
from sdm_deflect.deform.mesh.quality import POLYHEDRON
from sdm_deflect.deform.mesh.sliding import SlidingSurface
from sdm_deflect.deform.repair.columns import Heights
from sdm_deflect.deform.repair.crossing import Crossing, Tracks
from sdm_deflect.deform.repair.elements import PatchElements, Tetrahedra
from sdm_deflect.deform.repair.energy import Energy
from sdm_deflect.deform.repair.freedom import FreeNodes
from sdm_deflect.deform.repair.goal import QualityGoal
from sdm_deflect.deform.repair.minimise import minimise

STEPS, TOLERANCE = 25, 1e-5
"""Of the search at one eps and power: most steps, and the least share by which each has to lower the energy."""
WIDEST, LEAST_EPS = 0.01, 1e-6
"""Least eps at the start, over a target's determinant, and where untangling is given up."""
FLAT = 1e-3
"""Determinant over its target's, up to which an element is untangled: powers of its energy overflow."""
NARROWER, NARROWEST = 0.5, 0.2
"""What is left of eps for the next search; and if this one ended by itself."""
POWERS = (1, 2, 4, 8, 16)
"""Powers of the energy, one after another, once nothing is inverted: the worst cells weigh more and more."""
EASY = (0.35, 0.6, 0.75)
"""Least shares of a cell's quality in its floor, about, from which the first powers are left out; but for tetrahedra,
whose energy is their quality, one power at most."""
WORTH, PATIENCE = 0.005, 8
"""Share by which a search at the largest power has to raise the least quality to be followed by another; searches that
may pass without fewer inverted elements."""


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """Where unknown nodes are, given how far each is to go: those that slide are put on their shapes.

    Attributes
    ----------
    base : (U, 3) where they are to begin with.
    slides : rows (K,) of nodes that slide, and their shapes.
    edges : rows (K,) of nodes that slide along edges, and these.
    heights : of the layers, kept after that.
    images : rows of nodes that go alike.
    """

    base: FloatArray = field(repr=False)
    slides: tuple[tuple[IntArray, SlidingSurface], ...] = field(repr=False)
    edges: tuple[IntArray, Tracks] = field(repr=False)
    heights: Heights
    images: Images = field(default_factory=Images)

    @classmethod
    def of(cls, points: FloatArray, nodes: IntArray, freedom: FreeNodes) -> Chart:
        """Take some of the nodes (U,) that are free to move, at points (N, 3)."""
        slides, edges, order = [], [], np.argsort(nodes)
        for one in freedom.slides:
            own = one.nodes[np.isin(one.nodes, nodes, assume_unique=True)]
            rows = order[np.searchsorted(nodes, own, sorter=order)]
            if isinstance(one.shape, Crossing):
                edges.append((rows, one.shape.tracks(points[own])))
            elif len(own):
                slides.append((rows, one.shape))
        rows = np.concatenate([np.empty(0, dtype=np.intp), *(rows for rows, _ in edges)])
        tracks = Tracks.joined([tracks for _, tracks in edges])
        heights, images = Heights.of(freedom.columns, points, nodes), freedom.images.among(nodes)
        return cls(points[nodes], tuple(slides), (rows, tracks), heights, images)

    def place(self, way: FloatArray) -> FloatArray:
        """Return the places (U, 3)."""
        return self._placed(way)[0]

    def pulled(self, way: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return the gradient (U, 3) by the way, given that by the places."""
        if len(self.heights.rows):
            self.heights.pull(self._placed(way)[1], gradient)
        for rows, shape in self.slides:
            gradient[rows] = shape.rate(self.base[rows], way[rows], gradient[rows])  # a symmetric derivative
        rows, tracks = self.edges
        along = np.einsum("ij,ij->i", gradient[rows], tracks.slope(way[rows]))
        gradient[rows] = along[:, None] * tracks.tangent
        return self.images.projected(gradient)

    def _placed(self, way: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the places (U, 3), and the arms (K, 3) of the layers' nodes."""
        out = self.base + self.images.projected(way)
        for rows, shape in self.slides:
            out[rows] = self.base[rows] + shape.projected(self.base[rows], way[rows])
        rows, tracks = self.edges
        out[rows] = self.base[rows] + tracks.projected(way[rows])
        return out, self.heights.keep(out)


@dataclass(frozen=True, slots=True, eq=False)
class RepairPatch:
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
    goal: QualityGoal = field(repr=False)
    local: FloatArray = field(repr=False)

    @classmethod
    def of(
        cls, points: FloatArray, tetrahedra: Tetrahedra, nodes: IntArray, freedom: FreeNodes, goal: QualityGoal
    ) -> RepairPatch:
        """Let some nodes (U,) move, with the mesh at points (N, 3)."""
        elements = PatchElements.of(tetrahedra, nodes, goal.touched.mesh.points, goal.weights)
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
        """Number of elements that are inverted, or all but flat, at the place last evaluated."""
        return int(np.count_nonzero(self.energy.determinants <= FLAT))

    def search(self, way: FloatArray, eps: float, power: int) -> tuple[FloatArray, int]:
        """Lower the energy, beginning at a way (U, 3); return where that ended, and the steps."""

        def function(way: FloatArray) -> tuple[float, FloatArray]:
            value, gradient = self.energy(self.at(way), eps, power)
            return value, self.chart.pulled(way, gradient) if np.isfinite(value) else gradient

        curvature = self.energy.curvature(self.at(way), eps, power)
        if not np.isfinite(curvature).all():
            return way, 0  # a cell is so flat that this power of its energy overflows
        with single_threaded_blas():
            found = minimise(function, way, curvature, STEPS, TOLERANCE)
        return found.place, found.steps


def mended(patch: RepairPatch, level: float, rest: float) -> tuple[FloatArray, int]:
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
