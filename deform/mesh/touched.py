"""Touched cells: those that a deformation may change, their quality, and the heights of prism layers.

Layers may be polyhedra that are prisms on a wall, like those of OpenFOAM's snappyHexMesh.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray, distinct, union
from sdm_deflect.deform.base.compiled import compiled
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.threads import in_chunks

from . import polyhedra
from .cells import Polyhedra, Volume, take_faces
from .edges import rows_of
from .mesh import Mesh
from .polyhedra import corner_edges
from .quality import Quality, by_shape, check_most, find_orientation, inverted_of, quality_and_inverted
from .standard import parts_of

BASES = {
    "quad": (((0, 1), (3, 2)), ((1, 2), (0, 3)), ((2, 3), (1, 0)), ((3, 0), (2, 1))),
    "wedge": (((0, 1, 2), (3, 4, 5)), ((3, 4, 5), (0, 1, 2))),
    "hexahedron": (
        ((0, 1, 2, 3), (4, 5, 6, 7)), ((4, 5, 6, 7), (0, 1, 2, 3)), ((0, 1, 5, 4), (3, 2, 6, 7)),
        ((3, 2, 6, 7), (0, 1, 5, 4)), ((0, 3, 7, 4), (1, 2, 6, 5)), ((1, 2, 6, 5), (0, 3, 7, 4)),
    ),
}  # fmt: skip
"""Faces (lines of plane cells) that may be on a wall, each with the opposite nodes."""
BLOCK = 1 << 16
WEIGHT = 10
"""Work on the nodes of one cell in kernel pairs, by which `in_chunks` divides it."""
LAYER_HEIGHT = 0.4
"""Height over the longest edge on the wall, below which a cell belongs to a layer. The layers of snappyHexMesh have 0.1
to 0.4, its other cells on a wall 0.6 and more."""
FURTHER_HEIGHT = 0.2
"""The same ratio for further layers: a repair that kept the heights of thicker ones would find no room."""
FLAT = 1e-6
"""Quality up to which a cell is flat but for rounding."""
THICK_HEIGHT = 0.1
"""The same ratio, above which heights follow the wall less closely."""
LAYER_CHANGE, THICK_CHANGE = 0.01, 0.1
"""Largest allowed relative change of the first layer's height; of cells above `THICK_HEIGHT`."""


def alone(cells: Polyhedra, rows: IntArray) -> Polyhedra:
    """Return rows (R,) of cells with all their faces, numbered from 0; one more cell stands for all others."""
    place, inner = np.full(len(cells), len(rows), dtype=np.intp), len(cells.neighbour)
    place[rows] = np.arange(len(rows))
    owner, neighbour = place[cells.owner], place[cells.neighbour]
    wanted = owner < len(rows)
    wanted[:inner] |= neighbour < len(rows)
    faces = take_faces(cells.faces, np.flatnonzero(wanted))
    return Polyhedra(faces, owner[wanted], neighbour[wanted[:inner]])


def prisms_on(cells: Polyhedra, count: int, wall: BoolArray) -> list[tuple[IntArray, IntArray]]:
    """Return the nodes (C, k) on a wall, a mask (N,), and the opposite ones (C, k), of prisms among `count` cells.

    A prism has one face on the wall, and one opposite node for each node of that face, joined by an edge. Triangular
    prisms come first, then those on quadrilaterals, and so on.
    """
    if not len(cells.faces):
        return []
    faces, inner = cells.faces, len(cells.neighbour)
    face = np.flatnonzero(np.logical_and.reduceat(wall[faces.nodes], faces.offsets[:-1]))
    back = face[face < inner]
    base, cell = np.concatenate([face, back]), np.concatenate([cells.owner[face], cells.neighbour[back]])
    base, cell = base[cell < count], cell[cell < count]
    order = np.argsort(cell, kind="stable")
    base, cell = base[order], cell[order]
    once = np.bincount(cell, minlength=count)[cell] == 1
    base, cell = base[once], cell[once]
    size = np.diff(faces.offsets)[base]
    start, end, place = corner_edges(cells, cell)
    leaves = wall[start] & ~wall[end]
    nodes, key = len(wall), place * len(wall)
    columns = [_per_cell(key + start, nodes, len(cell)), _per_cell((key + end)[leaves], nodes, len(cell))]
    columns += [_per_cell((key + start)[leaves], nodes, len(cell)), np.bincount(place[leaves], minlength=len(cell))]
    whole = (columns[0] == 2 * size) & np.logical_and.reduce([column == size for column in columns[1:]])
    rising = np.argsort((key + start)[leaves])
    feet, tips = (key + start)[leaves][rising], end[leaves][rising]
    prisms = []
    for k in distinct(size[whole]):
        rows = np.flatnonzero(whole & (size == k))
        on = faces.nodes[faces.offsets[base[rows]][:, None] + np.arange(k)]
        prisms.append((on, tips[np.searchsorted(feet, rows[:, None] * nodes + on)]))
    return prisms


def _per_cell(keys: IntArray, nodes: int, cells: int) -> IntArray:
    """Return the number of distinct nodes of each cell (C,); a key is cell times number of nodes, plus node."""
    return np.bincount(distinct(keys) // nodes, minlength=cells)


class CellScores(NamedTuple):
    """Quality (C,) of cells by the measure of their type, and which (C,) are inverted."""

    quality: FloatArray
    inverted: BoolArray

    def with_scores(self, cells: BoolArray, scores: CellScores) -> CellScores:
        """Return the scores with those of some cells, a mask (C,), replaced."""
        quality, inverted = self.quality.copy(), self.inverted.copy()
        quality[cells], inverted[cells] = scores
        return CellScores(quality, inverted)


@dataclass(frozen=True, eq=False)
class TouchedCells:
    """Cells with a node that may move.

    Attributes
    ----------
    mesh : The undeflected mesh.
    rows : For each block the rows of touched cells.
    orientation : For each block 1, or -1 if most of its cells have left-handed nodes.
    inverted : For each block the number of inverted cells of the whole undeflected mesh.
    places : (N, 3) nodes by which heights and widths are measured: of a mesh one cell thick those in its plane.
    """

    mesh: Mesh
    rows: tuple[IntArray, ...] = field(repr=False)
    orientation: tuple[float, ...]
    inverted: tuple[int, ...]
    places: FloatArray = field(repr=False)

    @classmethod
    def of(cls, mesh: Mesh, inside: IntArray, places: FloatArray | None = None) -> TouchedCells:
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
    def together(cls, parts: Sequence[TouchedCells]) -> TouchedCells:
        """Join the touched cells of several boxes in one mesh."""
        rows = zip(*(part.rows for part in parts), strict=True)
        return parts[0] if len(parts) == 1 else replace(parts[0], rows=tuple(union(*own) for own in rows))

    @property
    def count(self) -> int:
        """Number of touched cells."""
        return sum(len(rows) for rows in self.rows)

    @cached_property
    def before(self) -> CellScores:
        """Scores of the touched cells in the undeflected mesh."""
        return self.scores(self.mesh.points)

    def scores(self, points: FloatArray) -> CellScores:
        """Judge the touched cells with the nodes at `points` (N, 3), block by block."""
        parts = zip(self.mesh.cells, self.rows, self.orientation, strict=True)
        scored = [quality_and_inverted(points, *part) for part in parts if len(part[1])]
        quality = np.concatenate([np.empty(0), *(values for values, _ in scored)])
        return CellScores(quality, np.concatenate([np.empty(0, np.bool_), *(bad for _, bad in scored)]))

    def newly_inverted(self, points: FloatArray) -> BoolArray:
        """Return which touched cells (C,) are newly inverted with the nodes at `points` (N, 3)."""
        parts = zip(self.mesh.cells, self.rows, self.orientation, strict=True)
        inverted = np.concatenate([np.empty(0, np.bool_), *(inverted_of(points, *part) for part in parts)])
        return inverted & ~self.before.inverted if any(self.inverted) else inverted

    def by_shape(self) -> Iterator[tuple[str, BoolArray]]:
        """Yield each type of touched cells, and which (C,) have it."""
        masks, start = dict[str, BoolArray](), 0
        for block, rows in zip(self.mesh.cells, self.rows, strict=True):
            for name, _, _, own in parts_of(block, rows):
                masks.setdefault(name, np.zeros(self.count, dtype=np.bool_))[start : start + len(rows)][own] = True
            start += len(rows)
        yield from masks.items()

    def least(self, points: FloatArray, quality: Sequence[Quality]) -> tuple[Least, ...]:
        """Return the least quality by type of the cells that were neither inverted nor flat before.

        Parameters
        ----------
        points : (N, 3) coordinates of the nodes.
        quality : Quality there of all touched cells, by type.
        """
        if all(summary.min > FLAT and not summary.inverted for summary in self.quality_before):
            return tuple(Least(summary.min, summary.cells) for summary in quality)
        good, now = ~self.before.inverted & (self.before.quality > FLAT), self.scores(points).quality
        kept = [now[good & cells] for _, cells in self.by_shape()]
        return tuple(Least(float(values.min(initial=np.inf)), len(values)) for values in kept)

    @cached_property
    def quality_before(self) -> tuple[Quality, ...]:
        """Quality of the touched cells in the undeflected mesh, by type."""
        return self.quality(self.mesh.points)

    def quality(self, points: FloatArray) -> tuple[Quality, ...]:
        """Return the quality of the touched cells by type, with the nodes at `points` (N, 3)."""
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


@dataclass(frozen=True, slots=True)
class Layers:
    """Change of the first layer's height, the length of edges that leave the wall.

    Attributes
    ----------
    edges : number of these edges, counted for each cell.
    lowest : smallest height before.
    largest, p99 : largest relative change, and its 99th percentile.
    thick : whether the figures are of thick cells; of thin and thick ones those nearer to their limit are given.
    """

    edges: int
    lowest: float
    largest: float
    p99: float
    thick: bool = False

    @property
    def limit(self) -> float:
        """Largest allowed relative change."""
        return THICK_CHANGE if self.thick else LAYER_CHANGE


class LayerEdges(NamedTuple):
    """Edges that leave a wall, or a layer over it.

    Attributes
    ----------
    starts, ends : (E,) start and end nodes.
    thick : (E,) whether the cell is higher than `THICK_HEIGHT` of its longest edge on the wall.
    """

    starts: IntArray
    ends: IntArray
    thick: NDArray[np.bool_]


def first_layer(touched: TouchedCells, walls: IntArray, points: FloatArray) -> Layers | None:
    """Compare the heights over wall nodes (W,) with those at `points` (N, 3); None without a layer."""
    edges = next(layers(touched, walls), None)
    if edges is None:
        return None
    low, after = (np.linalg.norm(at[edges.ends] - at[edges.starts], axis=1) for at in (touched.mesh.points, points))
    change = np.abs(after / low - 1.0)
    groups = [
        Layers(len(own), float(low[cells].min()), float(own.max()), float(np.percentile(own, 99.0)), thick)
        for thick, cells in ((False, ~edges.thick), (True, edges.thick))
        if len(own := change[cells])
    ]
    return max(groups, key=lambda group: group.largest / group.limit)


def layers(touched: TouchedCells, walls: IntArray) -> Iterator[LayerEdges]:
    """Yield the edges that leave the wall nodes (W,) and each further layer.

    Edges are those of flat cells, counted for each cell; the last layer has no flat cells on it.
    """
    seen = np.zeros(len(touched.mesh.points), dtype=np.bool_)
    seen[walls] = True
    below, highest = seen.copy(), LAYER_HEIGHT
    parts = [
        (alone(block, rows) if isinstance(block, Polyhedra) else block, rows)
        for block, rows in zip(touched.mesh.cells, touched.rows, strict=True)
        if isinstance(block, Polyhedra) or block.shape in BASES
    ]
    while True:
        found = [
            _edges(touched.places, base, top, highest)
            for block, rows in parts
            for base, top in _first_cells(block, rows, below)
        ]
        if not found:
            return
        starts, ends, thick = (np.concatenate(part) for part in zip(*found, strict=True))
        new = ~seen[ends]
        if not new.any():
            return
        yield LayerEdges(starts[new], ends[new], thick[new])
        below[:] = False
        below[ends[new]] = seen[ends[new]] = True
        highest = FURTHER_HEIGHT


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


def _first_cells(block: Volume, rows: IntArray, wall: NDArray[np.bool_]) -> list[tuple[IntArray, IntArray]]:
    """Return the nodes (C, k) on the wall, and the opposite ones (C, k), of cells with one face on the wall.

    A block of polyhedra has the rows only.
    """
    if isinstance(block, Polyhedra):
        return prisms_on(block, len(rows), wall)
    cells = []
    for part in rows_of(len(rows), BLOCK):
        nodes = block.nodes[rows[part]]
        on = wall[nodes]
        for base, top in BASES[block.shape]:
            first = on[:, list(base)].all(axis=1) & ~on[:, list(top)].any(axis=1)
            if first.any():
                cells.append((nodes[first][:, list(base)], nodes[first][:, list(top)]))
    return cells


def _edges(points: FloatArray, base: IntArray, top: IntArray, highest: float) -> LayerEdges:
    """Return the edges between nodes (C, k) on a wall and opposite ones, of cells up to a ratio of height to width."""
    around = np.linalg.norm(points[base] - points[np.roll(base, 1, axis=1)], axis=2).max(axis=1)
    height = np.linalg.norm(points[top] - points[base], axis=2).max(axis=1)
    flat = height < highest * around
    thick = np.repeat((height > THICK_HEIGHT * around)[flat], base.shape[1])
    return LayerEdges(base[flat].ravel(), top[flat].ravel(), thick)
