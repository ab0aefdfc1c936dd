"""Pieces of a mesh compared with a box: which nodes lie inside, which cells they touch, which cells are inverted."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sdm_deflect.deform.base import limits
from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.sets import distinct
from sdm_deflect.deform.hexahedron import Hexahedron
from sdm_deflect.deform.mesh.cells import LARGEST, Cells, Polyhedra, Volume
from sdm_deflect.deform.mesh.faces import Keys, cell_face_keys, face_keys
from sdm_deflect.deform.mesh.pieces import Pieces
from sdm_deflect.deform.mesh.polyhedra import SomePolyhedra
from sdm_deflect.deform.mesh.quality import inverted_of, other_hand, other_handed
from sdm_deflect.deform.mesh.touched import touching

PROBES, PROBED = 8, 1 << 14
"""Places in a block of cells where their order is looked at, and cells at each."""


class Window(NamedTuple):
    """The points that some cells need.

    Attributes
    ----------
    points : (P, 3) coordinates.
    changed : (P,) which of them may move.
    keys : (P,) of those on patches, random numbers of which a face's key is the sum; 0 of all others.
    """

    points: FloatArray
    changed: BoolArray
    keys: Keys


@dataclass(frozen=True, slots=True, eq=False)
class ScanTask:
    """What every piece is compared with.

    Attributes
    ----------
    pieces : where they are read.
    boxes : each hexahedron, with the first and last but one point (Z, 2) of each zone that deforms in it.
    moving : (K,) sorted indices of the nodes that move.
    boundary : (B,) sorted indices of the nodes on patches.
    keys : (B,) random numbers of these, of which a face's key is the sum.
    faces : (F,) sorted keys of the faces of patches.
    sign : orientation of each block of cells.
    held : all points, where these are held in memory.
    """

    pieces: Pieces
    boxes: tuple[tuple[Hexahedron, IntArray], ...] = field(repr=False)
    moving: IntArray = field(repr=False)
    boundary: IntArray = field(repr=False)
    keys: Keys = field(repr=False)
    faces: Keys = field(repr=False)
    sign: tuple[float, ...]
    held: Window | None = field(default=None, repr=False)

    def holding(self) -> "ScanTask":
        """Return it with all points held in memory."""
        points = np.empty((self.pieces.points, 3))
        for start in range(0, len(points), limits.LIMITS.points):
            stop = min(start + limits.LIMITS.points, len(points))
            points[start:stop] = self.pieces.coordinates(start, stop)
        return replace(self, held=self.view_of(points, 0))

    def view(self, nodes: IntArray) -> tuple[Window, IntArray]:
        """Return the points that cells with nodes (M, k) or (K,) need, and the rows of these there, as many.

        Where cells near one another in the file have nodes near one another, they are a range of points, else the
        corners of these cells alone. InputError for nodes that are not there.
        """
        low, high = int(nodes.min()), int(nodes.max()) + 1
        if low < 0 or high > self.pieces.points:
            raise InputError(
                f"{self.pieces.source}: nodes {low} to {high - 1}, but there are {self.pieces.points} points"
            )
        if self.held:
            return self.held, nodes
        if high - low <= max(nodes.size, limits.LIMITS.points):
            return self.view_of(self.pieces.coordinates(low, high), low), nodes - low
        own = distinct(nodes)
        points = self.pieces.places(own)
        changed, keys = self.inside(points, own), np.zeros(len(own), dtype=np.uint64)
        changed[_common(own, self.moving)[0]] = True
        on, known = _common(own, self.boundary)
        keys[on] = self.keys[known]
        return Window(points, changed, keys), np.searchsorted(own, nodes)

    def view_of(self, points: FloatArray, first: int) -> Window:
        """Return a view of a range of points (P, 3), the first of which has that index."""
        changed = self.inside(points, np.arange(first, first + len(points)))
        keys = np.zeros(len(points), dtype=np.uint64)
        own = slice(*np.searchsorted(self.moving, (first, first + len(points))))
        changed[self.moving[own] - first] = True
        own = slice(*np.searchsorted(self.boundary, (first, first + len(points))))
        keys[self.boundary[own] - first] = self.keys[own]
        return Window(points, changed, keys)

    def inside(self, points: FloatArray, nodes: IntArray) -> BoolArray:
        """Return which nodes (K,) at points (K, 3) lie in a box, and in a zone that deforms in it."""
        inside = np.zeros(len(nodes), dtype=np.bool_)
        for box, zones in self.boxes:
            own = np.zeros(len(nodes), dtype=np.bool_)
            for first, end in zones:
                own |= (nodes >= first) & (nodes < end)
            inside |= box.contains(points) & own
        return inside

    @property
    def is_scattered(self) -> bool:
        """Whether cells near one another in the file have nodes that are not."""
        far = places = 0
        for block, (_, count) in enumerate(self.pieces.blocks):
            for start in np.linspace(0, max(0, count - PROBED), PROBES).astype(int).tolist() if count else ():
                nodes = self.pieces.cells_of(block, start, min(start + PROBED, count)).nodes
                far += int(np.ptp(nodes)) > limits.LIMITS.points
                places += 1
        return 2 * far > places


class CellsFound(NamedTuple):
    """Rows (R,) of touched cells, and these; of all how many are inverted, and only mirrored; faces (F,) on patches."""

    rows: IntArray
    cells: Cells | SomePolyhedra
    inverted: int
    mirrored: int
    faces: IntArray


def nodes_inside(task: ScanTask, item: tuple[int, int]) -> tuple[IntArray, FloatArray]:
    """Return which points of a range lie inside (M,), and where (M, 3); InputError for coordinates that are none."""
    start, stop = item
    points = task.held.points[start:stop] if task.held else task.pieces.coordinates(start, stop)
    numbers = np.arange(start, stop)
    check_points(task.pieces, points, numbers)
    rows = np.flatnonzero(task.inside(points, numbers))
    return start + rows, points[rows]


def check_points(pieces: Pieces, points: FloatArray, numbers: IntArray) -> None:
    """Refuse (InputError) coordinates (K, 3) that are not finite, or too large, of points with those numbers (K,)."""
    if not (points.min(initial=0.0) > -LARGEST and points.max(initial=0.0) < LARGEST):
        bad = ~(np.abs(points) < LARGEST).all(axis=1)
        what = f"beyond {LARGEST:g}" if np.isfinite(points).all() else "not finite"
        raise InputError(f"{pieces.source}: points are {what}, the first is point {int(numbers[np.argmax(bad)])}")


def scan_cells(task: ScanTask, item: tuple[int, int, int]) -> CellsFound:
    """Judge some cells of a block."""
    block, start, stop = item
    stored = task.pieces.cells_of(block, start, stop)
    view, nodes = task.view(stored.nodes)
    cells: Volume
    if isinstance(stored, Cells):
        cells, rows = Cells(stored.shape, nodes), None
    else:
        cells, rows = stored.counted(nodes, start, stop), np.arange(stop - start)
    inverted = int(np.count_nonzero(inverted_of(view.points, cells, rows, task.sign[block])))
    other = other_handed(view.points, cells, task.sign[block]) if inverted else np.empty(0, dtype=np.intp)
    if len(other) and isinstance(stored, Cells):
        stored = replace(stored, nodes=other_hand(stored, other))
    found = touching(cells, view.changed) if task.held or view.changed.any() else np.empty(0, dtype=np.intp)
    found = found[found < stop - start]  # the last of polyhedra stands for all others
    return CellsFound(start + found, _some(stored, cells, found), inverted, len(other), _faces_seen(task, view, cells))


def beside(task: ScanTask, item: tuple[int, IntArray]) -> CellsFound:
    """Return some polyhedra (R,) of a block, none of which is touched, with all their faces."""
    block, rows = item
    stored = task.pieces.cells_of(block, int(rows[0]), int(rows[-1]) + 1)
    assert isinstance(stored, SomePolyhedra)
    sides, none = stored.sides, np.empty(0, dtype=np.intp)
    wanted = np.isin(sides.owner, rows)
    wanted[: len(sides.neighbour)] |= np.isin(sides.neighbour, rows)
    return CellsFound(none, stored.some(wanted), 0, 0, none)


def _some(stored: Cells | SomePolyhedra, cells: Volume, rows: IntArray) -> Cells | SomePolyhedra:
    """Return rows (R,) of cells as they are stored."""
    if isinstance(stored, Cells):
        return Cells(stored.shape, stored.nodes[rows])
    assert isinstance(cells, Polyhedra)
    chosen = np.zeros(len(cells), dtype=np.bool_)
    chosen[rows] = True
    faces = chosen[cells.owner]
    faces[: len(cells.neighbour)] |= chosen[cells.neighbour]
    return stored.some(faces)


def _common(own: IntArray, known: IntArray) -> tuple[IntArray, IntArray]:
    """Return the places, in each of two sorted arrays of distinct indices, of those that both have; `own` has some."""
    first, end = np.searchsorted(known, (own[0], own[-1] + 1))
    near = known[first:end]
    place = np.searchsorted(own, near)
    there = np.flatnonzero(own[place] == near)
    return place[there], first + there


def _faces_seen(task: ScanTask, view: Window, cells: Volume) -> IntArray:
    """Return which faces (F,) of patches the cells have."""
    if isinstance(cells, Polyhedra):
        found = face_keys(cells.faces.rows(len(cells.neighbour), len(cells.faces)), view.keys)
    else:
        found = np.concatenate([np.empty(0, np.uint64), *cell_face_keys((cells,), view.keys, view.keys > 0)])
    if not len(task.faces):
        return np.empty(0, dtype=np.intp)
    place = np.minimum(np.searchsorted(task.faces, found), len(task.faces) - 1)
    return distinct(place[task.faces[place] == found])
