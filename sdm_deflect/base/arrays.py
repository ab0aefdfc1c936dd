"""Types of arrays, sorted index sets, and selections of points.

NumPy's `unique` and `union1d` have used a hash table since 2.3, which takes forty times as long as sorting (3 million
node indices: 6.1 s and .15 s). So neither is used for large sets.
"""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .ties import clearly_less, first_largest

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]


Number = TypeVar("Number", bound=np.generic)
IndexArray = NDArray[np.intp]
DIRECTION = np.array([0.5698402909980532, 0.7548776662466927, 0.3247179572447460])
# Number of points compared at a time; of up to `FEW` points all are compared.
BLOCK, FEW = 512, 65_536
# Bits of each coordinate in a Morton code: a thousand places.
BITS = 10


def distinct(values: NDArray[Number]) -> NDArray[Number]:
    """Return the sorted distinct values (K,) of an array of any shape."""
    ordered = np.sort(values, axis=None)
    return ordered[np.append(True, ordered[1:] != ordered[:-1])] if len(ordered) else ordered


def count_distinct(values: NDArray[Number]) -> tuple[NDArray[Number], NDArray[np.intp]]:
    """Return the sorted distinct values (K,) of (N,) numbers and their counts (K,); sorts `values` in place."""
    values.sort()
    first = np.flatnonzero(np.append(True, values[1:] != values[:-1])[: len(values)])
    return values[first], np.diff(first, append=len(values))


def union(*parts: NDArray[Any]) -> NDArray[np.intp]:
    """Return the sorted distinct indices (K,) of all parts."""
    return distinct(np.concatenate([np.empty(0, dtype=np.intp), *(part.ravel() for part in parts)]))


# Parallel to no lattice vector: points of a regular grid get distinct keys.


def component(vectors: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the scalar products (...,) of vectors (..., 3) with a direction (3,): the same bits on every processor.

    A product by ``@`` goes through BLAS, which has other kernels for other processors. Some fuse products and sums.
    """
    return np.asarray(vectors[..., 0] * direction[0] + vectors[..., 1] * direction[1] + vectors[..., 2] * direction[2])


def components(vectors: FloatArray, directions: FloatArray) -> FloatArray:
    """Return the scalar products (..., K) of vectors (..., 3) with directions (K, 3), like `component`."""
    return np.stack([component(vectors, direction) for direction in directions], axis=-1)


def along_curve(points: FloatArray) -> IndexArray:
    """Return the rows (N,) of points (N, 3) in Morton order, which keeps neighbours together in memory."""
    low = points.min(axis=0, initial=np.inf)
    size = float((points - low).max(initial=0.0)) or 1.0
    cells = ((points - low) / size * ((1 << BITS) - 1)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(BITS):
        for axis in range(3):
            code |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.asarray(np.argsort(code, kind="stable"))


def first_coincident(points: FloatArray, tol: float = 0.0) -> IndexArray:
    """Return for each of points (N, 3) the lowest row of a point within distance `tol`, which may be its own row.

    Points are sorted along a direction in which points of a lattice have distinct keys, so only neighbours in that
    order need comparing. Cost: one sort.
    """
    first = np.arange(len(points), dtype=np.intp)
    key = points @ (DIRECTION / np.linalg.norm(DIRECTION))
    order = np.argsort(key, kind="stable")
    sorted_key, reach = key[order], tol + 4e-16 * (1.0 + np.abs(key).max(initial=0.0))
    if tol == 0.0:
        near = np.flatnonzero(np.diff(sorted_key) <= reach)
        rows = np.sort(order[union(near, near + 1)])
        rows = rows[np.lexsort(points[rows].T)]
        heads = np.append(True, (points[rows[1:]] != points[rows[:-1]]).any(axis=1))[: len(rows)]
        first[rows] = rows[heads][np.cumsum(heads) - 1]
        return first
    for step in range(1, len(points)):
        near = np.flatnonzero(sorted_key[step:] - sorted_key[:-step] <= reach)
        if not len(near):
            break
        a, b = order[near], order[near + step]
        same = np.sum((points[a] - points[b]) ** 2, axis=1) <= tol * tol
        low, high = np.minimum(a, b)[same], np.maximum(a, b)[same]
        np.minimum.at(first, high, low)
    return first


def farthest(points: FloatArray, n: int) -> IndexArray:
    """Return n rows of points (N, 3) by farthest-point sampling; all distinct rows if there are fewer.

    The first is farthest from the centre of the bounding box; ties go to the lower row.
    """
    if n < 1:
        raise ValueError(f"n = {n} must be at least 1")
    x, y, z = np.ascontiguousarray(points.T)
    start = 0.5 * (points.min(axis=0) + points.max(axis=0))
    chosen = [first_largest((x - start[0]) ** 2 + (y - start[1]) ** 2 + (z - start[2]) ** 2)]
    if len(points) > FEW:
        return _farthest_of_many(points, n, chosen)
    nearest = np.full(len(points), np.inf)
    while len(chosen) < n:
        i = chosen[-1]
        np.minimum(nearest, (x - x[i]) ** 2 + (y - y[i]) ** 2 + (z - z[i]) ** 2, out=nearest)
        farthest_row = first_largest(nearest)
        if nearest[farthest_row] == 0.0:
            break
        chosen.append(farthest_row)
    return np.array(chosen, dtype=np.intp)


def _farthest_of_many(points: FloatArray, n: int, chosen: list[int]) -> IndexArray:
    """Continue like `farthest`, with the same result, but update only blocks of points near each new point."""
    rows = _blocks(points)
    x, y, z = np.ascontiguousarray(points[rows].transpose(2, 0, 1))
    low, high = np.array([(axis.min(axis=1), axis.max(axis=1)) for axis in (x, y, z)]).transpose(1, 0, 2)
    nearest = np.full(rows.shape, np.inf)
    nearest.flat[len(points) :] = -1.0
    largest = np.full(len(rows), np.inf)
    while len(chosen) < n:
        p = points[chosen[-1]][:, None]
        gaps = np.maximum(np.maximum(low - p, p - high), 0.0)  # rounded like the distances, which are never smaller
        near = np.flatnonzero(gaps[0] ** 2 + gaps[1] ** 2 + gaps[2] ** 2 < largest)
        squares = (x[near] - p[0]) ** 2 + (y[near] - p[1]) ** 2 + (z[near] - p[2]) ** 2
        nearest[near] = np.minimum(nearest[near], squares)
        largest[near] = nearest[near].max(axis=1)
        reach = largest.max()
        if reach == 0.0:
            break
        block = np.flatnonzero(~clearly_less(largest, reach))
        chosen.append(int(rows[block][~clearly_less(nearest[block], reach)].min()))
    return np.array(chosen, dtype=np.intp)


def _blocks(points: FloatArray) -> IndexArray:
    """Return rows (B, BLOCK) of points (N, 3), with near points in one block; repeated rows fill the last block."""
    low = points.min(axis=0)
    extent = float((points.max(axis=0) - low).max()) or 1.0
    cells = ((points - low) / extent * 1023.0).astype(np.intp)
    key = np.zeros(len(points), dtype=np.intp)
    for bit in range(10):  # Morton order
        for axis in range(3):
            key |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    order = np.argsort(key, kind="stable")
    return np.pad(order, (0, -len(order) % BLOCK), mode="edge").reshape(-1, BLOCK)
