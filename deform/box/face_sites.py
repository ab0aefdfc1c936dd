"""Nearly equidistant points on a convex plane polygon: a face of the box, or its section by a plane."""

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.ties import clearly_less, first_largest, whole

# Inner points nearer to an edge than this share of the spacing are left out, because the edge has its sites.
CLEARANCE = 0.5


def polygon_sites(polygon: FloatArray, spacing: float) -> FloatArray:
    """Return points (P, 3) on a convex plane polygon and its border, about `spacing` apart.

    Edges are divided evenly. Rows parallel to the longest edge fill the inside; they are evenly spaced, and each is
    divided evenly.

    Parameters
    ----------
    polygon : (n, 3) corners in order, n >= 3.
    spacing : Wanted distance of neighbours, a length.
    """
    return np.vstack([border_sites(polygon, spacing), inner_sites(polygon, spacing)])


def border_sites(polygon: FloatArray, spacing: float) -> FloatArray:
    """Return points (P, 3) that divide each edge evenly, corners included."""
    _check(polygon, spacing)
    return np.vstack([divide_edge(a, b, spacing) for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True)])


def inner_sites(polygon: FloatArray, spacing: float) -> FloatArray:
    """Return points (P, 3) inside, in rows."""
    _check(polygon, spacing)
    origin, axes = plane_axes(polygon)
    u, v = _inner_rows((polygon - origin) @ axes.T, spacing).T[:, :, None]
    return np.asarray(origin + u * axes[0] + v * axes[1])


def divide_edge(a: FloatArray, b: FloatArray, spacing: float) -> FloatArray:
    """Return points (n, 3) that divide the edge from a to b evenly, with a and without b."""
    n = max(1, whole(float(np.linalg.norm(b - a)) / spacing))
    return np.asarray(a + np.arange(n)[:, None] / n * (b - a))


def plane_axes(polygon: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the first corner of the longest edge, and orthonormal axes (2, 3); the first is along that edge."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    longest = first_largest(np.linalg.norm(edges, axis=1))
    u = edges[longest] / np.linalg.norm(edges[longest])
    normal = np.sum(np.cross(polygon, np.roll(polygon, -1, axis=0)), axis=0)
    v = np.cross(normal / np.linalg.norm(normal), u)
    return polygon[longest], np.vstack([u, v])


def _inner_rows(flat: FloatArray, spacing: float) -> FloatArray:
    """Fill a convex polygon (n, 2), counter-clockwise, with rows parallel to its longest edge."""
    height = float(flat[:, 1].max())
    count = max(1, whole(height / spacing))
    rows = [_row(flat, height * i / count, spacing) for i in range(1, count)]
    points = np.vstack([np.empty((0, 2)), *rows])
    clear = np.full(len(points), np.inf)
    for corner, end in zip(flat, np.roll(flat, -1, axis=0), strict=True):
        u, v = (end - corner) / np.linalg.norm(end - corner)
        np.minimum(clear, u * (points[:, 1] - corner[1]) - v * (points[:, 0] - corner[0]), out=clear)
    return np.asarray(points[~clearly_less(clear, CLEARANCE * spacing)])


def _row(flat: FloatArray, level: float, spacing: float) -> FloatArray:
    """Divide the chord of the polygon at this height evenly, without its ends."""
    a, b = flat, np.roll(flat, -1, axis=0)
    crossing = (a[:, 1] <= level) != (b[:, 1] <= level)
    a, b = a[crossing], b[crossing]
    x = a[:, 0] + (level - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    n = max(1, whole(float(x.max() - x.min()) / spacing))
    inner = x.min() + np.arange(1, n) / n * (x.max() - x.min())
    return np.column_stack([inner, np.full(len(inner), level)])


def _check(polygon: FloatArray, spacing: float) -> None:
    if not 0.0 < spacing < np.inf:
        raise ValueError(f"spacing = {spacing} m must be a positive length")
    if polygon.ndim != 2 or polygon.shape[1] != 3 or len(polygon) < 3:
        raise ValueError(f"polygon {polygon.shape} must be (n, 3) with at least 3 corners")
