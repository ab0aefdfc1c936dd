"""The submesh of a mesh read in pieces: its boundary, the nodes in the boxes, and the cells that these nodes touch.

Nodes keep their order, so all that follows from a submesh has the same bits as from the whole mesh.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from sdm_deflect.base import threads
from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, distinct, union
from sdm_deflect.base.errors import InputError, short_list
from sdm_deflect.base.threads import Progress, Runner, silent
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.meshing.mesh.affected import touching
from sdm_deflect.meshing.mesh.cells import CORNERS, LARGEST, Cells, Faces, Patch, Polyhedra, Volume
from sdm_deflect.meshing.mesh.faces import (
    Keys,
    cell_face_keys,
    corners_in_order,
    face_keys,
    node_keys,
    on_boundary,
    patch_keys,
)  # fmt: skip
from sdm_deflect.meshing.mesh.mesh import FOLLOWS, Mesh
from sdm_deflect.meshing.mesh.pieces import FullMesh, MeshOnDisk, Pieces, gather_points
from sdm_deflect.meshing.mesh.polyhedra import SomePolyhedra, join_polyhedra
from sdm_deflect.meshing.mesh.quality import inverted_of, other_hand, other_handed
from sdm_deflect.meshing.mesh.standard import POLYHEDRON

from .boundary import PrescribedMotion
from .job import Amounts, Job, pose_of, poses_of, prepare, unnamed
from .region import confining_box

if TYPE_CHECKING:
    from sdm_deflect.meshing.mesh.thin import MidPlane

# Number of places in a block of cells where their numbering is tested, and cells at each.
PROBES, PROBED = 8, 1 << 14
# Ratio of the memory that judging a polyhedron takes to that of another cell.
LARGER = 4
Block = TypeVar("Block", bound=Faces)


class PointWindow(NamedTuple):
    """The points that some cells need.

    Attributes
    ----------
    points : (P, 3) coordinates.
    changed : (P,) whether a point may move.
    keys : (P,) random numbers of nodes on patches, 0 of others; the key of a face is the sum over its nodes.
    """

    points: FloatArray
    changed: BoolArray
    keys: Keys


@dataclass(frozen=True, slots=True, eq=False)
class CellScan:
    """What each piece of the mesh is compared with.

    Attributes
    ----------
    pieces : the mesh.
    boxes : each hexahedron, with the first point and the last but one (Z, 2) of each zone that deforms in it.
    moving : (K,) sorted indices of moving nodes.
    boundary : (B,) sorted indices of the nodes on patches.
    keys : (B,) random numbers of `boundary`; the key of a face is the sum over its nodes.
    faces : (F,) sorted keys of the patches' faces.
    sign : orientation of each block of cells.
    halfway : in a mesh one cell thick, the plane in which nodes are compared with the boxes.
    loaded : all points, if they are in memory.
    """

    pieces: Pieces
    boxes: tuple[tuple[Hexahedron, IntArray], ...] = field(repr=False)
    moving: IntArray = field(repr=False)
    boundary: IntArray = field(repr=False)
    keys: Keys = field(repr=False)
    faces: Keys = field(repr=False)
    sign: tuple[float, ...]
    halfway: "MidPlane | None" = None
    loaded: PointWindow | None = field(default=None, repr=False)

    def in_memory(self) -> "CellScan":
        """Return the task with all points in memory."""
        points = np.empty((self.pieces.points, 3))
        for start in range(0, len(points), threads.LIMITS.points):
            stop = min(start + threads.LIMITS.points, len(points))
            points[start:stop] = self.pieces.coordinates(start, stop)
        return replace(self, loaded=self.view_of(points, 0))

    def view(self, nodes: IntArray) -> tuple[PointWindow, IntArray]:
        """Return the points that cells with nodes (M, k) or (K,) need, and the nodes as rows of these points.

        If neighbours in the file have near nodes, the points are a range; else only the corners of these cells.
        InputError for nodes that do not exist.
        """
        low, high = int(nodes.min()), int(nodes.max()) + 1
        if low < 0 or high > self.pieces.points:
            raise InputError(
                f"{self.pieces.source}: nodes {low} to {high - 1}, but there are {self.pieces.points} points"
            )
        if self.loaded:
            return self.loaded, nodes
        if high - low <= max(nodes.size, threads.LIMITS.points):
            return self.view_of(self.pieces.coordinates(low, high), low), nodes - low
        unique = distinct(nodes)
        points = self.pieces.places(unique)
        changed, keys = self.inside(points, unique), np.zeros(len(unique), dtype=np.uint64)
        changed[_common(unique, self.moving)[0]] = True
        on, known = _common(unique, self.boundary)
        keys[on] = self.keys[known]
        return PointWindow(points, changed, keys), np.searchsorted(unique, nodes)

    def view_of(self, points: FloatArray, first: int) -> PointWindow:
        """Return a window on a range of points (P, 3) that starts at index `first`."""
        changed = self.inside(points, np.arange(first, first + len(points)))
        keys = np.zeros(len(points), dtype=np.uint64)
        rows = slice(*np.searchsorted(self.moving, (first, first + len(points))))
        changed[self.moving[rows] - first] = True
        rows = slice(*np.searchsorted(self.boundary, (first, first + len(points))))
        keys[self.boundary[rows] - first] = self.keys[rows]
        return PointWindow(points, changed, keys)

    def inside(self, points: FloatArray, nodes: IntArray) -> BoolArray:
        """Return which nodes (K,) at points (K, 3) lie in a box, in a zone that deforms there."""
        inside = np.zeros(len(nodes), dtype=np.bool_)
        points = self.halfway.places(points) if self.halfway else points
        for box, zones in self.boxes:
            deforming = np.zeros(len(nodes), dtype=np.bool_)
            for first, end in zones:
                deforming |= (nodes >= first) & (nodes < end)
            inside |= box.contains(points) & deforming
        return inside

    @property
    def is_scattered(self) -> bool:
        """Whether neighbours in the file have nodes far apart in it."""
        far = places = 0
        for block, (_, count) in enumerate(self.pieces.blocks):
            for start in np.linspace(0, max(0, count - PROBED), PROBES).astype(int).tolist() if count else ():
                nodes = self.pieces.cells_of(block, start, min(start + PROBED, count)).nodes
                far += int(np.ptp(nodes)) > threads.LIMITS.points
                places += 1
        return 2 * far > places


class CellsFound(NamedTuple):
    """Affected cells and their rows (R,); numbers of inverted and of mirrored cells; patch faces (F,) of all cells."""

    rows: IntArray
    cells: Cells | SomePolyhedra
    inverted: int
    mirrored: int
    faces: IntArray


def nodes_inside(task: CellScan, item: tuple[int, int]) -> tuple[IntArray, FloatArray]:
    """Return the points of a range that lie inside: indices (M,) and places (M, 3); InputError if not finite."""
    start, stop = item
    points = task.loaded.points[start:stop] if task.loaded else task.pieces.coordinates(start, stop)
    numbers = np.arange(start, stop)
    check_points(task.pieces, points, numbers)
    rows = np.flatnonzero(task.inside(points, numbers))
    return start + rows, points[rows]


def check_points(pieces: Pieces, points: FloatArray, numbers: IntArray) -> None:
    """Raise InputError if coordinates (K, 3) are not finite or too large; `numbers` (K,) are the points' indices."""
    if not (points.min(initial=0.0) > -LARGEST and points.max(initial=0.0) < LARGEST):
        bad = ~(np.abs(points) < LARGEST).all(axis=1)
        what = f"beyond {LARGEST:g}" if np.isfinite(points).all() else "not finite"
        raise InputError(f"{pieces.source}: points are {what}, the first is point {int(numbers[np.argmax(bad)])}")


def scan_cells(task: CellScan, item: tuple[int, int, int]) -> CellsFound:
    """Judge a range of cells of a block."""
    block, start, stop = item
    stored = task.pieces.cells_of(block, start, stop)
    view, nodes = task.view(stored.nodes)
    cells: Volume
    if isinstance(stored, Cells):
        cells, rows = Cells(stored.shape, nodes), None
    else:
        cells, rows = stored.renumbered(nodes, start, stop), np.arange(stop - start)
    inverted = int(np.count_nonzero(inverted_of(view.points, cells, rows, task.sign[block])))
    other = other_handed(view.points, cells, task.sign[block]) if inverted else np.empty(0, dtype=np.intp)
    if len(other) and isinstance(stored, Cells):
        stored = replace(stored, nodes=other_hand(stored, other))
    touched = touching(cells, view.changed) if task.loaded or view.changed.any() else np.empty(0, dtype=np.intp)
    touched = touched[touched < stop - start]  # one row stands for all polyhedra outside
    return CellsFound(
        start + touched, _some(stored, cells, touched), inverted, len(other), _faces_seen(task, view, cells)
    )


def beside(task: CellScan, item: tuple[int, IntArray]) -> CellsFound:
    """Return some untouched polyhedra (R,) of a block with all their faces."""
    block, rows = item
    stored = task.pieces.cells_of(block, int(rows[0]), int(rows[-1]) + 1)
    assert isinstance(stored, SomePolyhedra)
    sides, none = stored.sides, np.empty(0, dtype=np.intp)
    wanted = np.isin(sides.owner, rows)
    wanted[: len(sides.neighbour)] |= np.isin(sides.neighbour, rows)
    return CellsFound(none, stored.some(wanted), 0, 0, none)


def _some(stored: Cells | SomePolyhedra, cells: Volume, rows: IntArray) -> Cells | SomePolyhedra:
    """Return rows (R,) of cells in the form in which they are stored."""
    if isinstance(stored, Cells):
        return Cells(stored.shape, stored.nodes[rows])
    assert isinstance(cells, Polyhedra)
    chosen = np.zeros(len(cells), dtype=np.bool_)
    chosen[rows] = True
    faces = chosen[cells.owner]
    faces[: len(cells.neighbour)] |= chosen[cells.neighbour]
    return stored.some(faces)


def _common(nodes: IntArray, known: IntArray) -> tuple[IntArray, IntArray]:
    """Return the positions, in two sorted arrays of distinct indices, of their common entries."""
    first, end = np.searchsorted(known, (nodes[0], nodes[-1] + 1))
    near = known[first:end]
    place = np.searchsorted(nodes, near)
    there = np.flatnonzero(nodes[place] == near)
    return place[there], first + there


def _faces_seen(task: CellScan, view: PointWindow, cells: Volume) -> IntArray:
    """Return the patch faces (F,) of the cells, once for each cell."""
    if isinstance(cells, Polyhedra):
        keys = face_keys(cells.faces.rows(len(cells.neighbour), len(cells.faces)), view.keys)
    else:
        keys = np.concatenate([np.empty(0, np.uint64), *cell_face_keys((cells,), view.keys, view.keys > 0)])
    if not len(task.faces):
        return np.empty(0, dtype=np.intp)
    place = np.minimum(np.searchsorted(task.faces, keys), len(task.faces) - 1)
    return np.asarray(place[task.faces[place] == keys])


def submesh(
    mesh: MeshOnDisk, jobs: Sequence[Job], poses: Sequence[Amounts], runner: Runner, progress: Progress = silent
) -> Mesh:
    """Read the part of a mesh that jobs need at some poses of all surfaces.

    All points and cells are read once and judged piece by piece; again, if a patch turns out to lie between cells.

    Raises InputError if a job does not suit the mesh, or the mesh is damaged.
    """
    pieces, (mesh, border) = mesh.pieces, _in_order(mesh)
    task = _task(mesh, border, *prepare(border, jobs), poses)
    task = _in_memory(task) if runner.shares_memory else task
    inside, places = _nodes_inside(task, runner, progress)
    scanned, task, between = _cells(mesh, task, runner, progress)
    if rest := unnamed(_inner(task, border, between), border, jobs):
        return submesh(_without(mesh, rest), jobs, poses, runner, progress)
    known = union(task.boundary, inside)
    cells = [piece.cells for block in scanned for piece in block]
    beyond = np.setdiff1d(union(*(part.nodes for part in cells)), known, assume_unique=True)
    nodes = union(known, beyond)
    points = np.empty((len(nodes), 3))
    for some, at in ((task.boundary, border.points), (inside, places), (beyond, gather_points(pieces, beyond))):
        points[np.searchsorted(nodes, some)] = at
    blocks = [_block(shape, parts, nodes) for (shape, _), parts in zip(pieces.blocks, scanned, strict=True)]
    bad = tuple(sum(piece.inverted - piece.mirrored for piece in block) for block in scanned)
    whole = FullMesh(pieces, nodes, tuple(rows for _, rows in blocks), task.sign, bad)
    return _renumber(mesh, points, tuple(cells for cells, _ in blocks), whole)


def _in_order(mesh: MeshOnDisk) -> tuple[MeshOnDisk, Mesh]:
    """Return a mesh with the corners of its patches' faces in order, and its boundary."""
    border = _border(mesh)
    patches, notes = corners_in_order(border.patches, border.points)
    if not notes:
        return mesh, border
    numbers, ordered = border.numbers(np.arange(len(border.points))), []
    for patch, old in zip(patches, mesh.patches, strict=True):
        faces = tuple(replace(block, nodes=numbers[block.nodes]) for block in patch.faces)
        ordered.append(replace(patch, faces=faces, loose=old.loose))
    return replace(mesh, patches=tuple(ordered), notes=(*mesh.notes, *notes)), replace(border, patches=patches)


def _without(mesh: MeshOnDisk, names: Sequence[str]) -> MeshOnDisk:
    """Return a mesh without some patches, which follow it; a note says so (`Mesh.without`)."""
    return replace(
        mesh,
        patches=tuple(patch for patch in mesh.patches if patch.name not in names),
        notes=(*mesh.notes, FOLLOWS.format(short_list(names))),
    )


def boundary_in_file(pieces: Pieces, nodes: IntArray) -> IntArray:
    """Return those of the sorted nodes (K,) that lie on faces of one cell alone; all cells are read.

    Nodes of polyhedra all count as such: a file with these has one zone.
    """
    if any(shape == POLYHEDRON for shape, _ in pieces.blocks):
        return nodes
    near: list[Cells] = []
    for block, (shape, count) in enumerate(pieces.blocks):
        for start in range(0, count, threads.LIMITS.cells):
            block_nodes = pieces.cells_of(block, start, min(start + threads.LIMITS.cells, count)).nodes
            near.append(Cells(shape, block_nodes[np.isin(block_nodes, nodes).any(axis=1)]))
    known = union(*(cells.nodes for cells in near))
    cells = tuple(Cells(part.shape, np.searchsorted(known, part.nodes)) for part in near)
    skin = on_boundary(cells, len(known), np.searchsorted(known, np.intersect1d(known, nodes, assume_unique=True)))
    return known[skin]


def _inner(task: CellScan, border: Mesh, between: BoolArray) -> set[str]:
    """Return the patches whose faces all lie between two cells; `between` (F,) is a mask over the task's faces."""
    known, keys = task.faces[between], node_keys(len(border.points))
    some = [patch for patch in border.patches if len(patch) and not len(patch.loose)] if len(known) else []
    return {patch.name for patch in some if np.isin(patch_keys(patch, keys), known).all()}


def _border(mesh: MeshOnDisk) -> Mesh:
    """Return the boundary of a mesh without cells, and its periodic nodes."""
    nodes = union(*(patch.nodes for patch in mesh.patches), *(pair.nodes for pair in mesh.periodic))
    if len(nodes) and (nodes[0] < 0 or nodes[-1] >= mesh.pieces.points):
        raise InputError(f"{mesh.name}: patches name points that are not among the {mesh.pieces.points}")
    points = gather_points(mesh.pieces, nodes)
    check_points(mesh.pieces, points, nodes)
    return _renumber(mesh, points, (), FullMesh(mesh.pieces, nodes))


def _renumber(mesh: MeshOnDisk, points: FloatArray, cells: tuple[Volume, ...], whole: FullMesh) -> Mesh:
    """Return a mesh of some of the nodes, with patches, zones and periodic pairs in their numbering."""

    def own(block: Block) -> Block:
        return replace(block, nodes=np.searchsorted(whole.nodes, block.nodes))

    def placed(nodes: IntArray) -> IntArray:
        return np.searchsorted(whole.nodes, nodes)

    patches = tuple(
        replace(patch, faces=tuple(own(faces) for faces in patch.faces), loose=placed(patch.loose))
        for patch in mesh.patches
    )
    periodic = tuple(replace(pair, nodes=placed(pair.nodes)) for pair in mesh.periodic)
    ends = [np.searchsorted(whole.nodes, (zone.start, zone.stop)).tolist() for zone in mesh.zones]
    zones = tuple(replace(zone, start=low, stop=high) for zone, (low, high) in zip(mesh.zones, ends, strict=True))
    files, source = mesh.pieces.files, mesh.pieces.source
    return Mesh(points, cells, patches, zones, mesh.name, source, mesh.notes, whole, periodic, files)


def _task(mesh: MeshOnDisk, border: Mesh, loaded: Mesh, jobs: Sequence[Job], poses: Sequence[Amounts]) -> CellScan:
    """Return the task for jobs at some poses of all surfaces; `own` is the border that `prepare` returned for them."""
    boxes: list[tuple[Hexahedron, IntArray]] = []
    moving, halfway = [np.empty(0, dtype=np.intp)], None
    for job, amounts in zip(jobs, poses_of(jobs, poses or [pose_of(jobs)]), strict=True):
        if job.image_of >= 0:
            from .mirror import with_box_of

            job = with_box_of(job, boxes[job.image_of][0])
        boundary = PrescribedMotion.of(loaded, job)
        zones, box = confining_box(boundary, job.ends(amounts))
        names = {zone.name for zone in zones}
        spans = [(zone.start, zone.stop) for zone in mesh.zones if zone.name in names]
        boxes.append((box.hexahedron, np.array(spans, dtype=np.intp).reshape(-1, 2)))
        moving.append(loaded.numbers(boundary.both(boundary.nodes)))
        halfway = boundary.thin.halfway if boundary.thin else None
    keys, sign = node_keys(len(border.points)), (1.0,) * len(mesh.pieces.blocks)
    faces = distinct(np.concatenate([np.empty(0, np.uint64), *(patch_keys(patch, keys) for patch in border.patches)]))
    nodes = border.numbers(np.arange(len(border.points)))
    return CellScan(mesh.pieces, tuple(boxes), union(*moving), nodes, keys, faces, sign, halfway)


def _in_memory(task: CellScan) -> CellScan:
    """Return the task with all points in memory, if they are few or the cells' nodes are scattered."""
    return task.in_memory() if task.pieces.points <= threads.LIMITS.in_memory or task.is_scattered else task


def _nodes_inside(task: CellScan, runner: Runner, progress: Progress) -> tuple[IntArray, FloatArray]:
    """Return the nodes (M,) in the boxes and their places (M, 3); InputError for coordinates that are not finite."""
    count = task.pieces.points
    items = [(start, min(start + threads.LIMITS.points, count)) for start in range(0, count, threads.LIMITS.points)]
    scanned = []
    for i, piece in enumerate(runner.map(nodes_inside, task, items), 1):
        scanned.append(piece)
        progress("points", i / len(items))
    nodes = np.concatenate([np.empty(0, dtype=np.intp), *(piece for piece, _ in scanned)])
    return nodes, np.concatenate([np.empty((0, 3)), *(points for _, points in scanned)])


def _cells(
    mesh: MeshOnDisk, task: CellScan, runner: Runner, progress: Progress
) -> tuple[list[list[CellsFound]], CellScan, BoolArray]:
    """Judge all cells; return the affected ones of each block, and the task with the blocks' orientation.

    Also which of the patches' faces (F,) lie between two cells. InputError if a patch face belongs to no cell.
    """
    pieces = task.pieces
    if not sum(count for _, count in pieces.blocks):
        raise InputError(f"{mesh.name}: there are no volume cells")
    blocks, seen = [], np.zeros(len(task.faces), dtype=np.intp)
    for block, (_, count) in enumerate(pieces.blocks):
        scanned = _judged_cells(task, block, runner, progress)
        if 2 * sum(piece.inverted for piece in scanned) > count:
            other = replace(task, sign=(*task.sign[:block], -1.0, *task.sign[block + 1 :]))
            mirrored = _judged_cells(other, block, runner, progress)
            if sum(piece.inverted for piece in mirrored) < sum(piece.inverted for piece in scanned):
                scanned, task = mirrored, other
        for piece in scanned:
            np.add.at(seen, piece.faces, 1)
        blocks.append(scanned + _around(task, block, scanned, runner))
    if not seen.all():
        _refuse_loose(mesh, task, task.faces[seen == 0])
    return blocks, task, seen > 1


def _around(task: CellScan, block: int, scanned: list[CellsFound], runner: Runner) -> list[CellsFound]:
    """Return the polyhedra next to the affected ones with all their faces: their centres are needed."""
    sides = [piece.cells.sides for piece in scanned if isinstance(piece.cells, SomePolyhedra)]
    known = union(*(piece.rows for piece in scanned))
    cells = np.setdiff1d(union(*(ends for side in sides for ends in (side.owner, side.neighbour))), known, True)
    pieces = np.split(cells, np.flatnonzero(np.diff(cells // (threads.LIMITS.cells // LARGER))) + 1)
    return list(runner.map(beside, task, [(block, rows) for rows in pieces if len(rows)]))


def _judged_cells(task: CellScan, block: int, runner: Runner, progress: Progress) -> list[CellsFound]:
    shape, count = task.pieces.blocks[block]
    size = threads.LIMITS.cells // LARGER if shape == POLYHEDRON else threads.LIMITS.cells
    items = [(block, start, min(start + size, count)) for start in range(0, count, size)]
    scanned = []
    for i, piece in enumerate(runner.map(scan_cells, task, items), 1):
        scanned.append(piece)
        progress(f"cells ({shape})", i / len(items))
    return scanned


def _refuse_loose(mesh: MeshOnDisk, task: CellScan, missing: Keys) -> None:
    loose = []
    for patch in mesh.patches:
        numbers = [replace(faces, nodes=np.searchsorted(task.boundary, faces.nodes)) for faces in patch.faces]
        count = np.count_nonzero(np.isin(patch_keys(Patch(patch.name, tuple(numbers)), task.keys), missing))
        loose += [f"{count} of {len(patch)} faces of patch {patch.name}"] if count else []
    raise InputError(f"{mesh.name}: {short_list(loose)} are of no cell")


def _block(shape: str, scanned: Sequence[CellsFound], nodes: IntArray) -> tuple[Volume, IntArray]:
    """Return the affected cells of a block in the numbering of the submesh, and their rows in the whole mesh.

    Affected polyhedra come with their neighbours, and these with neighbours that lack some faces.
    """
    some = [piece.cells for piece in scanned if isinstance(piece.cells, SomePolyhedra)]
    if some:
        return join_polyhedra(some).within(nodes)
    count, end = sum(len(piece.rows) for piece in scanned), 0
    cells, rows = np.empty((count, CORNERS[shape]), dtype=np.intp), np.empty(count, dtype=np.intp)
    for piece in scanned:
        place = slice(end, end := end + len(piece.rows))
        rows[place] = piece.rows
        if len(piece.rows):
            low, high = int(piece.cells.nodes.min()), int(piece.cells.nodes.max()) + 1
            first, stop = np.searchsorted(nodes, (low, high))
            cells[place] = first + np.searchsorted(nodes[first:stop], piece.cells.nodes)
    return Cells(shape, cells), rows
