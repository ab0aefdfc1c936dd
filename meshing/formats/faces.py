"""Which faces cells have, and whether a boundary face is one of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.mesh import Cells, Mesh, Polygons, Polyhedra
from sdm_deflect.meshing.mesh import BoolArray, IntArray

FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "tetra": ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hexahedron": ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)),
}
"""Corners of the faces of each shape in VTK's order; normals (right-hand rule) point out of the cell."""
ROWS = 1 << 18
"""Cells handled at a time, so that temporaries stay small."""

Keys = NDArray[np.uint64]


def node_keys(points: int) -> Keys:
    """Random numbers (N,), always the same: a face's key is the sum of its nodes', whatever node comes first.

    Two different faces share a key with probability 2^-64.
    """
    return np.random.default_rng(20).integers(0, 1 << 64, points, dtype=np.uint64)


def face_keys(faces: Cells | Polygons, keys: Keys) -> Keys:
    """Key (F,) of each face, from the keys (N,) of the nodes; equal for faces of equal nodes."""
    if isinstance(faces, Cells):
        total: Keys = keys[faces.nodes].sum(axis=1, dtype=np.uint64)
        return total
    blocks = (faces.rows(i, i + ROWS) for i in range(0, len(faces), ROWS))
    return np.concatenate([np.empty(0, np.uint64), *(np.add.reduceat(keys[b.nodes], b.offsets[:-1]) for b in blocks)])


def loose_faces(mesh: Mesh) -> dict[str, int]:
    """Count, by patch, the faces that are of no cell (patches without such faces are left out).

    Only cells with three nodes on the boundary are looked at, some at a time: the memory is that of the boundary.
    """
    keys = node_keys(len(mesh.points))
    mine = {patch.name: [face_keys(faces, keys) for faces in patch.faces] for patch in mesh.patches}
    flat = [key for group in mine.values() for key in group]
    missing = np.unique(np.concatenate([np.empty(0, np.uint64), *flat]))
    for found in _cell_face_keys(mesh, keys):
        missing = missing[~np.isin(missing, found)]
        if not len(missing):
            return {}
    counts = {name: sum(int(np.isin(key, missing).sum()) for key in group) for name, group in mine.items()}
    return {name: count for name, count in counts.items() if count}


def _cell_face_keys(mesh: Mesh, keys: Keys) -> Iterator[Keys]:
    on_boundary = np.zeros(len(mesh.points), dtype=np.bool_)
    on_boundary[mesh.on(*(patch.name for patch in mesh.patches))] = True
    for block in mesh.cells:
        if isinstance(block, Polyhedra):
            yield face_keys(block.faces, keys)
            continue
        for start in range(0, len(block), ROWS):
            yield _keys_of_rows(block.shape, block.nodes[start : start + ROWS], keys, on_boundary)


def _keys_of_rows(shape: str, nodes: IntArray, keys: Keys, on_boundary: BoolArray) -> Keys:
    near = nodes[on_boundary[nodes].sum(axis=1) >= 3]
    own = keys[near]
    return np.concatenate([own[:, list(face)].sum(axis=1, dtype=np.uint64) for face in FACES[shape]])
