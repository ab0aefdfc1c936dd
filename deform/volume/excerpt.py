"""The excerpt of a mesh in pieces that a deflection needs: its boundary, the nodes in the box, and the cells there.

Nodes keep their order, so that all that follows from an excerpt has the same bits as from the whole mesh.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from sdm_deflect.deform.base import limits
from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.base.sets import distinct, union
from sdm_deflect.deform.hexahedron import Hexahedron
from sdm_deflect.deform.mesh.cells import CORNERS, Cells, Faces, Patch, Volume, Zone
from sdm_deflect.deform.mesh.faces import Keys, node_keys, patch_keys
from sdm_deflect.deform.mesh.mesh import Mesh, Whole
from sdm_deflect.deform.mesh.pieces import MeshInPieces, Pieces, Runner
from sdm_deflect.deform.mesh.polyhedra import SomePolyhedra, joined
from sdm_deflect.deform.mesh.quality import POLYHEDRON
from sdm_deflect.deform.volume.boundary import PrescribedNodes
from sdm_deflect.deform.volume.job import Job, prepared
from sdm_deflect.deform.volume.region import confined
from sdm_deflect.deform.volume.scan import CellsFound, ScanTask, beside, check_points, nodes_inside, scan_cells

LARGER = 4
"""How many times the memory of another cell a polyhedron takes while it is judged."""
Block = TypeVar("Block", bound=Faces)


def excerpt(
    mesh: MeshInPieces, jobs: Sequence[Job], angles: Sequence[float], runner: Runner, progress: Progress = silent
) -> Mesh:
    """Return what the plans for jobs and the first one's angles need of a mesh.

    All points and cells are read once and judged, piece by piece.

    Raises InputError if a job does not suit the mesh, or the mesh is damaged.
    """
    pieces = mesh.pieces
    border = _border(mesh)
    task = _task(mesh, border, *_boxes(border, jobs, angles))
    task = _in_memory(task) if runner.shares_memory else task
    inside, places = _nodes_inside(task, runner, progress)
    found, task = _cells(mesh, task, runner, progress)
    known = union(task.boundary, inside)
    beyond = np.setdiff1d(union(*(one.cells.nodes for block in found for one in block)), known, assume_unique=True)
    nodes = union(known, beyond)
    points = np.empty((len(nodes), 3))
    for some, at in ((task.boundary, border.points), (inside, places), (beyond, gathered(pieces, beyond))):
        points[np.searchsorted(nodes, some)] = at
    blocks = [_block(shape, own, nodes) for (shape, _), own in zip(pieces.blocks, found, strict=True)]
    bad = tuple(sum(one.inverted - one.mirrored for one in block) for block in found)
    whole = Whole(pieces, nodes, tuple(rows for _, rows in blocks), task.sign, bad)
    return _numbered(mesh, points, tuple(cells for cells, _ in blocks), whole)


def _boxes(
    border: Mesh, jobs: Sequence[Job], angles: Sequence[float]
) -> tuple[list[tuple[Hexahedron, tuple[Zone, ...]]], IntArray]:
    """Return the box of each job with the zones that deform in it, and the nodes in the file that move."""
    mesh, boxes, moving = prepared(border, jobs), [], []
    for job in jobs:
        boundary = PrescribedNodes.of(mesh, job)
        zones, box = confined(boundary, job.ends([job.beside(jobs[0], angle) for angle in angles] or [job.angle]))
        boxes.append((box.hexahedron, zones))
        moving.append(mesh.numbers(boundary.nodes))
    return boxes, union(*moving)


def _border(mesh: MeshInPieces) -> Mesh:
    """Return the boundary of a mesh, without cells, and the nodes that are images of one another."""
    nodes = union(*(patch.nodes for patch in mesh.patches), *(pair.nodes for pair in mesh.periodic))
    if len(nodes) and (nodes[0] < 0 or nodes[-1] >= mesh.pieces.points):
        raise InputError(f"{mesh.name}: patches name points that are not among the {mesh.pieces.points}")
    points = gathered(mesh.pieces, nodes)
    check_points(mesh.pieces, points, nodes)
    return _numbered(mesh, points, (), Whole(mesh.pieces, nodes))


def _numbered(mesh: MeshInPieces, points: FloatArray, cells: tuple[Volume, ...], whole: Whole) -> Mesh:
    """Return a mesh of some nodes: patches, zones and periodic pairs in their numbers."""

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


def _task(
    mesh: MeshInPieces, border: Mesh, boxes: Sequence[tuple[Hexahedron, tuple[Zone, ...]]], moving: IntArray
) -> ScanTask:
    assert border.whole is not None
    spans = []
    for box, zones in boxes:
        deforming = [(zone.start, zone.stop) for zone in mesh.zones if zone.name in {own.name for own in zones}]
        spans.append((box, np.array(deforming, dtype=np.intp).reshape(-1, 2)))
    keys = node_keys(len(border.points))
    faces = distinct(np.concatenate([np.empty(0, np.uint64), *(patch_keys(patch, keys) for patch in border.patches)]))
    sign = (1.0,) * len(mesh.pieces.blocks)
    return ScanTask(mesh.pieces, tuple(spans), moving, border.whole.nodes, keys, faces, sign)


def _in_memory(task: ScanTask) -> ScanTask:
    """Return the task with all points held in memory, if these are few, or if cells need them in no order."""
    return task.holding() if task.pieces.points <= limits.LIMITS.held or task.is_scattered else task


def _nodes_inside(task: ScanTask, runner: Runner, progress: Progress) -> tuple[IntArray, FloatArray]:
    """Return the nodes (M,) in the box and their coordinates (M, 3); InputError for coordinates that are no numbers."""
    count = task.pieces.points
    items = [(start, min(start + limits.LIMITS.points, count)) for start in range(0, count, limits.LIMITS.points)]
    found = []
    for i, own in enumerate(runner.map(nodes_inside, task, items), 1):
        found.append(own)
        progress("points", i / len(items))
    nodes = np.concatenate([np.empty(0, dtype=np.intp), *(own for own, _ in found)])
    return nodes, np.concatenate([np.empty((0, 3)), *(points for _, points in found)])


def _cells(
    mesh: MeshInPieces, task: ScanTask, runner: Runner, progress: Progress
) -> tuple[list[list[CellsFound]], ScanTask]:
    """Judge all cells; return the touched ones of each block, and the task with the blocks' orientation.

    InputError if a face of a patch is of no cell.
    """
    pieces = task.pieces
    if not sum(count for _, count in pieces.blocks):
        raise InputError(f"{mesh.name}: there are no volume cells")
    found, seen = [], np.zeros(len(task.faces), dtype=np.bool_)
    for block, (_, count) in enumerate(pieces.blocks):
        own = _judged_cells(task, block, runner, progress)
        if 2 * sum(one.inverted for one in own) > count:
            other = replace(task, sign=(*task.sign[:block], -1.0, *task.sign[block + 1 :]))
            mirrored = _judged_cells(other, block, runner, progress)
            if sum(one.inverted for one in mirrored) < sum(one.inverted for one in own):
                own, task = mirrored, other
        for one in own:
            seen[one.faces] = True
        found.append(own + _around(task, block, own, runner))
    if not seen.all():
        _refuse_loose(mesh, task, task.faces[~seen])
    return found, task


def _around(task: ScanTask, block: int, found: list[CellsFound], runner: Runner) -> list[CellsFound]:
    """Return the polyhedra beyond the faces of the touched ones, with all their faces: their centres are needed."""
    sides = [one.cells.sides for one in found if isinstance(one.cells, SomePolyhedra)]
    known = union(*(one.rows for one in found))
    cells = np.setdiff1d(union(*(one for own in sides for one in (own.owner, own.neighbour))), known, True)
    pieces = np.split(cells, np.flatnonzero(np.diff(cells // (limits.LIMITS.cells // LARGER))) + 1)
    return list(runner.map(beside, task, [(block, own) for own in pieces if len(own)]))


def _judged_cells(task: ScanTask, block: int, runner: Runner, progress: Progress) -> list[CellsFound]:
    shape, count = task.pieces.blocks[block]
    size = limits.LIMITS.cells // LARGER if shape == POLYHEDRON else limits.LIMITS.cells
    items = [(block, start, min(start + size, count)) for start in range(0, count, size)]
    found = []
    for i, own in enumerate(runner.map(scan_cells, task, items), 1):
        found.append(own)
        progress(f"cells ({shape})", i / len(items))
    return found


def _refuse_loose(mesh: MeshInPieces, task: ScanTask, missing: Keys) -> None:
    loose = []
    for patch in mesh.patches:
        numbers = [replace(faces, nodes=np.searchsorted(task.boundary, faces.nodes)) for faces in patch.faces]
        count = np.count_nonzero(np.isin(patch_keys(Patch(patch.name, tuple(numbers)), task.keys), missing))
        loose += [f"{count} of {len(patch)} faces of patch {patch.name}"] if count else []
    raise InputError(f"{mesh.name}: {', '.join(loose)} are of no cell")


def gathered(pieces: Pieces, nodes: IntArray) -> FloatArray:
    """Return the coordinates (K, 3) of sorted nodes, range by range."""
    found = np.empty((len(nodes), 3))
    for start in range(0, pieces.points, limits.LIMITS.points) if len(nodes) else ():
        first, end = np.searchsorted(nodes, (start, start + limits.LIMITS.points))
        if end > first:
            low = int(nodes[first])
            found[first:end] = pieces.coordinates(low, int(nodes[end - 1]) + 1)[nodes[first:end] - low]
    return found


def _block(shape: str, found: Sequence[CellsFound], nodes: IntArray) -> tuple[Volume, IntArray]:
    """Return the touched cells of a block in the numbers of the excerpt, and their rows in the whole mesh.

    Of polyhedra those beyond their faces are there, too, and those beyond these, the latter without all their faces.
    """
    some = [one.cells for one in found if isinstance(one.cells, SomePolyhedra)]
    if some:
        return joined(some).within(nodes)
    count, end = sum(len(one.rows) for one in found), 0
    cells, rows = np.empty((count, CORNERS[shape]), dtype=np.intp), np.empty(count, dtype=np.intp)
    for one in found:
        own = slice(end, end := end + len(one.rows))
        rows[own] = one.rows
        if len(one.rows):
            low, high = int(one.cells.nodes.min()), int(one.cells.nodes.max()) + 1
            first, stop = np.searchsorted(nodes, (low, high))
            cells[own] = first + np.searchsorted(nodes[first:stop], one.cells.nodes)
    return Cells(shape, cells), rows
