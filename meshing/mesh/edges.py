"""Edges, area vectors and edge lengths of faces, and the angles at which faces meet.

The faces around a plane mesh are lines, which meet in nodes instead of edges.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray

from .cells import Faces, Polygons

# Faces in one block, so that temporaries stay small.
ROWS = 1 << 16


def polygons_of(faces: Sequence[Faces]) -> Polygons:
    """Return faces of any shapes as polygons."""
    nodes = np.concatenate([np.empty(0, dtype=np.intp), *(block.nodes.ravel() for block in faces)])
    sizes = np.concatenate([np.empty(0, dtype=np.intp), *(_sizes(block) for block in faces)])
    return Polygons(nodes, np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp))


def edges_of(faces: Polygons) -> tuple[IntArray, IntArray]:
    """Return the edges (E, 2) of all faces as node indices, and the face (E,) of each.

    A line has two edges: there and back.
    """
    sizes = np.diff(faces.offsets)
    following = np.arange(1, len(faces.nodes) + 1)
    following[faces.offsets[1:] - 1] = faces.offsets[:-1]
    return np.column_stack([faces.nodes, faces.nodes[following]]), np.repeat(np.arange(len(faces)), sizes)


def area_vectors(points: FloatArray, faces: Polygons) -> FloatArray:
    """Return the area vector (F, 3) of each face: half the sum of cross products around its first corner.

    The vector of a line is as long as the line, and points to its right in the plane of constant z.
    """
    if are_lines(faces):
        way = points[faces.nodes[1::2]] - points[faces.nodes[::2]]
        return np.column_stack([way[:, 1], -way[:, 0], np.zeros(len(way))])
    out = np.empty((len(faces), 3))
    for part in rows_of(len(faces), ROWS):
        some = faces.rows(part.start, part.stop)
        edges, face = edges_of(some)
        origin = points[some.nodes[some.offsets[:-1]]][face]
        crosses = np.cross(points[edges[:, 0]] - origin, points[edges[:, 1]] - origin)
        out[part] = 0.5 * np.add.reduceat(crosses, some.offsets[:-1], axis=0)
    return out


def are_lines(faces: Polygons) -> bool:
    """Return whether the faces are the lines around a plane mesh."""
    return len(faces) > 0 and bool(faces.offsets[1] == 2)


class Joints(NamedTuple):
    """Edges where two faces meet: nodes (J, 2), both faces (J,), and whether these agree; for lines a node twice.

    Two faces agree in orientation if they pass the edge in opposite directions; two lines, if one begins where the
    other ends.
    """

    edges: IntArray
    first: IntArray
    second: IntArray
    agree: BoolArray

    @classmethod
    def of(cls, faces: Polygons) -> "Joints":
        """Return all joints; if three faces share an edge, the first meets the second, and the second the third."""
        if are_lines(faces):
            edges, face = np.column_stack([faces.nodes, faces.nodes]), np.arange(len(faces.nodes)) // 2
            forward = np.arange(len(faces.nodes)) % 2 == 0
        else:
            edges, face = edges_of(faces)
            forward = edges[:, 0] < edges[:, 1]
        low, high = np.minimum(*edges.T), np.maximum(*edges.T)
        key = low.astype(np.int64) * (high.max(initial=0) + 1) + high
        order = np.argsort(key, kind="stable")
        key = key[order]
        pair = np.flatnonzero(key[:-1] == key[1:])
        a, b = order[pair], order[pair + 1]
        return cls(np.column_stack([low[a], high[a]]), face[a], face[b], forward[a] != forward[b])

    def cosines(self, points: FloatArray, faces: Polygons) -> FloatArray:
        """Return the cosine (J,) of the angle between the two faces' normals."""
        lines = points[faces.nodes[1::2]] - points[faces.nodes[::2]] if are_lines(faces) else None
        normal = unit(area_vectors(points, faces) if lines is None else lines)  # lines turn like their normals
        cosine = np.einsum("ij,ij->i", normal[self.first], normal[self.second])
        cosine[~self.agree] *= -1.0
        return np.asarray(cosine)


def rim(faces: Polygons) -> IntArray:
    """Return the edges (E, 2) that only one face has; for lines the nodes of a single line, each twice."""
    both = np.column_stack([faces.nodes, faces.nodes]) if are_lines(faces) else np.sort(edges_of(faces)[0], axis=1)
    edges, count = np.unique(both, axis=0, return_counts=True)
    return np.asarray(edges[count == 1])


def sharp_edges(points: FloatArray, faces: Polygons, degrees: float) -> IntArray:
    """Return the edges (E, 2) at which the normal turns by more than `degrees`.

    For lines these are nodes, each twice.
    """
    joints = Joints.of(faces)
    return np.asarray(joints.edges[joints.cosines(points, faces) < np.cos(np.radians(degrees))])


def unit(vectors: FloatArray) -> FloatArray:
    """Return unit vectors (N, 3) along vectors (N, 3); zero vectors stay zero."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny))


def median_edge(points: FloatArray, faces: Sequence[Faces]) -> float:
    """Return the median edge length of all faces, with shared edges counted for each face; nan without faces."""
    edges, _ = edges_of(polygons_of(faces))
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    return float(np.median(lengths)) if len(lengths) else float("nan")


def rows_of(count: int, size: int) -> Iterator[slice]:
    """Yield slices of at most `size` that cover range(count)."""
    return (slice(start, start + size) for start in range(0, count, size))


def _sizes(block: Faces) -> IntArray:
    if isinstance(block, Polygons):
        return np.diff(block.offsets)
    return np.full(len(block), block.nodes.shape[1], dtype=np.intp)
