"""Which nodes a repair may move, and on what they have to stay.

Columns of layers: each node keeps its distance from the node below it, wherever that goes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray, distinct, union
from sdm_deflect.deform.base.compiled import compiled_exactly, dot, minus, norm, plus, row_of
from sdm_deflect.deform.mesh.cells import Patch, Polygons
from sdm_deflect.deform.mesh.edges import Joints, area_vectors, polygons_of, unit
from sdm_deflect.deform.mesh.images import Images
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.sliding import FITTED, SHARP, SURFACE, Plane, SlidingSurface, Triangulated
from sdm_deflect.deform.mesh.touched import TouchedCells, layers

from .elements import Crossing

TURNS = {"plane": 1e-5, SURFACE: 2.0 * np.sin(np.radians(SHARP / 2.0))}
"""Difference of the normals of two faces on both sides of an edge that is within a plane, or a surface."""
FLAT = 1e-9
"""Of a patch's size: how far nodes of a plane face may be off it."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Slide:
    """Nodes (K,) that stay on a shape, and the plane faces that they may not leave."""

    nodes: IntArray = field(repr=False)
    shape: SlidingSurface
    faces: tuple[Polygons, ...] = field(default=(), repr=False)


class SlidingPiece(NamedTuple):
    """A part of the boundary: its shape, if nodes slide on it, whether they do so along edges, and a plane's faces."""

    shape: SlidingSurface | None
    edges: bool = False
    faces: tuple[Polygons, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class FreeNodes:
    """The nodes that may move: `free` (F,) anywhere, others on their shapes; each is in one place at most.

    Those of `columns` keep their distances from the nodes below them, too, and `images` of one another move alike: all
    nodes of their groups are free.
    """

    free: IntArray = field(repr=False)
    slides: tuple[Slide, ...] = field(repr=False)
    columns: Columns = field(default_factory=Columns, repr=False)
    images: Images = field(default_factory=Images, repr=False)

    @property
    def nodes(self) -> IntArray:
        """Sorted indices (K,) of all of them."""
        return union(self.free, self.sliding)

    @property
    def sliding(self) -> IntArray:
        """Sorted indices (K,) of those on shapes."""
        return union(*(one.nodes for one in self.slides))

    @classmethod
    def of(
        cls,
        mesh: Mesh,
        points: FloatArray,
        inside: BoolArray,
        free: IntArray,
        shapes: Mapping[str, SlidingSurface | str],
        images: Images | None = None,
        within: Sequence[tuple[IntArray, SlidingSurface]] = (),
    ) -> FreeNodes:
        """Find on what the boundary's nodes inside may slide.

        A node within a face slides on it, one on the edge of two surfaces, of two planes or of a plane and a cylinder
        along it; other edges and corners stay, and nodes on a patch of no shape.

        Parameters
        ----------
        points : (N, 3) where the nodes are.
        inside : (N,) the nodes that may move at all.
        free : (F,) those of them that are within the flow.
        shapes : Of patches: a shape; or its name. A ``"plane"`` is each part of the patch that is plane before the
            deflection and still is; a ``"surface"`` each part between edges that were sharp, as it is at `points`, so
            that a node of a thin body stays on its side. The whole patch is a ``"cylinder"``, fitted to its nodes.
        images : Of free nodes: those that move alike.
        within : Free nodes (K,), and the shape on which they stay.
        """
        pieces: list[SlidingPiece] = []
        pairs = [np.empty((0, 2), dtype=np.intp)]
        for patch in mesh.patches:
            if inside[patch.nodes].any():
                pairs += _pieces(mesh, patch, points, inside, shapes.get(patch.name), pieces)
        for kept, on in within:
            pairs.append(_on(kept[inside[kept]], pieces, SlidingPiece(on)))
            free = np.setdiff1d(free, kept, assume_unique=True)
        found = np.unique(np.concatenate(pairs), axis=0)
        nodes, first, count = np.unique(found[:, 0], return_index=True, return_counts=True)
        rim = np.array([piece.edges for piece in pieces], dtype=np.bool_)
        last = np.append(first[1:], len(found)) - 1
        same = (count == 1) | ((count == 2) & rim[found[first, 1]] & rim[found[last, 1]])
        slides = [
            Slide(nodes[same & (found[first, 1] == k)], piece.shape, piece.faces)
            for k, piece in enumerate(pieces)
            if piece.shape is not None and (same & (found[first, 1] == k)).any()
        ]
        edge = (count == 2) & ~same & (not mesh.plane)  # where two lines meet is a corner
        for k, other in np.unique(np.column_stack([found[first, 1], found[last, 1]])[edge], axis=0):
            shape = Crossing.of(pieces[k].shape, pieces[other].shape)
            if shape is not None:
                own = edge & (found[first, 1] == k) & (found[last, 1] == other)
                slides.append(Slide(nodes[own], shape, pieces[k].faces + pieces[other].faces))
        return cls(free, tuple(slides), images=images or Images())

    def left_by(self, start: FloatArray, points: FloatArray) -> tuple[Slide, ...]:
        """Return the slides on plane faces that some nodes left on the way from points (N, 3) `start` to `points`.

        As long as no polygon of a face is turned over, and its rim stays on its curves, all nodes are within the rim.
        """

        def moved(one: Slide) -> bool:
            return not np.array_equal(points[one.nodes], start[one.nodes])

        return tuple(one for one in self.slides if moved(one) and any(_folded(start, points, f) for f in one.faces))

    def without(self, some: tuple[Slide, ...]) -> FreeNodes:
        """Return the same without the nodes of some of the slides."""
        return replace(self, slides=tuple(one for one in self.slides if one not in some))

    def closed(self, nodes: IntArray, size: int) -> IntArray:
        """Return sorted nodes (K,) with all that move with them; `size` is the number of nodes of the mesh."""
        while True:
            found = self.columns.closed(nodes, size)
            if not len(self.images.nodes):
                return found
            found = self.images.closed(found, size)
            if len(found) == len(nodes):
                return found
            nodes = found

    def with_columns(self, columns: Columns, points: FloatArray) -> FreeNodes:
        """Return the same with the heights of layers kept, the nodes at points (N, 3).

        A node of the first layer stays if it is over several nodes of the walls, or slides on another shape than a
        plane through the node below; those of further layers then follow their shape alone.
        """
        anywhere = np.zeros(len(points), dtype=np.bool_)
        anywhere[self.free] = True
        levels = []
        for pairs in columns.levels:
            kept = anywhere[pairs[:, 0]]
            for one in self.slides:
                if isinstance(one.shape, Plane):
                    near = FLAT * float(np.ptp(points[one.nodes], axis=0).max())
                    kept |= np.isin(pairs[:, 0], one.nodes) & (np.abs(one.shape.distance(points[pairs[:, 1]])) <= near)
            levels.append(pairs[kept])
        first = np.concatenate([columns.forked, *(pairs[:, 0] for pairs in columns.levels[:1])])
        stay = np.setdiff1d(first, levels[0][:, 0]) if levels else first
        images = self.images
        if len(images.nodes):
            stay = images.closed(stay, len(points))
            levels = [pairs[np.isin(pairs[:, 0], stay, invert=True)] for pairs in levels]
            anywhere[:] = True
            anywhere[stay] = False
            images = images.within(anywhere)
        slides = tuple(
            Slide(np.setdiff1d(one.nodes, stay, assume_unique=True), one.shape, one.faces) for one in self.slides
        )
        free = np.setdiff1d(self.free, stay, assume_unique=True)
        return FreeNodes(free, slides, Columns(tuple(levels)), images)


def _pieces(
    mesh: Mesh,
    patch: Patch,
    points: FloatArray,
    inside: BoolArray,
    shape: SlidingSurface | str | None,
    pieces: list[SlidingPiece],
) -> list[IntArray]:
    """Add the faces of a patch to `pieces`; return which of its nodes inside are on which, as pairs (P, 2)."""
    if shape in TURNS and patch.faces:
        found = [_on(patch.loose[inside[patch.loose]], pieces, SlidingPiece(None))]
        for part in _parts(patch, mesh.points, inside, TURNS[str(shape)]):
            nodes = distinct(part.nodes)
            piece = (
                SlidingPiece(Triangulated.of(points, part), True) if shape == SURFACE else _plane(mesh, points, part)
            )
            found.append(_on(nodes[inside[nodes]], pieces, piece))
        return found
    if isinstance(shape, str):
        shape = FITTED[shape](points[patch.nodes], mesh.normal)
    return [_on(patch.nodes[inside[patch.nodes]], pieces, SlidingPiece(shape))]


def _plane(mesh: Mesh, points: FloatArray, face: Polygons) -> SlidingPiece:
    """Return a face that was plane before the deflection, of no shape if it is so no more."""
    nodes = distinct(face.nodes)
    plane, size = Plane.fitted(points[nodes], mesh.normal), float(np.ptp(points[nodes], axis=0).max())
    flat = len(nodes) > (2 if mesh.plane else 3) and float(np.abs(plane.distance(points[nodes])).max()) <= FLAT * size
    return SlidingPiece(plane, faces=(face,)) if flat else SlidingPiece(None)


def _folded(start: FloatArray, points: FloatArray, face: Polygons) -> bool:
    """True if a polygon of a plane face turned over on the way from points (N, 3) `start` to `points`."""
    before = area_vectors(start, face)
    normal = before.sum(axis=0)
    return bool(((area_vectors(points, face) @ normal <= 0.0) & (before @ normal > 0.0)).any())


def _on(nodes: IntArray, pieces: list[SlidingPiece], piece: SlidingPiece) -> IntArray:
    pieces.append(piece)
    return np.column_stack([nodes, np.full(len(nodes), len(pieces) - 1)])


def _parts(patch: Patch, points: FloatArray, inside: BoolArray, turn: float) -> Iterator[Polygons]:
    """Yield the parts of a patch with nodes inside: faces that share edges, beside which normals differ by less."""
    faces = polygons_of(patch.faces)
    labels = _regions(faces, unit(area_vectors(points, faces)), turn)
    sizes = np.diff(faces.offsets)
    near = np.unique(labels[np.repeat(np.arange(len(faces)), sizes)[inside[faces.nodes]]])
    for label in near:
        own = labels == label
        nodes = faces.nodes[np.repeat(own, sizes)]
        yield Polygons(nodes, np.concatenate([[0], np.cumsum(sizes[own])]).astype(np.intp))


def _regions(faces: Polygons, normals: FloatArray, turn: float) -> IntArray:
    """Return a label (F,) for each face: equal for those joined by edges beside which normals (F, 3) differ by less."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # takes a while to load

    _, a, b, _ = Joints.of(faces)
    alike = np.linalg.norm(normals[a] - normals[b], axis=1) < turn
    graph = coo_array((np.ones(int(alike.sum())), (a[alike], b[alike])), shape=(len(faces), len(faces)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)
