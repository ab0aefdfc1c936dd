"""What was written is read back from the disk before it takes its place: it must be what was judged."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sdm_deflect.deform.base import limits
from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.edges import edges_of
from sdm_deflect.deform.mesh.faces import FACES, Keys
from sdm_deflect.deform.mesh.mesh import PLANE, Cells, Mesh, Polyhedra, Volume
from sdm_deflect.deform.mesh.parts import taken
from sdm_deflect.deform.mesh.polyhedra import SomePolyhedra
from sdm_deflect.deform.mesh.quality import one_hand, other_hand, other_handed
from sdm_deflect.deform.mesh.touched import touching
from sdm_deflect.deform.volume.excerpt import gathered
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.registry import format_of, in_pieces
from sdm_deflect.meshing.formats.shapes import oriented

DIFFERS = "{}: what was written does not read back as what was judged, and is discarded: {}"
ROWS = 1 << 18
"""Cells whose keys are found at a time."""


def check_written(mesh: Mesh, points: FloatArray, moved: IntArray, staged: Path, out: Path) -> None:
    """Read a file that was written for a mesh with its nodes at `points` (N, 3), and compare, to the bit.

    All coordinates are compared, of a mesh in pieces those of the excerpt; and the cells with a node of `moved` (K,),
    whatever their order in the file.

    Raises MeshFileError, which names the file `out` that is to be, if it is another mesh or cannot be read.
    """
    if text := difference(mesh, points, moved, staged):
        raise MeshFileError(DIFFERS.format(out, text.replace(str(staged), out.name)))


def difference(mesh: Mesh, points: FloatArray, moved: IntArray, path: Path) -> str:
    """Return how a file differs from a mesh, as `check_written` compares them; nothing if it does not."""
    try:
        text = format_of(path).points_of_copy(path, Path(mesh.source)) if mesh.whole else None
        if text is not None:
            return _text(mesh, points, text)
        return (_in_pieces if mesh.whole else _whole)(mesh, points, moved, path)
    except (MeshFileError, InputError) as error:
        return str(error)


def check_points(points: FloatArray, found: FloatArray, axes: int = 3) -> str:
    """Return how coordinates (N, 3) that were read back differ from those that were judged; nothing if they do not."""
    if len(points) != len(found):
        return f"it has {len(found)} points, not {len(points)}"
    same = points[:, :axes] == found[:, :axes]
    if same.all():
        return ""
    row = int(np.argmin(same.all(axis=1)))
    x, y = (" ".join(f"{value:.17g}" for value in places[row]) for places in (found, points))
    return f"{np.count_nonzero(~same.all(axis=1))} points are elsewhere, the first at {x}, not {y}"


def _whole(mesh: Mesh, points: FloatArray, moved: IntArray, staged: Path) -> str:
    back = format_of(staged).read_copy(staged, Path(mesh.source))
    if found := check_points(points, back.points, 2 if mesh.plane else 3):
        return found
    cells = [one_hand(mesh.points, block) for block in back.cells]
    if _alike(mesh.cells, cells):
        return ""
    marked = np.zeros(len(points), dtype=np.bool_)
    marked[moved] = True
    judged = [oriented(points, block) if isinstance(block, Cells) else block for block in mesh.cells]
    own, other = (_all_keys(blocks, marked) for blocks in (judged, cells))
    return "" if np.array_equal(own, other) else "its cells are others"


def _text(mesh: Mesh, points: FloatArray, stored: FloatArray) -> str:
    assert mesh.whole
    return check_points(points, stored[mesh.whole.nodes]) if len(stored) == mesh.point_count else "it has other points"


def _in_pieces(mesh: Mesh, points: FloatArray, moved: IntArray, staged: Path) -> str:
    assert mesh.whole
    with in_pieces(staged) as back:
        if back is None or back.pieces.blocks != mesh.whole.pieces.blocks:
            return "it has other cells"
        if back.pieces.points != mesh.whole.pieces.points:
            return f"it has {back.pieces.points} points, not {mesh.whole.pieces.points}"
        if found := check_points(points, gathered(back.pieces, mesh.whole.nodes)):
            return found
        marked = np.zeros(len(points), dtype=np.bool_)
        marked[moved] = True
        for number, (block, rows) in enumerate(zip(mesh.cells, mesh.whole.rows, strict=True)):
            own = touching(block, marked)
            keys, places = _keys(_numbered(block, mesh.whole.nodes), own), rows[own]
            size = limits.LIMITS.cells
            for start in range(0, back.pieces.blocks[number][1], size):
                first, end = np.searchsorted(places, (start, start + size))
                if first < end:
                    low, high = int(places[first]), int(places[end - 1]) + 1
                    some = back.pieces.cells_of(number, low, high)
                    at = places[first:end] - low
                    if not np.array_equal(_keys(_as_judged(mesh, number, some, low, at), at), keys[first:end]):
                        return f"some of its cells {low} to {high - 1} are others"
    return ""


def _as_judged(mesh: Mesh, number: int, some: Cells | SomePolyhedra, low: int, at: IntArray) -> Volume:
    """Return cells of a block from `low` on as they were judged: those at some rows (R,) in the hand of the block."""
    assert mesh.whole
    if isinstance(some, SomePolyhedra):
        return some.counted(some.nodes, low, low + int(at[-1]) + 1)
    near = Cells(some.shape, np.searchsorted(mesh.whole.nodes, some.nodes[at]))
    return Cells(some.shape, other_hand(some, at[other_handed(mesh.points, near, mesh.whole.orientation[number])]))


def _alike(cells: Sequence[Volume], others: Sequence[Volume]) -> bool:
    """Whether blocks have the same cells in the same order, those of one shape one after another."""
    own, other = _stacked(cells), _stacked(others)
    return own.keys() == other.keys() and all(np.array_equal(own[name], other[name]) for name in own)


def _stacked(blocks: Sequence[Volume]) -> dict[str, IntArray]:
    found: dict[str, list[IntArray]] = {}
    for i, block in enumerate(blocks):
        if isinstance(block, Polyhedra):
            parts = {"nodes": block.faces.nodes, "offsets": block.faces.offsets}
            for name, own in (parts | {"owner": block.owner, "neighbour": block.neighbour}).items():
                found[f"{name} {i}"] = [own]
        elif len(block):
            found.setdefault(block.shape, []).append(block.nodes)
    return {name: parts[0] if len(parts) == 1 else np.concatenate(parts) for name, parts in found.items()}


def _numbered(block: Volume, nodes: IntArray) -> Volume:
    """Return cells with the numbers (N,) of their nodes in the file."""
    if isinstance(block, Polyhedra):
        return replace(block, faces=replace(block.faces, nodes=nodes[block.faces.nodes]))
    return replace(block, nodes=nodes[block.nodes])


def _all_keys(blocks: Sequence[Volume], marked: BoolArray) -> Keys:
    """Return the rising keys of all cells with a marked node (N,)."""
    return np.sort(np.concatenate([_none(), *(_keys(block, touching(block, marked)) for block in blocks)]))


def _keys(block: Volume, rows: IntArray) -> Keys:
    """Return a number for each of rows (R,) of cells that follows from its faces: their nodes, and which way they go.

    It does not depend on the face, or on the corner of it, that is named first. Two different cells share a number with
    probability 2^-64.
    """
    if isinstance(block, Polyhedra):
        return _keys_of_polyhedra(block, rows)
    faces = FACES[block.shape] if block.shape not in PLANE else (tuple(range(block.nodes.shape[1])),)
    parts = [_none()]
    for start in range(0, len(rows), ROWS):
        nodes = block.nodes[rows[start : start + ROWS]].T
        begin, end = _mixed(nodes, 1), _mixed(nodes, 2)
        total = np.zeros(nodes.shape[1], dtype=np.uint64)
        for face in faces:
            around = zip(face, (*face[1:], face[0]), strict=True)
            total += _mixed(np.asarray(np.sum([begin[a] * end[b] for a, b in around], axis=0, dtype=np.uint64)), 3)
        parts.append(total)
    return np.concatenate(parts)


def _keys_of_polyhedra(cells: Polyhedra, rows: IntArray) -> Keys:
    wanted = np.zeros(len(cells), dtype=np.bool_)
    wanted[rows] = True
    inner, chosen = len(cells.neighbour), wanted[cells.owner]
    chosen[:inner] |= wanted[cells.neighbour]
    some = np.flatnonzero(chosen)
    total = np.zeros(len(cells), dtype=np.uint64)
    if len(some):
        faces = taken(cells.faces, some)
        (start, end), first = edges_of(faces)[0].T, faces.offsets[:-1]
        for a, b, cell in ((start, end, cells.owner[some]), (end, start, cells.neighbour[some[some < inner]])):
            key = _mixed(np.add.reduceat(_mixed(a, 1) * _mixed(b, 2), first), 3)
            np.add.at(total, cell, key[: len(cell)])
    return np.asarray(total[rows])


def _mixed(numbers: IntArray | Keys, salt: int) -> Keys:
    """Return numbers of 64 random bits, always the same for the same numbers (the finaliser of SplitMix64)."""
    found = numbers.astype(np.uint64) + np.uint64((salt * 0x9E3779B97F4A7C15) % (1 << 64))
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        found = (found ^ (found >> np.uint64(shift))) * np.uint64(factor)
    return np.asarray(found ^ (found >> np.uint64(31)))


def _none() -> Keys:
    return np.empty(0, dtype=np.uint64)
