"""Layers of flat cells on walls: columns of their nodes, and changes of the first layers' heights.

A layer consists of quadrilaterals, prisms and hexahedra, or of polyhedra that are prisms, as OpenFOAM's snappyHexMesh
makes them. Each cell has one face on the wall or on the layer below. Layers of tetrahedra are not found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, count_distinct, distinct, union
from sdm_deflect.base.compiled import compiled_exactly
from sdm_deflect.base.vectors import Vector, cross, dot, minus, norm, plus, row_of

from .affected import AffectedCells
from .cells import Polygons, Polyhedra, Volume, take_faces
from .edges import area_vectors, unit
from .polyhedra import corner_edges

# Faces (lines of plane cells) that may be on a wall, each with the opposite nodes.
BASES = {
    "quad": (((0, 1), (3, 2)), ((1, 2), (0, 3)), ((2, 3), (1, 0)), ((3, 0), (2, 1))),
    "wedge": (((0, 1, 2), (3, 4, 5)), ((3, 4, 5), (0, 1, 2))),
    "hexahedron": (
        ((0, 1, 2, 3), (4, 5, 6, 7)), ((4, 5, 6, 7), (0, 1, 2, 3)), ((0, 1, 5, 4), (3, 2, 6, 7)),
        ((3, 2, 6, 7), (0, 1, 5, 4)), ((0, 3, 7, 4), (1, 2, 6, 5)), ((1, 2, 6, 5), (0, 3, 7, 4)),
    ),
}  # fmt: skip
# Height over the longest edge on the wall, below which a cell belongs to a layer. The layers of snappyHexMesh have 0.1
# to 0.4, its other cells on a wall 0.6 and more.
LAYER_HEIGHT = 0.4
# The same ratio for further layers: a repair that bounded the heights of thicker ones would find no room.
FURTHER_HEIGHT = 0.2
# Number of layers whose heights are compared: wall functions and gradients at the wall use these.
MEASURED = 5
# Least height over the length of a cell's axis: a cell that leans by more than 84 degrees has no height to compare.
LEANING = 0.1


class FlatCells(NamedTuple):
    """Flat cells, each on a face: base and top (C, k), and which nodes (C, k) of the top are in no lower layer."""

    base: IntArray
    top: IntArray
    new: BoolArray


class LayerCells(NamedTuple):
    """Cells of one layer: base and top (C, k), and the wall face (C,) below each."""

    base: IntArray
    top: IntArray
    wall: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class LayerColumns:
    """The layers over walls.

    Attributes
    ----------
    levels : for each layer, from the wall outwards, its nodes and the node below each (K, 2).
    forked : (F,) sorted nodes of the first layer over several wall nodes.
    faces : the wall faces of the first layer.
    cells : cells of the first layers over these faces.
    """

    levels: tuple[IntArray, ...] = field(default=(), repr=False)
    forked: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)
    faces: Polygons = field(default_factory=lambda: _as_polygons([]), repr=False)
    cells: tuple[tuple[LayerCells, ...], ...] = field(default=(), repr=False)

    @classmethod
    def of(cls, affected: AffectedCells, walls: IntArray, kept: int = MEASURED) -> LayerColumns:
        """Collect the layers of flat cells over the nodes of walls (W,), and the cells of the first layers."""
        count = len(affected.mesh.points)
        levels, forked, measured = list[IntArray](), np.empty(0, dtype=np.intp), list[tuple[LayerCells, ...]]()
        faces = _as_polygons([])
        for layer in _layers(affected, walls):
            keys = [(top.astype(np.int64) * count + base)[new] for base, top, new in layer]
            pairs, _ = count_distinct(np.concatenate(keys))
            nodes, times = count_distinct(pairs // count)
            forked = forked if levels else nodes[times > 1]
            once = np.repeat(times == 1, times)
            levels.append(np.column_stack([pairs[once] // count, pairs[once] % count]))
            if not measured:
                faces = _as_polygons([base for base, *_ in layer])
                ends = np.cumsum([0, *(len(base) for base, *_ in layer)])
                rows = (np.arange(a, b) for a, b in pairwise(ends))
                measured.append(tuple(LayerCells(*flat[:2], wall) for flat, wall in zip(layer, rows, strict=True)))
            elif len(measured) < kept:
                measured.append(tuple(_over(measured[-1], layer)))
        return cls(tuple(levels), forked, faces, tuple(measured))

    @property
    def measured(self) -> IntArray:
        """Sorted nodes of the layers whose heights are compared, without the wall's."""
        return union(*(cells.top.ravel() for layer in self.cells for cells in layer))

    def nodes_of(self, face: int) -> IntArray:
        """Return the nodes (k,) of a wall face."""
        return self.faces.rows(face, face + 1).nodes

    def first_height(self, points: FloatArray, feet: BoolArray) -> float:
        """Return the median height of the first layer over `feet`, a mask (N,), at points (N, 3); 0 without layers."""
        edges = np.concatenate([np.empty((0, 2), dtype=np.intp), *self.levels[:1]])
        edges = edges[feet[edges[:, 1]]]
        lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        return float(np.median(lengths)) if len(edges) else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class LayerChange:
    """The change of the columns of cells over some wall faces.

    Attributes
    ----------
    layers : number of measured layers.
    faces : (K,) rows of the wall faces, among `LayerColumns.faces`.
    least, most : (K,) least and largest ratio of a cell's height, along the wall face's normal, to its height before.
    tilts : (K,) largest angle, in degrees, by which a cell above the face turned against it.
    growth : (K,) relative growth of the first layer's height; negative where it is thinner.
    """

    layers: int
    faces: IntArray = field(repr=False)
    least: FloatArray = field(repr=False)
    most: FloatArray = field(repr=False)
    tilts: FloatArray = field(repr=False)
    growth: FloatArray = field(repr=False)

    @property
    def changes(self) -> FloatArray:
        """Largest relative change (K,) of a height."""
        return np.maximum(1.0 - self.least, self.most - 1.0)

    @classmethod
    def of(
        cls, columns: LayerColumns, before: FloatArray, after: FloatArray, walls: BoolArray, normal: FloatArray | None
    ) -> LayerChange:
        """Compare layers at points (N, 3) before and after, over faces whose nodes are all on `walls` (N,).

        A cell's axis goes from the centre of its base to the centre of its top. A plane mesh has a `normal`.
        """
        faces = columns.faces
        frames = _frames(before, faces, normal), _frames(after, faces, normal)
        heights, tilts = np.full((len(faces), 2), [np.inf, -np.inf]), np.zeros(len(faces))
        growth = np.zeros(len(faces))
        for k, layer in enumerate(columns.cells):
            for cells in layer:
                _compare((before, after), frames, (cells.base, cells.top), cells.wall, heights, tilts)
            if not k:
                growth = heights[:, 1] - 1.0
        over = np.logical_and.reduceat(walls[faces.nodes], faces.offsets[:-1]) if len(faces) else np.zeros(0, np.bool_)
        rows = np.flatnonzero(over & np.isfinite(heights[:, 0]))
        return cls(len(columns.cells), rows, heights[rows, 0], heights[rows, 1], tilts[rows], growth[rows])


@compiled_exactly
def _compare(
    points: tuple[FloatArray, FloatArray], frames: tuple[FloatArray, FloatArray], cells: tuple[IntArray, IntArray],
    wall: IntArray, heights: FloatArray, tilts: FloatArray,
) -> None:  # pragma: no cover - machine code  # fmt: skip
    """Extend the range of heights (F, 2) and the tilts (F,) of wall faces by those of the cells above them."""
    base, top = cells
    for i in range(len(wall)):
        was = _axis(points[0], base[i], top[i], frames[0][wall[i]])
        now = _axis(points[1], base[i], top[i], frames[1][wall[i]])
        if abs(was[2]) > LEANING * norm(was):
            share = now[2] / was[2]
            heights[wall[i], 0] = min(heights[wall[i], 0], share)
            heights[wall[i], 1] = max(heights[wall[i], 1], share)
            tilts[wall[i]] = max(tilts[wall[i]], np.degrees(np.arctan2(norm(cross(was, now)), dot(was, now))))


@compiled_exactly
def _axis(
    points: FloatArray, base: IntArray, top: IntArray, frame: FloatArray
) -> Vector:  # pragma: no cover - machine code
    """Return the sum of the edges from a base (k,) to a top (k,), in a frame (3, 3)."""
    out = (0.0, 0.0, 0.0)
    for k in range(len(base)):
        out = plus(out, 1.0, minus(row_of(points, top[k], 0), row_of(points, base[k], 0)))
    return dot(row_of(frame, 0, 0), out), dot(row_of(frame, 1, 0), out), dot(row_of(frame, 2, 0), out)


def _frames(points: FloatArray, faces: Polygons, normal: FloatArray | None) -> FloatArray:
    """Return the axes (F, 3, 3) of each face: along its first edge, across it in the face, and normal to the face.

    The normal of a line is at right angles to it and to the `normal` of the plane mesh.
    """
    first = faces.offsets[:-1]
    along = points[faces.nodes[first + 1]] - points[faces.nodes[first]] if len(faces) else np.empty((0, 3))
    up = unit(np.cross(along, normal) if normal is not None else area_vectors(points, faces))
    along = unit(along - np.einsum("ij,ij->i", along, up)[:, None] * up)
    return np.stack([along, np.cross(up, along), up], axis=1)


def _over(below: Sequence[LayerCells], flat: Sequence[FlatCells]) -> Iterator[LayerCells]:
    """Yield the cells that stand on the tops of the layer below, with their wall faces."""
    keys, wall = (
        np.concatenate([_face_keys(cells.top) for cells in below]),
        np.concatenate([cells.wall for cells in below]),
    )
    order = np.argsort(keys, kind="stable")
    keys, wall = keys[order], wall[order]
    for base, top, _ in flat:
        base_keys = _face_keys(base)
        rank = np.argsort(base_keys, kind="stable")
        place = np.empty_like(rank)
        place[rank] = np.minimum(np.searchsorted(keys, base_keys[rank]), len(keys) - 1)
        on = np.flatnonzero(keys[place] == base_keys)
        yield LayerCells(base[on], top[on], wall[place[on]])


def _face_keys(faces: IntArray) -> NDArray[np.uint64]:
    """Return a number (F,) for the set of nodes of each face (F, k): the sum of the nodes' scrambled numbers.

    SplitMix64 scrambles them (Steele, Lea and Flood 2014), so that different faces hardly ever share a number.
    """
    mixed = faces.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
    return np.asarray((mixed ^ (mixed >> np.uint64(31))).sum(axis=1))


def _as_polygons(faces: list[IntArray]) -> Polygons:
    """Return blocks of faces (F, k) with different k as polygons."""
    sizes = np.concatenate([np.empty(0, dtype=np.intp), *(np.full(len(face), face.shape[1]) for face in faces)])
    nodes = np.concatenate([np.empty(0, dtype=np.intp), *(face.ravel() for face in faces)])
    return Polygons(nodes, np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp))


def _layers(affected: AffectedCells, walls: IntArray) -> Iterator[list[FlatCells]]:
    """Yield the flat cells on the wall nodes (W,), then those of each further layer.

    The last layer has no flat cells on it.
    """
    seen = np.zeros(len(affected.mesh.points), dtype=np.bool_)
    seen[walls] = True
    below, highest = seen.copy(), LAYER_HEIGHT
    parts = [
        (alone(block, rows) if isinstance(block, Polyhedra) else block, rows)
        for block, rows in zip(affected.mesh.cells, affected.rows, strict=True)
        if isinstance(block, Polyhedra) or block.shape in BASES
    ]
    while True:
        flat, left = [], []
        for block, rows in parts:
            cells, rest = _cells_on(block, rows, below)
            left.append((block, rest))
            for base, top in cells:
                new = ~seen[top]
                some = _flat(affected.places, base, top, highest) & new.any(axis=1)
                if some.any():
                    flat.append(FlatCells(base[some], top[some], new[some]))
        if not flat:
            return
        yield flat
        below[:] = False
        for _, top, new in flat:
            below[top[new]] = seen[top[new]] = True
        parts, highest = left, FURTHER_HEIGHT


@compiled_exactly
def _flat(
    points: FloatArray, base: IntArray, top: IntArray, highest: float
) -> BoolArray:  # pragma: no cover - machine code
    """Return which cells (C,) with these bases and tops (C, k) have a ratio of height to width below a limit."""
    out = np.empty(len(base), dtype=np.bool_)
    for i in range(len(base)):
        around = height = 0.0
        for k in range(base.shape[1]):
            here = row_of(points, base[i, k], 0)
            around = max(around, norm(minus(here, row_of(points, base[i, k - 1], 0))))
            height = max(height, norm(minus(row_of(points, top[i, k], 0), here)))
        out[i] = height < highest * around
    return out


def _cells_on(block: Volume, rows: IntArray, wall: BoolArray) -> tuple[list[tuple[IntArray, IntArray]], IntArray]:
    """Return base and top (C, k) of cells with one face on a wall, and the remaining rows.

    Of a block of polyhedra only the rows are returned.
    """
    if isinstance(block, Polyhedra):
        return prisms_on(block, len(rows), wall), rows
    sides = BASES[block.shape]
    side = np.full(len(rows), -1, dtype=np.int8)
    _side_on(block.nodes, rows, wall, np.array([[*base, *top] for base, top in sides]), side)
    cells = []
    for i, (base, top) in enumerate(sides):
        if len(some := np.flatnonzero(side == i)):
            nodes = block.nodes[rows[some]]
            cells.append((nodes[:, list(base)], nodes[:, list(top)]))
    return cells, rows[side < 0]


@compiled_exactly
def _side_on(
    nodes: IntArray, rows: IntArray, wall: BoolArray, sides: IntArray, side: NDArray[np.int8]
) -> None:  # pragma: no cover - machine code
    """Fill in for each row the side, of `sides` (S, 2 k), with its base on the wall and its top off it."""
    half = sides.shape[1] // 2
    for r in range(len(rows)):
        count = 0
        for k in range(nodes.shape[1]):
            count += wall[nodes[rows[r], k]]
        if count != half:
            continue
        for i in range(len(sides)):
            on = 0
            for k in range(half):
                on += wall[nodes[rows[r], sides[i, k]]]
            if on == half:
                side[r] = i
                break


def alone(cells: Polyhedra, rows: IntArray) -> Polyhedra:
    """Return the polyhedra of rows (R,), numbered from 0; one more cell stands for all others."""
    place, inner = np.full(len(cells), len(rows), dtype=np.intp), len(cells.neighbour)
    place[rows] = np.arange(len(rows))
    owner, neighbour = place[cells.owner], place[cells.neighbour]
    wanted = owner < len(rows)
    wanted[:inner] |= neighbour < len(rows)
    faces = take_faces(cells.faces, np.flatnonzero(wanted))
    return Polyhedra(faces, owner[wanted], neighbour[wanted[:inner]])


def prisms_on(cells: Polyhedra, count: int, wall: BoolArray) -> list[tuple[IntArray, IntArray]]:
    """Return base and top (C, k) of the prisms among `count` cells whose base is on a wall, a mask (N,).

    A prism has one face on the wall; an edge joins each node of that face to one opposite node. Triangular
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
    """Return the number of distinct nodes of each cell (C,); a key is cell times number of nodes plus node."""
    return np.bincount(distinct(keys) // nodes, minlength=cells)
