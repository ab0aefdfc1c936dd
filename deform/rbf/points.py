"""Sets of points: coinciding ones, and small, nearly equidistant subsets (section 4)."""

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.rbf.kernels import FloatArray

IndexArray = NDArray[np.intp]

# Along no lattice of points: distinct points of a regular grid get distinct keys.
DIRECTION = np.array([0.5698402909980532, 0.7548776662466927, 0.3247179572447460])


def first_coincident(points: FloatArray, tol: float = 0.0) -> IndexArray:
    """Return for each of points (N, 3) the lowest row within distance `tol` of it: itself if it is distinct.

    Points are sorted along a direction in which no lattice has two of them at one place; only neighbours in
    that order can coincide. Cost: one sort.
    """
    first = np.arange(len(points), dtype=np.intp)
    key = points @ (DIRECTION / np.linalg.norm(DIRECTION))
    order = np.argsort(key, kind="stable")
    sorted_key, reach = key[order], tol + 4e-16 * (1.0 + np.abs(key).max(initial=0.0))
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
    """Return n rows of points (N, 3) by farthest-point sampling; all distinct ones if there are fewer.

    The first is the point farthest from the centre of the bounding box; equal distances go to the lower row.
    """
    if n < 1:
        raise ValueError(f"n = {n} must be at least 1")
    x, y, z = np.ascontiguousarray(points.T)
    start = 0.5 * (points.min(axis=0) + points.max(axis=0))
    chosen = [int(np.argmax((x - start[0]) ** 2 + (y - start[1]) ** 2 + (z - start[2]) ** 2))]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < n:
        i = chosen[-1]
        np.minimum(nearest, (x - x[i]) ** 2 + (y - y[i]) ** 2 + (z - z[i]) ** 2, out=nearest)
        farthest_row = int(np.argmax(nearest))
        if nearest[farthest_row] == 0.0:
            break
        chosen.append(farthest_row)
    return np.array(chosen, dtype=np.intp)
