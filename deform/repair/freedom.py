"""Which nodes a repair may move, and on what they have to stay."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sdm_deflect.deform.edges import area_vectors, edges_of, polygons_of
from sdm_deflect.deform.mesh import BoolArray, FloatArray, IntArray, Mesh, Patch, Polygons
from sdm_deflect.deform.repair.columns import Columns
from sdm_deflect.deform.volume.sliding import FITTED, SURFACE, Plane, SlidingSurface
from sdm_deflect.deform.volume.triangulated import SHARP, Triangulated

ALIKE = 1e-5
"""Radians between the normals of two faces of one plane; rounding makes them differ."""
FLAT = 1e-9
"""Of a patch's size: how far nodes of a plane face may be off it."""


@dataclass(frozen=True, slots=True, eq=False)
class Slide:
    """Nodes (K,) that stay on a shape."""

    nodes: IntArray = field(repr=False)
    shape: SlidingSurface


@dataclass(frozen=True, slots=True, eq=False)
class Freedom:
    """The nodes that may move: `free` (F,) anywhere, others on their shapes; each is in one place at most.

    Those of `columns` keep their distances from the nodes below them, too.
    """

    free: IntArray = field(repr=False)
    slides: tuple[Slide, ...] = field(repr=False)
    columns: Columns = field(default_factory=Columns, repr=False)

    @property
    def nodes(self) -> IntArray:
        """Sorted indices (K,) of all of them."""
        return np.union1d(self.free, self.sliding)

    @property
    def sliding(self) -> IntArray:
        """Sorted indices (K,) of those on shapes."""
        return np.unique(np.concatenate([np.empty(0, dtype=np.intp), *(one.nodes for one in self.slides)]))

    @classmethod
    def of(
        cls,
        mesh: Mesh,
        points: FloatArray,
        inside: BoolArray,
        free: IntArray,
        shapes: Mapping[str, SlidingSurface | str],
    ) -> Freedom:
        """Find on what the boundary's nodes inside may slide.

        A node within a face slides on it; nodes on the edge of two faces, or on a patch of no shape, stay.

        Parameters
        ----------
        points : (N, 3) where the nodes are.
        inside : (N,) the nodes that may move at all.
        free : (F,) those of them that are within the flow.
        shapes : Of patches: a shape; or its name, to be found from the nodes: each plane face of a patch is a
            ``"plane"`` of its own; of a ``"surface"`` each part between sharp edges is one as it is, so that a node of
            a thin body stays on its side; the whole patch is a ``"cylinder"``.
        """
        pieces: list[SlidingSurface | None] = []
        pairs = [np.empty((0, 2), dtype=np.intp)]
        for patch in mesh.patches:
            if inside[patch.nodes].any():
                pairs += _pieces(patch, points, inside, shapes.get(patch.name), pieces)
        found = np.unique(np.concatenate(pairs), axis=0)
        nodes, first, count = np.unique(found[:, 0], return_index=True, return_counts=True)
        rim = np.array([isinstance(shape, Triangulated) for shape in pieces], dtype=np.bool_)
        last = np.append(first[1:], len(found)) - 1
        same = (count == 1) | ((count == 2) & rim[found[first, 1]] & rim[found[last, 1]])
        slides = [
            Slide(nodes[same & (found[first, 1] == k)], shape)
            for k, shape in enumerate(pieces)
            if shape is not None and (same & (found[first, 1] == k)).any()
        ]
        return cls(free, tuple(slides))

    def with_columns(self, columns: Columns, points: FloatArray) -> Freedom:
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
        slides = tuple(Slide(np.setdiff1d(one.nodes, stay, assume_unique=True), one.shape) for one in self.slides)
        return Freedom(np.setdiff1d(self.free, stay, assume_unique=True), slides, Columns(tuple(levels)))


def _pieces(
    patch: Patch,
    points: FloatArray,
    inside: BoolArray,
    shape: SlidingSurface | str | None,
    pieces: list[SlidingSurface | None],
) -> list[IntArray]:
    """Add the faces of a patch to `pieces`; return which of its nodes inside are on which, as pairs (P, 2)."""
    nodes = patch.nodes[inside[patch.nodes]]
    if shape == "plane" and patch.faces:
        return [*_planes(patch, points, inside, pieces), _on(patch.loose[inside[patch.loose]], pieces, None)]
    if shape == SURFACE and patch.faces:
        return [*_surfaces(patch, points, inside, pieces), _on(patch.loose[inside[patch.loose]], pieces, None)]
    if isinstance(shape, str):
        shape = FITTED[shape](points[patch.nodes])
    return [_on(nodes, pieces, shape)]


def _on(nodes: IntArray, pieces: list[SlidingSurface | None], shape: SlidingSurface | None) -> IntArray:
    pieces.append(shape)
    return np.column_stack([nodes, np.full(len(nodes), len(pieces) - 1)])


def _planes(patch: Patch, points: FloatArray, inside: BoolArray, pieces: list[SlidingSurface | None]) -> list[IntArray]:
    """Add the plane faces of a patch: faces that share edges, and have one normal; the others are of no shape."""
    size = float(np.ptp(points[patch.nodes], axis=0).max())
    found = []
    for part in _parts(patch, points, inside, ALIKE):
        nodes = np.unique(part.nodes)
        plane = Plane.fitted(points[nodes])
        flat = len(nodes) > 3 and float(np.abs(plane.distance(points[nodes])).max()) <= FLAT * size
        found.append(_on(nodes[inside[nodes]], pieces, plane if flat else None))
    return found


def _surfaces(
    patch: Patch, points: FloatArray, inside: BoolArray, pieces: list[SlidingSurface | None]
) -> list[IntArray]:
    """Add the parts of a patch between sharp edges, each as it is."""
    found = []
    for part in _parts(patch, points, inside, 2.0 * np.sin(np.radians(SHARP / 2.0))):
        nodes = np.unique(part.nodes)
        found.append(_on(nodes[inside[nodes]], pieces, Triangulated.of(points, part)))
    return found


def _parts(patch: Patch, points: FloatArray, inside: BoolArray, turn: float) -> Iterator[Polygons]:
    """Yield the parts of a patch with nodes inside: faces that share edges, beside which normals differ by less."""
    faces = polygons_of(patch.faces)
    normals = area_vectors(points, faces)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    labels = _regions(faces, normals, turn)
    sizes = np.diff(faces.offsets)
    near = np.unique(labels[np.repeat(np.arange(len(faces)), sizes)[inside[faces.nodes]]])
    for label in near:
        own = labels == label
        nodes = faces.nodes[np.repeat(own, sizes)]
        yield Polygons(nodes, np.concatenate([[0], np.cumsum(sizes[own])]).astype(np.intp))


def _regions(faces: Polygons, normals: FloatArray, turn: float) -> IntArray:
    """Return a label (F,) for each face: equal for those joined by edges beside which normals (F, 3) differ by less."""
    edges, face = edges_of(faces)
    ends = np.sort(edges, axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    pair = (ends[order[:-1]] == ends[order[1:]]).all(axis=1)
    a, b = face[order[:-1][pair]], face[order[1:][pair]]
    alike = np.linalg.norm(normals[a] - normals[b], axis=1) < turn
    graph = coo_array((np.ones(int(alike.sum())), (a[alike], b[alike])), shape=(len(faces), len(faces)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)
