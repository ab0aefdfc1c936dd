"""Point reduction: a small, nearly equidistant subset from which the adaptation starts (section 4)."""

import numpy as np

from sdm_deflect.deform.duplicates import IndexArray
from sdm_deflect.deform.kernels import FloatArray


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
