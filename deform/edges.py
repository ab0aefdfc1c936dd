"""Faces of any shapes: their edges, area vectors and edge lengths, and where two of them meet at an angle."""

from collections.abc import Iterator, Sequence

import numpy as np

from sdm_deflect.deform.mesh import Faces, FloatArray, IntArray, Polygons


def polygons_of(faces: Sequence[Faces]) -> Polygons:
    """Return faces of any shapes one after another."""
    nodes = np.concatenate([np.empty(0, dtype=np.intp), *(block.nodes.ravel() for block in faces)])
    sizes = np.concatenate([np.empty(0, dtype=np.intp), *(_sizes(block) for block in faces)])
    return Polygons(nodes, np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp))


def edges_of(faces: Polygons) -> tuple[IntArray, IntArray]:
    """Return the edges (E, 2) of every face, E of all faces, as node indices, and the face (E,) of each."""
    sizes = np.diff(faces.offsets)
    following = np.arange(1, len(faces.nodes) + 1)
    following[faces.offsets[1:] - 1] = faces.offsets[:-1]
    return np.column_stack([faces.nodes, faces.nodes[following]]), np.repeat(np.arange(len(faces)), sizes)


def area_vectors(points: FloatArray, faces: Polygons) -> FloatArray:
    """Return the area vector (F, 3) of each face: half the sum of cross products around its first corner."""
    if not len(faces):
        return np.empty((0, 3))
    edges, face = edges_of(faces)
    origin = points[faces.nodes[faces.offsets[:-1]]][face]
    crosses = np.cross(points[edges[:, 0]] - origin, points[edges[:, 1]] - origin)
    return np.asarray(0.5 * np.add.reduceat(crosses, faces.offsets[:-1], axis=0))


def sharp_edges(points: FloatArray, faces: Polygons, degrees: float) -> IntArray:
    """Return the edges (E, 2) whose two faces turn by more than `degrees` from one to the other."""
    edges, face = edges_of(faces)
    ends = np.sort(edges, axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    a, b = order[:-1], order[1:]
    pair = (ends[a] == ends[b]).all(axis=1)
    a, b = a[pair], b[pair]
    normal = area_vectors(points, faces)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    # The faces agree in their orientation if they walk along the edge in opposite directions.
    agree = np.where(edges[a, 0] == edges[b, 0], -1.0, 1.0)
    cosine = agree * np.einsum("ij,ij->i", normal[face[a]], normal[face[b]])
    return np.asarray(ends[a[cosine < np.cos(np.radians(degrees))]])


def median_edge(points: FloatArray, faces: Sequence[Faces]) -> float:
    """Return the median length of the edges of all faces, an edge once for each; nan if there are none."""
    edges, _ = edges_of(polygons_of(faces))
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    return float(np.median(lengths)) if len(lengths) else float("nan")


def rows_of(count: int, size: int) -> Iterator[slice]:
    """Cut range(count) into slices of at most `size`."""
    return (slice(start, start + size) for start in range(0, count, size))


def _sizes(block: Faces) -> IntArray:
    if isinstance(block, Polygons):
        return np.diff(block.offsets)
    return np.full(len(block), block.nodes.shape[1], dtype=np.intp)
