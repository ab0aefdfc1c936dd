"""Closest points on a set of triangles, by an exact search in a tree of boxes."""

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, along_curve
from sdm_deflect.base.compiled import compiled
from sdm_deflect.base.threads import in_chunks

# Largest number of triangles in a box that is not divided.
LEAF = 4
# Size of the stack of boxes: twice the levels of any tree.
DEPTH = 64
# Squared sine of an angle, below which a triangle counts as a segment.
DEGENERATE = 1e-12
# Work of one search in kernel evaluations, by which it is divided.
COST = 500


@dataclass(frozen=True, slots=True, eq=False)
class Closest:
    """The points on a surface closest to N points.

    Attributes
    ----------
    rows : (N,) triangle of each.
    weights : (N, 3) barycentric coordinates there, exactly zero opposite an edge or corner that has the point.
    places : (N, 3) the closest points.
    """

    rows: IntArray = field(repr=False)
    weights: FloatArray = field(repr=False)
    places: FloatArray = field(repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """Triangles in a balanced tree of axis-aligned boxes; without area they are segments or points.

    Attributes
    ----------
    corners : (T, 3, 3) corners of each triangle.
    order : (2^L LEAF,) rows of the triangles, box by box; the last row is repeated to fill the boxes.
    low, high : (2^(L + 1), 3) the boxes: box 1 holds all, and box i is divided into boxes 2 i and 2 i + 1.
    """

    corners: FloatArray = field(repr=False)
    order: IntArray = field(repr=False)
    low: FloatArray = field(repr=False)
    high: FloatArray = field(repr=False)

    @classmethod
    def of(cls, corners: FloatArray) -> "Triangles":
        """Sort triangles (T, 3, 3) into boxes; each box is halved across the longest extent of the centres.

        Raises ValueError if there are none.
        """
        if not len(corners):
            raise ValueError("a tree needs one triangle at least")
        levels = max(0, int(np.ceil(np.log2(len(corners) / LEAF))))
        order = np.minimum(np.arange(LEAF << levels), len(corners) - 1)
        centres = corners.mean(axis=1)
        for level in range(levels):
            groups = order.reshape(1 << level, -1)
            places = centres[groups]
            axis = np.argmax(np.ptp(places, axis=1), axis=1)
            along = np.take_along_axis(places, axis[:, None, None], axis=2)[..., 0]
            order = np.take_along_axis(groups, np.argsort(along, axis=1, kind="stable"), axis=1).ravel()
        return cls._with_boxes(corners, order, levels)

    @classmethod
    def along_curve(cls, corners: FloatArray) -> "Triangles":
        """Sort triangles (T, 3, 3) along a space-filling curve: five times as fast, but boxes overlap more."""
        levels = max(0, int(np.ceil(np.log2(len(corners) / LEAF))))
        rows = np.minimum(np.arange(LEAF << levels), len(corners) - 1)
        return cls._with_boxes(corners, along_curve(corners[:, 0] + corners[:, 1] + corners[:, 2])[rows], levels)

    @classmethod
    def _with_boxes(cls, corners: FloatArray, order: IntArray, levels: int) -> "Triangles":
        """Put boxes around triangles in a given order."""
        leaves = corners[order].reshape(1 << levels, -1, 3)
        low, high = np.empty((2 << levels, 3)), np.empty((2 << levels, 3))
        low[1 << levels :], high[1 << levels :] = leaves.min(axis=1), leaves.max(axis=1)
        for level in range(levels - 1, -1, -1):
            boxes, below = slice(1 << level, 2 << level), slice(2 << level, 4 << level)
            low[boxes] = low[below].reshape(-1, 2, 3).min(axis=1)
            high[boxes] = high[below].reshape(-1, 2, 3).max(axis=1)
        return cls(np.ascontiguousarray(corners), order, low, high)

    def closest(self, points: FloatArray) -> Closest:
        """Return the closest points to points (N, 3); the number of threads does not matter."""
        rows, weights = self._search_for(points, np.inf)
        return Closest(rows, weights, np.einsum("ni,nij->nj", weights, self.corners[rows]))

    def within(self, points: FloatArray, distance: float) -> BoolArray:
        """Return which points (N, 3) are nearer than a distance."""
        return self._search_for(points, distance)[0] >= 0

    def _search_for(self, points: FloatArray, distance: float) -> tuple[IntArray, FloatArray]:
        """Return the closest triangle (N,) within a distance, or -1, and the weights (N, 3) there."""
        rows, weights = np.full(len(points), -1, dtype=np.intp), np.zeros((len(points), 3))
        corners, x = self.corners[self.order].reshape(-1, 9), np.ascontiguousarray(points)

        def chunk(first: int, last: int) -> None:
            part = slice(first, last)
            _search(x[part], corners, self.low, self.high, distance * distance, rows[part], weights[part])

        in_chunks(chunk, len(points), COST)
        return np.where(rows < 0, -1, self.order[rows]), weights


@compiled
def _search(
    points: FloatArray,
    corners: FloatArray,
    low: FloatArray,
    high: FloatArray,
    limit: float,
    rows: IntArray,
    weights: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Fill in rows (N,) and weights (N, 3); nearer boxes are searched first, boxes beyond the best triangle never.

    Triangles count whose squared distance is below `limit`.
    """
    leaves = len(low) // 2
    waiting, gaps = np.empty(DEPTH, dtype=np.intp), np.empty(DEPTH)
    for i in range(len(points)):
        p, best, count = points[i], limit, 1
        waiting[0], gaps[0] = 1, 0.0
        while count:
            count -= 1
            box = waiting[count]
            if gaps[count] >= best:
                continue
            if box >= leaves:
                for row in range((box - leaves) * LEAF, (box - leaves + 1) * LEAF):
                    u, v, w = _weights(p, corners[row])
                    distance = 0.0
                    for k in range(3):
                        at = u * corners[row, k] + v * corners[row, 3 + k] + w * corners[row, 6 + k] - p[k]
                        distance += at * at
                    if distance < best:
                        best, rows[i] = distance, row
                        weights[i, 0], weights[i, 1], weights[i, 2] = u, v, w
                continue
            left, right = _gap(p, low[2 * box], high[2 * box]), _gap(p, low[2 * box + 1], high[2 * box + 1])
            swap = 1 if left < right else 0
            waiting[count], gaps[count] = 2 * box + swap, max(left, right)
            waiting[count + 1], gaps[count + 1] = 2 * box + 1 - swap, min(left, right)
            count += 2


@compiled
def _gap(p: FloatArray, low: FloatArray, high: FloatArray) -> float:  # pragma: no cover - compiled
    total = 0.0
    for k in range(3):
        off = max(low[k] - p[k], 0.0, p[k] - high[k])
        total += off * off
    return total


@compiled
def _weights(p: FloatArray, t: FloatArray) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return the barycentric coordinates of the point of a triangle (9,) closest to p (3,).

    It is the foot of the perpendicular if that is inside, else the closest point on the three edges.
    """
    bb = cc = bc = pb = pc = 0.0
    for k in range(3):
        b, c, q = t[3 + k] - t[k], t[6 + k] - t[k], p[k] - t[k]
        bb += b * b
        cc += c * c
        bc += b * c
        pb += q * b
        pc += q * c
    v, w, area = cc * pb - bc * pc, bb * pc - bc * pb, bb * cc - bc * bc
    if area > DEGENERATE * bb * cc and v > 0.0 and w > 0.0 and v + w < area:
        return 1.0 - (v + w) / area, v / area, w / area
    return _weights_on_edges(p, t)


@compiled
def _weights_on_edges(p: FloatArray, t: FloatArray) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return the barycentric coordinates of the point on the edges of a triangle (9,) closest to p (3,)."""
    best, u, v, w = np.inf, 1.0, 0.0, 0.0
    for i in range(3):
        j = (i + 1) % 3
        along = length = distance = 0.0
        for k in range(3):
            edge = t[3 * j + k] - t[3 * i + k]
            along += edge * (p[k] - t[3 * i + k])
            length += edge * edge
        share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
        for k in range(3):
            off = t[3 * i + k] + share * (t[3 * j + k] - t[3 * i + k]) - p[k]
            distance += off * off
        if distance < best:
            best = distance
            u = 1.0 - share if i == 0 else share if i == 2 else 0.0
            v = share if i == 0 else 1.0 - share if i == 1 else 0.0
            w = share if i == 1 else 1.0 - share if i == 2 else 0.0
    return u, v, w
