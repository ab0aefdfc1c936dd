"""Faces by their nodes: which of them bound touched cells, and whether patches have them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import IntArray, count_distinct, distinct, union

from .cells import Cells, Patch, Polygons, Polyhedra, Volume
from .edges import rows_of
from .touched import TouchedCells

FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hexahedron": ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)),
}
"""Corners of the faces of each shape in VTK's order; normals (right-hand rule) point out of the cell. Plane cells have
lines, with the cell on their left."""
FACE_SHAPES = {2: "line", 3: "triangle", 4: "quad"}
"""Shape of a face by its number of corners."""
ROWS = 1 << 18
"""Cells in one block, so that temporaries stay small."""
Keys = NDArray[np.uint64]
Marks = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class BoundaryGaps:
    """Boundary faces near moving nodes that are on no patch, and patch faces that are no boundary.

    Attributes
    ----------
    faces : number of faces of one cell that are on no patch.
    nodes : (K,) nodes of these faces that are on no patch; they move like nodes inside the flow.
    loose : number of patch faces that belong to no cell.
    inner : number of faces of moving patches between two cells.
    """

    faces: int
    nodes: IntArray = field(repr=False)
    loose: int
    inner: int

    @classmethod
    def of(cls, touched: TouchedCells, changed: IntArray, moving: tuple[str, ...]) -> "BoundaryGaps":
        """Compare the faces of touched cells with a node of `changed` (M,) with the faces of all patches."""
        mesh = touched.mesh
        marked = np.zeros(len(mesh.points), dtype=np.bool_)
        marked[changed] = True
        keys = node_keys(len(mesh.points))
        parts = zip(mesh.cells, touched.rows, strict=True)
        known, count = count_distinct(_join([_keys_of(*part, marked, keys) for part in parts]))
        held = {
            patch.name: _join([face_keys(faces, keys)[_with_any(faces, marked)] for faces in patch.faces])
            for patch in mesh.patches
        }
        every = distinct(_join(list(held.values())))
        missed = np.setdiff1d(known[count == 1], every, assume_unique=True)
        loose = sum(int(np.count_nonzero(~_among(own, known))) for own in held.values())
        inner = sum(int(np.count_nonzero(_among(held[name], known[count > 1]))) for name in moving)
        free = np.setdiff1d(changed, mesh.on(*mesh.names), assume_unique=True)
        nodes = _nodes_of(touched, keys, missed) if len(missed) else changed[:0]
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
            own = nodes[sum(among[corner] for corner in nodes.T) >= least]  # much faster than by rows
            for face in FACES[block.shape]:
                corners = own[:, list(face)]
                yield keys[corners[among[corners].all(axis=1)]].sum(axis=1, dtype=np.uint64)


def _among(own: Keys, known: Keys) -> Marks:
    """Return which keys (F,) are among the sorted keys `known` (K,)."""
    place = np.searchsorted(known, own)
    return np.asarray(known[np.minimum(place, len(known) - 1)] == own) if len(known) else np.zeros(len(own), np.bool_)


def _join(parts: list[Keys]) -> Keys:
    return np.concatenate([np.empty(0, np.uint64), *parts])


def _with_any(faces: Cells | Polygons, marked: Marks) -> Marks:
    """Return which faces (F,) have a marked node."""
    if isinstance(faces, Cells):
        return np.asarray(marked[faces.nodes].any(axis=1))
    some = np.logical_or.reduceat(marked[faces.nodes], faces.offsets[:-1]) if len(faces) else np.empty(0, np.bool_)
    return np.asarray(some, dtype=np.bool_)


def _keys_of(block: Volume, rows: IntArray, marked: Marks, keys: Keys) -> Keys:
    """Return the keys of the faces with a marked node, once for each cell that has the face.

    Two faces of polyhedra with equal nodes and one owner each form a baffle, not a face between two cells.
    """
    if isinstance(block, Polyhedra):
        found, own = face_keys(block.faces, keys), _with_any(block.faces, marked)
        inner, outer = np.split(own, [len(block.neighbour)])
        between = found[: len(inner)][inner]
        return np.concatenate([between, between, distinct(found[len(inner) :][outer])])
    return _join([face_keys(faces, keys)[_with_any(faces, marked)] for faces in faces_of(block, rows)])


def faces_of(block: Cells, rows: IntArray) -> Iterator[Cells]:
    """Yield the faces of rows (R,) of cells in parts; their normals point out of the cells."""
    for part in rows_of(len(rows), ROWS):
        nodes = block.nodes[rows[part]]
        for face in FACES[block.shape]:
            yield Cells(FACE_SHAPES[len(face)], nodes[:, list(face)])


def _nodes_of(touched: TouchedCells, keys: Keys, wanted: Keys) -> IntArray:
    """Return the nodes (K,) of touched cells' faces with one of the wanted keys."""
    found = [np.empty(0, dtype=np.intp)]
    for block, rows in zip(touched.mesh.cells, touched.rows, strict=True):
        if isinstance(block, Polyhedra):
            own = np.isin(face_keys(block.faces, keys), wanted)
            found.append(block.faces.nodes[np.repeat(own, np.diff(block.faces.offsets))])
        else:
            found += [faces.nodes[np.isin(face_keys(faces, keys), wanted)].ravel() for faces in faces_of(block, rows)]
    return union(*found)
