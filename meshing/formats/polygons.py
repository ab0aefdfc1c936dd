"""Faces of any number of corners: selected, reversed, and by shape."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sdm_deflect.deform.mesh import Cells, Patch, Polygons
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.mesh import BoolArray, IntArray


def polygons(nodes: IntArray, sizes: IntArray) -> Polygons:
    """Return the faces with `sizes` (F,) corners each, whose nodes follow one another in `nodes` (K,)."""
    return Polygons(nodes, np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp))


def taken(faces: Polygons, rows: IntArray) -> Polygons:
    """Return the faces `rows` (R,), in that order."""
    return _gathered(faces, rows, np.zeros(len(rows), dtype=np.bool_))


def turned(faces: Polygons, backward: BoolArray) -> Polygons:
    """Return all faces, those marked in `backward` (F,) with their nodes in reverse order."""
    return _gathered(faces, np.arange(len(faces)), backward)


def simple_faces(patch: Patch) -> Iterator[Cells]:
    """Yield the triangles and the quads of a patch.

    Raises
    ------
    MeshFileError
        If a face has more than four corners.
    """
    for faces in patch.faces:
        if isinstance(faces, Cells):
            yield faces
            continue
        sizes = np.diff(faces.offsets)
        more = int(np.count_nonzero(sizes > 4))
        if more:
            raise MeshFileError(f"patch {patch.name}: {more} faces have more than four corners, which the format lacks")
        for shape, corners in (("triangle", 3), ("quad", 4)):
            first = faces.offsets[:-1][sizes == corners]
            if len(first):
                yield Cells(shape, faces.nodes[first[:, None] + np.arange(corners)])


def _gathered(faces: Polygons, rows: IntArray, backward: BoolArray) -> Polygons:
    sizes = np.diff(faces.offsets)[rows]
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp)
    within = np.arange(offsets[-1]) - np.repeat(offsets[:-1], sizes)
    flipped = np.repeat(backward, sizes)
    within[flipped] = (np.repeat(sizes, sizes) - 1 - within)[flipped]
    return Polygons(faces.nodes[np.repeat(faces.offsets[rows], sizes) + within], offsets)
