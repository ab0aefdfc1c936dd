"""Faces compared by their nodes: boundary faces of affected cells, and faces of patches."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, IntArray, count_distinct, distinct, union

from .affected import AffectedCells, touching
from .cells import Cells, Patch, Polygons, Polyhedra, Volume, take_faces
from .edges import polygons_of, rows_of

# Corners of the faces of each shape in VTK's order; normals (right-hand rule) point out of the cell. Plane cells have
# lines, with the cell on their left.
FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hexahedron": ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)),
}
# Shape of a face by its number of corners.
FACE_SHAPES = {2: "line", 3: "triangle", 4: "quad"}
# Faces of a patch that are tried before all of them: one that is no inner face ends the search of most patches.
SAMPLE = 3
# Cells in one block, so that temporaries stay small.
ROWS = 1 << 18
Keys = NDArray[np.uint64]
Marks = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class BoundaryGaps:
    """Boundary faces near moving nodes that are on no patch, and patch faces that are no boundary.

    Attributes
    ----------
    faces : number of faces of one cell that are on no patch.
    nodes : (K,) nodes of these faces that no patch has; they move like nodes inside the flow.
    loose : number of patch faces that belong to no cell.
    inner : number of faces of moving patches between two cells.
    """

    faces: int
    nodes: IntArray = field(repr=False)
    loose: int
    inner: int

    @classmethod
    def of(cls, affected: AffectedCells, changed: IntArray, moving: tuple[str, ...]) -> "BoundaryGaps":
        """Compare the faces of affected cells with a node of `changed` (M,) with the faces of all patches."""
        mesh = affected.mesh
        marked = np.zeros(len(mesh.points), dtype=np.bool_)
        marked[changed] = True
        keys = node_keys(len(mesh.points))
        parts = zip(mesh.cells, affected.rows, strict=True)
        known, count = count_distinct(_join([_keys_of(*part, marked, keys) for part in parts]))
        on_patches = {
            patch.name: _join([face_keys(faces, keys)[_with_any(faces, marked)] for faces in patch.faces])
            for patch in mesh.patches
        }
        every = distinct(_join(list(on_patches.values())))
        missed = np.setdiff1d(known[count == 1], every, assume_unique=True)
        loose = sum(int(np.count_nonzero(~_among(on_patch, known))) for on_patch in on_patches.values())
        inner = sum(int(np.count_nonzero(_among(on_patches[name], known[count > 1]))) for name in moving)
        free = np.setdiff1d(changed, mesh.on(*mesh.names), assume_unique=True)
        nodes = _nodes_of(affected, keys, missed) if len(missed) else changed[:0]
        return cls(len(missed), np.intersect1d(nodes, free, assume_unique=True), loose, inner)


def node_keys(points: int) -> Keys:
    """Return fixed random numbers (N,); the key of a face is the sum over its nodes, in any order.

    Two different faces have equal keys with probability 2^-64.
    """
    return np.random.default_rng(20).integers(0, 1 << 64, points, dtype=np.uint64)


def face_keys(faces: Cells | Polygons, keys: Keys) -> Keys:
    """Return the key (F,) of each face, given the nodes' keys (N,); equal for faces of equal nodes."""
    if isinstance(faces, Cells):
        total: Keys = keys[faces.nodes].sum(axis=1, dtype=np.uint64)
        return total
    blocks = (faces.rows(i, i + ROWS) for i in range(0, len(faces), ROWS))
    return _join([np.add.reduceat(keys[b.nodes], b.offsets[:-1]) for b in blocks])


def patch_keys(patch: Patch, keys: Keys) -> Keys:
    """Return the keys (F,) of all faces of a patch."""
    return _join([face_keys(faces, keys) for faces in patch.faces])


def corners_in_order(patches: Sequence[Patch], points: FloatArray) -> tuple[tuple[Patch, ...], list[str]]:
    """Put the corners of quadrilaterals whose opposite edges cross in the order around the face.

    Returns the patches, and a note for each that changed. A crossed quadrilateral has its corners in the order 0 2 1 3
    or 0 1 3 2: two of them are exchanged.
    """
    out, notes = [], []
    for patch in patches:
        blocks, count = [], 0
        for faces in patch.faces:
            bad = _crossed(points, faces.nodes) if isinstance(faces, Cells) and faces.shape == "quad" else ()
            if len(rows := np.flatnonzero(bad)):
                nodes, count = faces.nodes.copy(), count + len(rows)
                nodes[rows] = nodes[rows][:, [0, 2, 1, 3]]
                still = rows[_crossed(points, nodes[rows])]
                nodes[still] = faces.nodes[still][:, [0, 1, 3, 2]]
                faces = replace(faces, nodes=nodes)
            blocks.append(faces)
        out.append(replace(patch, faces=tuple(blocks)) if count else patch)
        if count:
            notes.append(f"{patch.name}: {count} of {len(patch)} faces have their corners out of order; read in order")
    return tuple(out), notes


def _crossed(points: FloatArray, nodes: IntArray) -> Marks:
    """Return which quadrilaterals (F, 4) cross themselves: diagonals divide them into triangles of opposite sense."""
    a, b, c, d = np.moveaxis(points[nodes], 1, 0)
    one = np.einsum("fi,fi->f", np.cross(b - a, c - a), np.cross(c - a, d - a))
    other = np.einsum("fi,fi->f", np.cross(c - b, d - b), np.cross(d - b, a - b))
    return np.asarray((one < 0.0) & (other < 0.0))


def inner_patches(patches: Iterable[Patch], cells: Callable[[], Iterable[Volume]], points: int) -> set[str]:
    """Return the names of the patches whose faces all lie between two cells.

    Parameters
    ----------
    patches : The patches to test.
    cells : Function that yields all cells of a mesh in parts; polyhedra have no such patches.
    """
    some = {patch.name: patch for patch in patches if len(patch) and not len(patch.loose)}
    for most in (SAMPLE, inf):  # a few faces of each patch first: most patches are no inner ones
        chosen = {name: _some_faces(patch, most) for name, patch in some.items()}
        marked = np.zeros(points, dtype=np.bool_)
        for faces in chosen.values():
            marked[faces.nodes] = True
        keys = node_keys(points) if some else np.empty(0, np.uint64)
        parts = [part for block in (cells() if some else ()) for part in cell_face_keys((block,), keys, marked)]
        known, count = count_distinct(_join(parts))
        between = known[count > 1]
        some = {name: some[name] for name, faces in chosen.items() if _among(face_keys(faces, keys), between).all()}
    return {*some}


def _some_faces(patch: Patch, most: float) -> Polygons:
    """Return at most a given number of faces of a patch, evenly chosen."""
    faces = polygons_of(patch.faces)
    count = int(min(most, len(faces)))
    return take_faces(faces, np.linspace(0, len(faces) - 1, count).round().astype(np.intp))


def on_boundary(cells: Sequence[Volume], points: int, nodes: IntArray) -> IntArray:
    """Return the nodes, among given ones (K,), that lie on a face of only one cell; the mesh has `points` points."""
    marked, keys = np.zeros(points, dtype=np.bool_), node_keys(points)
    marked[nodes] = True
    parts = [(block, touching(block, marked)) for block in cells]
    known, count = count_distinct(_join([_keys_of(block, rows, marked, keys) for block, rows in parts]))
    outer = known[count == 1]
    return np.intersect1d(nodes, union(*(_nodes_in(block, rows, keys, outer) for block, rows in parts)))


def cell_face_keys(cells: Iterable[Volume], keys: Keys, marked: Marks) -> Iterator[Keys]:
    """Yield the keys of the faces of cells that have at least as many marked nodes (N,) as a face."""
    among = marked.astype(np.uint8)
    for block in cells:
        if isinstance(block, Polyhedra):
            yield face_keys(block.faces, keys)
            continue
        for start in range(0, len(block), ROWS):
            nodes = block.nodes[start : start + ROWS]
            least = min(map(len, FACES[block.shape]))
            near = nodes[sum(among[corner] for corner in nodes.T) >= least]  # much faster than by rows
            for face in FACES[block.shape]:
                corners = near[:, list(face)]
                yield keys[corners[among[corners].all(axis=1)]].sum(axis=1, dtype=np.uint64)


def _among(keys: Keys, known: Keys) -> Marks:
    """Return which keys (F,) are among the sorted keys `known` (K,)."""
    place = np.searchsorted(known, keys)
    return np.asarray(known[np.minimum(place, len(known) - 1)] == keys) if len(known) else np.zeros(len(keys), np.bool_)


def _join(parts: list[Keys]) -> Keys:
    return np.concatenate([np.empty(0, np.uint64), *parts])


def _with_any(faces: Cells | Polygons, marked: Marks) -> Marks:
    """Return which faces (F,) have a marked node."""
    if isinstance(faces, Cells):
        return np.asarray(marked[faces.nodes].any(axis=1))
    some = np.logical_or.reduceat(marked[faces.nodes], faces.offsets[:-1]) if len(faces) else np.empty(0, np.bool_)
    return np.asarray(some, dtype=np.bool_)


def _keys_of(block: Volume, rows: IntArray, marked: Marks, keys: Keys) -> Keys:
    """Return the keys of faces with a marked node, once for each cell of the face.

    Two faces of polyhedra with equal nodes and one owner each form a baffle, not a face between two cells.
    """
    if isinstance(block, Polyhedra):
        all_keys, marked_rows = face_keys(block.faces, keys), _with_any(block.faces, marked)
        inner, outer = np.split(marked_rows, [len(block.neighbour)])
        between = all_keys[: len(inner)][inner]
        return np.concatenate([between, between, distinct(all_keys[len(inner) :][outer])])
    return _join([face_keys(faces, keys)[_with_any(faces, marked)] for faces in faces_of(block, rows)])


def faces_of(block: Cells, rows: IntArray) -> Iterator[Cells]:
    """Yield the faces of rows (R,) of cells in parts; their normals point out of the cells."""
    for part in rows_of(len(rows), ROWS):
        nodes = block.nodes[rows[part]]
        for face in FACES[block.shape]:
            yield Cells(FACE_SHAPES[len(face)], nodes[:, list(face)])


def _nodes_of(affected: AffectedCells, keys: Keys, wanted: Keys) -> IntArray:
    """Return the nodes (K,) of affected cells' faces with one of the wanted keys."""
    parts = zip(affected.mesh.cells, affected.rows, strict=True)
    return union(*(_nodes_in(block, rows, keys, wanted) for block, rows in parts))


def _nodes_in(block: Volume, rows: IntArray, keys: Keys, wanted: Keys) -> IntArray:
    """Return the nodes (K,) of those faces of cells (R,) of a block that have one of the wanted keys."""
    if isinstance(block, Polyhedra):
        wanted_faces = np.isin(face_keys(block.faces, keys), wanted)
        return block.faces.nodes[np.repeat(wanted_faces, np.diff(block.faces.offsets))]
    return union(*(faces.nodes[np.isin(face_keys(faces, keys), wanted)] for faces in faces_of(block, rows)))
