"""Faces of patches that intersect after a deflection and did not before.

The other checks judge cells. All cells may be good although the flow overlaps itself: one skin of a thin body may go
through the other, with no cell between them.

Faces are cut into triangles, and a tree of boxes finds those near one another. Two faces intersect if an edge of one
goes through a triangle of the other by more than rounding. Triangles that share a node, or copies of one, are not
compared, nor are triangles in one plane. A face that is not plane has two diagonals. So a pair of faces that intersects
is cut once more at the mean of each face's nodes. It counts if it still intersects.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, distinct, first_coincident
from sdm_deflect.base.compiled import compiled_exactly
from sdm_deflect.base.threads import in_chunks

from .cells import Polygons
from .closest import DEPTH, LEAF, Triangles
from .edges import edges_of, polygons_of
from .mesh import Mesh

# Faces that overlap by less than this share of the moved faces' extent only touch.
TOUCH = 1e-7
# Nodes nearer than this share of the extent in the undeflected mesh are copies of one node.
ZERO_LENGTH = 1e-9
# Largest barycentric coordinate outside a triangle at which an edge still goes through it.
RIM = 1e-9
# Work on one triangle in kernel evaluations, by which it is divided.
COST = 500


@dataclass(frozen=True, slots=True)
class IntersectingFaces:
    """Faces that newly intersect others.

    Attributes
    ----------
    faces : number of moved faces that newly intersect another face.
    moved : number of faces with a moved node.
    near : number of all faces near them.
    where : patches and place of the first pair, as text; empty without an intersection.
    edges : (E, 2) nodes of the edges of all faces that newly intersect.
    """

    faces: int
    moved: int
    near: int
    where: str = ""
    edges: IntArray = field(default_factory=lambda: np.empty((0, 2), dtype=np.intp), repr=False, compare=False)

    @classmethod
    def of(cls, mesh: Mesh, points: FloatArray) -> "IntersectingFaces":
        """Compare faces that moved to points (N, 3) with one another and with faces near them.

        Faces of different zones are not compared, because zones overlap. Nor are two patches without a common node that
        already intersect in the undeflected mesh.
        """
        skin = _NearbyFaces.of(mesh, points)
        if skin is None:
            return cls(0, 0, 0)
        moved, near = int(skin.moved.sum()), len(skin.moved)
        now = skin.intersecting(points)
        if not len(now):
            return cls(0, moved, near)
        new = skin.new(now, skin.intersecting(mesh.points))
        if len(new) and not skin.plane:
            new = skin.confirm(new, points)
        if not len(new):
            return cls(0, moved, near)
        names = [mesh.names[skin.patch[face]] for face in new[0]]
        place = ", ".join(f"{x:.4g}" for x in points[skin.nodes_of(int(new[0, 0]))].mean(axis=0))
        faces = distinct(new[skin.moved[new]])
        where = f"the first is of {names[0]}, through {names[1]} at ({place})"
        return cls(len(faces), moved, near, where, edges_of(_some(skin.faces, distinct(new)))[0])


class _TriangleTree(NamedTuple):
    """Corners (T, 9) of triangles, their labels (T, 4), whether they moved (T,), and the boxes of `Triangles`."""

    corners: FloatArray
    labels: IntArray
    moved: BoolArray
    low: FloatArray
    high: FloatArray
    order: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class _NearbyFaces:
    """Moved faces and the faces near them, cut into triangles.

    Attributes
    ----------
    faces, patch, moved : F faces, (F,) the patch of each, and (F,) whether one of its nodes moved.
    triangles, face : (T, 3) nodes of triangles, and (T,) the face of each; a line has its second end twice.
    labels : (T, 4) labels of nodes, equal for all copies of a node, and the zone.
    size : extent of the moved faces.
    plane : whether the faces are lines.
    """

    faces: Polygons = field(repr=False)
    patch: IntArray = field(repr=False)
    moved: BoolArray = field(repr=False)
    triangles: IntArray = field(repr=False)
    face: IntArray = field(repr=False)
    labels: IntArray = field(repr=False)
    size: float
    plane: bool

    @classmethod
    def of(cls, mesh: Mesh, points: FloatArray) -> "_NearbyFaces | None":
        """Collect the faces near those that moved to points (N, 3); None if none moved."""
        every = polygons_of(mesh.faces_of(mesh.names))
        if not len(every):
            return None
        patch = np.repeat(np.arange(len(mesh.patches)), [len(patch) for patch in mesh.patches])
        starts = every.offsets[:-1]
        moved = np.logical_or.reduceat((points != mesh.points).any(axis=1)[every.nodes], starts)
        if not moved.any():
            return None
        ends = (mesh.points[every.nodes], points[every.nodes])
        low = np.minimum.reduceat(np.minimum(*ends), starts)
        high = np.maximum.reduceat(np.maximum(*ends), starts)
        first, last = low[moved].min(axis=0), high[moved].max(axis=0)
        size = float((last - first).max())
        rows = np.flatnonzero(((low <= last + TOUCH * size) & (high >= first - TOUCH * size)).all(axis=1))
        faces = _some(every, rows)
        triangles, face = _triangulate(faces)
        same = np.arange(len(points))
        used = distinct(triangles)
        same[used] = used[first_coincident(mesh.points[used], ZERO_LENGTH * size)]
        zone = np.searchsorted([zone.stop for zone in mesh.zones], triangles[:, :1], side="right")
        labels = np.hstack([same[triangles], zone])
        return cls(faces, patch[rows], moved[rows], triangles, face, labels, size, mesh.plane)

    def nodes_of(self, face: int) -> IntArray:
        """Return the nodes (k,) of a face."""
        return np.asarray(self.faces.nodes[self.faces.offsets[face] : self.faces.offsets[face + 1]])

    def intersecting(self, points: FloatArray) -> IntArray:
        """Return the sorted distinct pairs (P, 2) of faces that intersect with the nodes at points (N, 3)."""
        boxes, moved = Triangles.along_curve(points[self.triangles]), self.moved[self.face]
        tree = _TriangleTree(boxes.corners.reshape(-1, 9), self.labels, moved, boxes.low, boxes.high, boxes.order)
        rows, none = np.flatnonzero(moved), np.empty((0, 2), dtype=np.intp)
        count = np.zeros(len(rows), dtype=np.intp)

        def search(some: IntArray, begin: IntArray, pairs: IntArray) -> None:
            def chunk(first: int, last: int) -> None:
                part = slice(first, last)
                _search(some[part], tree, self.plane, TOUCH * self.size, begin[part], pairs)

            in_chunks(chunk, len(some), COST)

        search(rows, count, none)
        crossing = np.flatnonzero(count)
        begin = np.cumsum(count[crossing]) - count[crossing]
        pairs = np.empty((int(count.sum()), 2), dtype=np.intp)
        search(rows[crossing], begin, pairs)
        return np.unique(np.sort(self.face[pairs], axis=1), axis=0)

    def new(self, now: IntArray, before: IntArray) -> IntArray:
        """Return the pairs (Q, 2) of `now` that are not in `before`, except those of patches that overlapped before."""
        known = np.isin(_keys(now, len(self.moved)), _keys(before, len(self.moved)))
        ours, theirs = (np.sort(self.patch[pairs], axis=1) for pairs in (now, before))
        for first, second in np.unique(theirs, axis=0):
            if first != second and not self._touch(int(first), int(second)):
                known |= (ours == (first, second)).all(axis=1)
        return now[~known]

    def confirm(self, pairs: IntArray, points: FloatArray) -> IntArray:
        """Return the pairs (Q, 2) of P that also intersect if cut at the means of their nodes, at points (N, 3)."""
        rows = distinct(pairs)
        faces = _some(self.faces, rows)
        centres = np.add.reduceat(points[faces.nodes], faces.offsets[:-1]) / np.diff(faces.offsets)[:, None]
        triangles, place = _triangulate_at(faces, len(points) + np.arange(len(rows)))
        same, zone = np.arange(len(points) + len(rows)), np.empty(len(self.faces), dtype=np.intp)
        same[self.triangles], zone[self.face] = self.labels[:, :3], self.labels[:, 3]
        face = rows[place]
        labels = np.column_stack([same[triangles], zone[face]])
        skin = replace(self, triangles=triangles, face=face, labels=labels)
        again = skin.intersecting(np.vstack([points, centres]))
        return pairs[np.isin(_keys(pairs, len(self.moved)), _keys(again, len(self.moved)))]

    def _touch(self, first: int, second: int) -> bool:
        ours, theirs = (distinct(self.labels[self.patch[self.face] == patch, :3]) for patch in (first, second))
        return len(np.intersect1d(ours, theirs, assume_unique=True)) > 0


def _keys(pairs: IntArray, faces: int) -> IntArray:
    """Return one number (P,) for each pair (P, 2) of faces."""
    return np.asarray(pairs[:, 0] * faces + pairs[:, 1])


def _some(faces: Polygons, rows: IntArray) -> Polygons:
    sizes = np.diff(faces.offsets)[rows]
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp)
    return Polygons(faces.nodes[np.arange(offsets[-1]) + np.repeat(faces.offsets[rows] - offsets[:-1], sizes)], offsets)


def _triangulate(faces: Polygons) -> tuple[IntArray, IntArray]:
    """Return the triangles (T, 3) of faces, cut from their first nodes, and the face (T,) of each; lines stay lines."""
    sizes, starts = np.diff(faces.offsets), faces.offsets[:-1]
    count = np.maximum(sizes - 2, 1)
    face = np.repeat(np.arange(len(faces)), count)
    step = 1 + np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
    last = np.minimum(step + 1, sizes[face] - 1)
    return np.column_stack([faces.nodes[starts[face] + corner] for corner in (0, step, last)]), face


def _triangulate_at(faces: Polygons, centres: IntArray) -> tuple[IntArray, IntArray]:
    """Return the triangles (T, 3) of faces, cut from a node (F,) inside each, and the face (T,) of each."""
    face = np.repeat(np.arange(len(faces)), np.diff(faces.offsets))
    after = np.arange(1, len(face) + 1)
    after[faces.offsets[1:] - 1] = faces.offsets[:-1]
    return np.column_stack([faces.nodes, faces.nodes[after], centres[face]]), face


@compiled_exactly
def _search(
    rows: IntArray, tree: _TriangleTree, plane: bool, tolerance: float, begin: IntArray, pairs: IntArray
) -> None:  # pragma: no cover - compiled
    """Count the triangles that intersect each of `rows` (R,) in `begin`, or write the pairs (P, 2) at `begin`."""
    leaves, waiting = len(tree.low) // 2, np.empty(DEPTH, dtype=np.intp)
    for i in range(len(rows)):
        number, count = 0, 1
        waiting[0] = 1
        while count:
            count -= 1
            box = waiting[count]
            if _apart(tree.corners[rows[i]], tree.low[box], tree.high[box]):
                continue
            if box < leaves:
                waiting[count], waiting[count + 1] = 2 * box, 2 * box + 1
                count += 2
            else:
                number += _in_leaf(rows[i], (box - leaves) * LEAF, tree, plane, tolerance, pairs[begin[i] + number :])
        if not len(pairs):
            begin[i] = number


@compiled_exactly
def _in_leaf(
    row: int, start: int, tree: _TriangleTree, plane: bool, tolerance: float, pairs: IntArray
) -> int:  # pragma: no cover - compiled
    """Count the triangles of one box that intersect a triangle, and write the pairs if there is room.

    The pair of two moved triangles belongs to the first of them.
    """
    number = 0
    for place in range(start, start + LEAF):
        other = tree.order[place]
        if (tree.moved[other] and other <= row) or _neighbours(tree.labels[row], tree.labels[other]):
            continue
        first, second = tree.corners[row], tree.corners[other]
        if plane:
            through = _separates(first, second, tolerance) and _separates(second, first, tolerance)
        else:
            through = _edges_through(first, second, tolerance) or _edges_through(second, first, tolerance)
        if through:
            if len(pairs):
                pairs[number, 0], pairs[number, 1] = row, other
            number += 1
    return number


@compiled_exactly
def _apart(t: FloatArray, low: FloatArray, high: FloatArray) -> bool:  # pragma: no cover - compiled
    """Return whether a triangle (9,) is outside of one side of a box."""
    apart = False
    for k in range(3):
        apart |= (min(t[k], t[3 + k], t[6 + k]) > high[k]) | (max(t[k], t[3 + k], t[6 + k]) < low[k])
    return apart


@compiled_exactly
def _neighbours(first: IntArray, second: IntArray) -> bool:  # pragma: no cover - compiled
    """Return whether two triangles share a node, or belong to different zones."""
    shared = first[3] != second[3]
    for i in range(3):
        for j in range(3):
            shared |= first[i] == second[j]
    return bool(shared)


@compiled_exactly
def _edges_through(s: FloatArray, t: FloatArray, tolerance: float) -> bool:  # pragma: no cover - compiled
    """Return whether an edge of s (9,) goes through t (9,), with both ends more than `tolerance` away from it."""
    ax, ay, az, bx, by, bz = t[3] - t[0], t[4] - t[1], t[5] - t[2], t[6] - t[0], t[7] - t[1], t[8] - t[2]
    n = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2]
    if not square > 0.0:
        return False
    length = np.sqrt(square)
    for i in range(3):
        p, q = 3 * i, 3 * ((i + 1) % 3)
        up = ((s[p] - t[0]) * n[0] + (s[p + 1] - t[1]) * n[1] + (s[p + 2] - t[2]) * n[2]) / length
        down = ((s[q] - t[0]) * n[0] + (s[q + 1] - t[1]) * n[1] + (s[q + 2] - t[2]) * n[2]) / length
        if up * down >= 0.0 or min(abs(up), abs(down)) <= tolerance:
            continue
        share = up / (up - down)
        x = s[p] + share * (s[q] - s[p])
        y = s[p + 1] + share * (s[q + 1] - s[p + 1])
        z = s[p + 2] + share * (s[q + 2] - s[p + 2])
        within = True
        for j in range(3):
            a, b = 3 * j, 3 * ((j + 1) % 3)
            ex, ey, ez = t[b] - t[a], t[b + 1] - t[a + 1], t[b + 2] - t[a + 2]
            fx, fy, fz = x - t[a], y - t[a + 1], z - t[a + 2]
            turn = (ey * fz - ez * fy) * n[0] + (ez * fx - ex * fz) * n[1] + (ex * fy - ey * fx) * n[2]
            within &= turn >= -RIM * square
        if within:
            return True
    return False


@compiled_exactly
def _separates(s: FloatArray, t: FloatArray, tolerance: float) -> bool:  # pragma: no cover - compiled
    """Return whether a segment s (9,) has its ends on both sides of the line through t (9,)."""
    x, y = t[3] - t[0], t[4] - t[1]
    length = np.sqrt(x * x + y * y)
    if not length > 0.0:
        return False
    one = (x * (s[1] - t[1]) - y * (s[0] - t[0])) / length
    other = (x * (s[4] - t[1]) - y * (s[3] - t[0])) / length
    return bool(one * other < 0.0 and min(abs(one), abs(other)) > tolerance)
