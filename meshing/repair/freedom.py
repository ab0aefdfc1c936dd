"""Nodes that a repair may move, and the shapes and columns that bind them.

A column has the nodes of all layers over one wall node. Near the wall each node keeps its distance from the node below;
farther out this distance is bounded.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, distinct, union
from sdm_deflect.base.compiled import compiled_exactly
from sdm_deflect.base.vectors import dot, minus, norm, plus, row_of
from sdm_deflect.meshing.mesh.cells import Patch, Polygons
from sdm_deflect.meshing.mesh.edges import Joints, area_vectors, polygons_of, unit
from sdm_deflect.meshing.mesh.images import Images
from sdm_deflect.meshing.mesh.layers import LayerColumns
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.sliding import FITTED, SHARP, SURFACE, Plane, SlidingSurface, Triangulated

from .elements import IntersectionCurve

# Largest difference of the normals beside an edge inside a plane, and inside a surface.
TURNS = {"plane": 1e-5, SURFACE: 2.0 * np.sin(np.radians(SHARP / 2.0))}
# Least and largest height of an outer layer after a repair, as shares of its height before the deflection. Solvers with
# wall models expect heights to grow steadily: beyond these the growth of neighbours would double.
BOUNDS = (0.5, 2.0)
# Largest distance of nodes from their plane face, as a share of the patch's size.
FLAT = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Nodes of layers whose heights are bounded.

    Attributes
    ----------
    pairs : for each layer, from the wall outwards, its nodes and the node below each (K, 2).
    lengths : for each layer the least and the largest length (K, 2) of the edges of these pairs.
    kept : sorted nodes (R,) that stay while moves of other nodes suffice: those of measured layers, and of layers that
        follow the wall rigidly.
    """

    pairs: tuple[IntArray, ...] = field(default=(), repr=False)
    lengths: tuple[FloatArray, ...] = field(default=(), repr=False)
    kept: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)

    @classmethod
    def of(
        cls, levels: Sequence[IntArray], rigid: IntArray, measured: IntArray, before: FloatArray, now: FloatArray
    ) -> Columns:
        """Return the columns of pairs (K, 2) of nodes, at points (N, 3) before and now.

        Edges to nodes of `rigid` (R,) keep their length. The length of others stays within `BOUNDS` of that before, or
        of that now.
        """
        lengths = []
        for pairs in levels:
            was, own = (np.linalg.norm(at[pairs[:, 0]] - at[pairs[:, 1]], axis=1) for at in (before, now))
            low, high = np.minimum(BOUNDS[0] * was, own), np.maximum(BOUNDS[1] * was, own)
            exact = np.isin(pairs[:, 0], rigid)
            lengths.append(np.column_stack([np.where(exact, own, low), np.where(exact, own, high)]))
        nodes = union(*(pairs[:, 0] for pairs in levels))
        return cls(tuple(levels), tuple(lengths), np.intersect1d(nodes, union(rigid, measured), assume_unique=True))

    def without(self, nodes: IntArray) -> Columns:
        """Return the columns without some nodes (K,), which stay."""
        stay = [np.isin(pairs[:, 0], nodes) for pairs in self.pairs]
        pairs = tuple(pair[~rows] for pair, rows in zip(self.pairs, stay, strict=True))
        lengths = tuple(length[~rows] for length, rows in zip(self.lengths, stay, strict=True))
        return Columns(pairs, lengths, np.setdiff1d(self.kept, nodes, assume_unique=True))

    def closure(self, nodes: IntArray, size: int) -> IntArray:
        """Return sorted nodes (K,) with all nodes above them; `size` is the number of nodes of the mesh."""
        mark = np.zeros(size, dtype=np.bool_)
        mark[nodes] = True
        for pairs in self.pairs:
            mark[pairs[mark[pairs[:, 1]], 0]] = True
        return np.flatnonzero(mark)


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Heights of layers that are kept while their K nodes move; nodes are sorted from the wall outwards.

    Attributes
    ----------
    rows, below : (K,) rows of the nodes, and of the nodes below; -1 if the node below stays.
    fixed : (K, 3) places of the nodes below that stay.
    arms : (K, 3) vectors from the nodes below to the nodes, at first.
    lengths : (K, 2) least and largest length of an arm.
    """

    rows: IntArray = field(repr=False)
    below: IntArray = field(repr=False)
    fixed: FloatArray = field(repr=False)
    arms: FloatArray = field(repr=False)
    lengths: FloatArray = field(repr=False)

    @classmethod
    def of(cls, columns: Columns, points: FloatArray, nodes: IntArray) -> Heights:
        """Return the heights of columns for moving nodes (U,), at points (N, 3)."""
        place = np.full(len(points), -1, dtype=np.intp)
        place[nodes] = np.arange(len(nodes))
        pairs = np.concatenate([np.empty((0, 2), dtype=np.intp), *columns.pairs])
        some = place[pairs[:, 0]] >= 0
        above, below = pairs[some].T
        lengths = np.concatenate([np.empty((0, 2)), *columns.lengths])[some]
        return cls(place[above], place[below], points[below], points[above] - points[below], lengths)

    def keep(self, places: FloatArray) -> FloatArray:
        """Move places (U, 3) along the line from the node below until lengths fit; return the arms (K, 3) before that.

        Nodes with unchanged arms keep their bits.
        """
        arms = np.empty_like(self.arms)
        _keep(self.rows, self.below, self.fixed, self.arms, self.lengths, places, arms)
        return arms

    def pull(self, arms: FloatArray, gradient: FloatArray) -> None:
        """Convert the gradient (U, 3) by the places after `keep` to that by places before; `arms` come from `keep`."""
        _pull(self.rows, self.below, self.lengths, arms, gradient)


@compiled_exactly
def _keep(
    rows: IntArray, below: IntArray, fixed: FloatArray, arms: FloatArray, lengths: FloatArray, places: FloatArray,
    out: FloatArray,
) -> None:  # pragma: no cover - machine code  # fmt: skip
    for k in range(len(rows)):
        foot = row_of(places, below[k], 0) if below[k] >= 0 else row_of(fixed, k, 0)
        before, arm = row_of(arms, k, 0), minus(row_of(places, rows[k], 0), foot)
        for c in range(3):
            out[k, c] = arm[c]
        length = norm(arm)
        if arm != before and not lengths[k, 0] < length < lengths[k, 1]:
            stretch = min(max(length, lengths[k, 0]), lengths[k, 1]) / length
            for c in range(3):
                places[rows[k], c] = foot[c] + stretch * arm[c]


@compiled_exactly
def _pull(
    rows: IntArray, below: IntArray, lengths: FloatArray, arms: FloatArray, gradient: FloatArray
) -> None:  # pragma: no cover - machine code
    for k in range(len(rows) - 1, -1, -1):
        arm, whole = row_of(arms, k, 0), row_of(gradient, rows[k], 0)
        length = norm(arm)
        if lengths[k, 0] < length < lengths[k, 1]:
            continue
        outward = (arm[0] / length, arm[1] / length, arm[2] / length)
        across = plus(whole, -dot(whole, outward), outward)
        stretch = min(max(length, lengths[k, 0]), lengths[k, 1]) / length
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
    """A part of the boundary: its shape, whether nodes may slide along its edges, and its faces if it is plane."""

    shape: SlidingSurface | None
    edges: bool = False
    faces: tuple[Polygons, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class FreeNodes:
    """Nodes that may move: `free` (F,) in all directions, others on shapes; no node occurs twice.

    Distances between nodes of `columns` are bound; nodes of a group of `images` move alike.
    """

    free: IntArray = field(repr=False)
    slides: tuple[Slide, ...] = field(repr=False)
    columns: Columns = field(default_factory=Columns, repr=False)
    images: Images = field(default_factory=Images, repr=False)

    @property
    def nodes(self) -> IntArray:
        """Sorted indices (K,) of all nodes that may move."""
        return union(self.free, self.sliding)

    @property
    def sliding(self) -> IntArray:
        """Sorted indices (K,) of the nodes on shapes."""
        return union(*(slide.nodes for slide in self.slides))

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
        """Find the shapes on which the boundary nodes inside may slide.

        A node inside a face slides on it. A node on the edge of two planes, or of a plane and a cylinder, slides along
        it. Nodes on other edges, at corners, and on patches without a shape stay.

        Parameters
        ----------
        points : (N, 3) coordinates of the nodes.
        inside : (N,) whether a node may move at all.
        free : (F,) nodes inside the flow among them.
        shapes : For each patch a shape, or its name. ``"plane"`` is each part of the patch that was plane before the
            deflection and still is. ``"surface"`` is each part between sharp edges, as it is at `points`, so
            that a node of a thin body stays on its side. ``"cylinder"`` is fitted to the nodes of the whole patch.
        images : Free nodes that move like their images.
        within : Free nodes (K,) with the shape on which they stay.
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
        edge = (count == 2) & ~same & (not mesh.plane)  # two lines meet at a corner
        for k, other in np.unique(np.column_stack([found[first, 1], found[last, 1]])[edge], axis=0):
            shape = IntersectionCurve.of(pieces[k].shape, pieces[other].shape)
            if shape is not None:
                own = edge & (found[first, 1] == k) & (found[last, 1] == other)
                slides.append(Slide(nodes[own], shape, pieces[k].faces + pieces[other].faces))
        return cls(free, tuple(slides), images=images or Images())

    def slides_left_by(self, start: FloatArray, points: FloatArray) -> tuple[Slide, ...]:
        """Return the slides on plane faces that nodes left between `start` (N, 3) and `points` (N, 3).

        While no polygon of a face is reversed, and its rim stays on its curves, all nodes are inside the rim.
        """

        def moved(bound: Slide) -> bool:
            return not np.array_equal(points[bound.nodes], start[bound.nodes])

        return tuple(
            slide for slide in self.slides if moved(slide) and any(_folds(start, points, f) for f in slide.faces)
        )

    def without(self, some: tuple[Slide, ...]) -> FreeNodes:
        """Return the free nodes without some of the slides."""
        return replace(self, slides=tuple(slide for slide in self.slides if slide not in some))

    def closure(self, nodes: IntArray, size: int) -> IntArray:
        """Return sorted nodes (K,) with all nodes that move with them; `size` is the number of nodes of the mesh."""
        while True:
            joined = self.columns.closure(nodes, size)
            if not len(self.images.nodes):
                return joined
            joined = self.images.closure(joined, size)
            if len(joined) == len(nodes):
                return joined
            nodes = joined

    def without_nodes(self, nodes: IntArray) -> FreeNodes:
        """Return the free nodes without some nodes (K,), which stay."""
        slides = tuple(
            replace(slide, nodes=np.setdiff1d(slide.nodes, nodes, assume_unique=True)) for slide in self.slides
        )
        free = np.setdiff1d(self.free, nodes, assume_unique=True)
        return replace(self, free=free, slides=slides, columns=self.columns.without(nodes))

    def with_columns(self, columns: LayerColumns, rigid: IntArray, before: FloatArray, points: FloatArray) -> FreeNodes:
        """Return the free nodes with the heights of layers bounded (`Columns.of`), with the mesh at points (N, 3).

        A node of the first layer stays if it is over several wall nodes, or slides on a shape other than a plane
        through the node below. Nodes of further layers over it then follow their shape alone.
        """
        anywhere = np.zeros(len(points), dtype=np.bool_)
        anywhere[self.free] = True
        levels = []
        for pairs in columns.levels:
            kept = anywhere[pairs[:, 0]]
            for slide in self.slides:
                if isinstance(slide.shape, Plane):
                    near = FLAT * float(np.ptp(points[slide.nodes], axis=0).max())
                    kept |= np.isin(pairs[:, 0], slide.nodes) & (
                        np.abs(slide.shape.distance(points[pairs[:, 1]])) <= near
                    )
            levels.append(pairs[kept])
        first = np.concatenate([columns.forked, *(pairs[:, 0] for pairs in columns.levels[:1])])
        stay = np.setdiff1d(first, levels[0][:, 0]) if levels else first
        images = self.images
        if len(images.nodes):
            stay = images.closure(stay, len(points))
            levels = [pairs[np.isin(pairs[:, 0], stay, invert=True)] for pairs in levels]
            anywhere[:] = True
            anywhere[stay] = False
            images = images.within(anywhere)
        slides = tuple(
            Slide(np.setdiff1d(slide.nodes, stay, assume_unique=True), slide.shape, slide.faces)
            for slide in self.slides
        )
        free = np.setdiff1d(self.free, stay, assume_unique=True)
        return FreeNodes(free, slides, Columns.of(levels, rigid, columns.measured, before, points), images)


def _pieces(
    mesh: Mesh,
    patch: Patch,
    points: FloatArray,
    inside: BoolArray,
    shape: SlidingSurface | str | None,
    pieces: list[SlidingPiece],
) -> list[IntArray]:
    """Add the faces of a patch to `pieces`; return pairs (P, 2) of a node inside and its piece."""
    if shape in TURNS and patch.faces:
        pairs = [_on(patch.loose[inside[patch.loose]], pieces, SlidingPiece(None))]
        for part in _parts(patch, mesh.points, inside, TURNS[str(shape)]):
            nodes = distinct(part.nodes)
            piece = (
                SlidingPiece(Triangulated.of(points, part), True) if shape == SURFACE else _plane(mesh, points, part)
            )
            pairs.append(_on(nodes[inside[nodes]], pieces, piece))
        return pairs
    if isinstance(shape, str):
        shape = FITTED[shape](points[patch.nodes], mesh.normal)
    return [_on(patch.nodes[inside[patch.nodes]], pieces, SlidingPiece(shape))]


def _plane(mesh: Mesh, points: FloatArray, face: Polygons) -> SlidingPiece:
    """Return a face that was plane before the deflection; without a shape if it is no longer plane."""
    nodes = distinct(face.nodes)
    plane, size = Plane.fitted(points[nodes], mesh.normal), float(np.ptp(points[nodes], axis=0).max())
    flat = len(nodes) > (2 if mesh.plane else 3) and float(np.abs(plane.distance(points[nodes])).max()) <= FLAT * size
    return SlidingPiece(plane, faces=(face,)) if flat else SlidingPiece(None)


def _folds(start: FloatArray, points: FloatArray, face: Polygons) -> bool:
    """Return whether a polygon of a plane face is reversed between `start` (N, 3) and `points` (N, 3)."""
    before = area_vectors(start, face)
    normal = before.sum(axis=0)
    return bool(((area_vectors(points, face) @ normal <= 0.0) & (before @ normal > 0.0)).any())


def _on(nodes: IntArray, pieces: list[SlidingPiece], piece: SlidingPiece) -> IntArray:
    pieces.append(piece)
    return np.column_stack([nodes, np.full(len(nodes), len(pieces) - 1)])


def _parts(patch: Patch, points: FloatArray, inside: BoolArray, turn: float) -> Iterator[Polygons]:
    """Yield the parts of a patch with nodes inside; normals of adjacent faces in a part differ by less than `turn`."""
    faces = polygons_of(patch.faces)
    labels = _regions(faces, unit(area_vectors(points, faces)), turn)
    sizes = np.diff(faces.offsets)
    near = np.unique(labels[np.repeat(np.arange(len(faces)), sizes)[inside[faces.nodes]]])
    for label in near:
        within = labels == label
        nodes = faces.nodes[np.repeat(within, sizes)]
        yield Polygons(nodes, np.concatenate([[0], np.cumsum(sizes[within])]).astype(np.intp))


def _regions(faces: Polygons, normals: FloatArray, turn: float) -> IntArray:
    """Return labels (F,) of faces, equal for adjacent faces whose normals (F, 3) differ by less than `turn`."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # loading takes a while

    _, a, b, _ = Joints.of(faces)
    alike = np.linalg.norm(normals[a] - normals[b], axis=1) < turn
    graph = coo_array((np.ones(int(alike.sum())), (a[alike], b[alike])), shape=(len(faces), len(faces)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)
