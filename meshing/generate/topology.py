"""Faces of tetrahedra, edges of triangles, and whether a boundary is that of its cells."""

from dataclasses import dataclass

import numpy as np

from sdm_deflect.deform.base.arrays import IntArray
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh import skin, tets_of

# Face i is opposite node i; its normal points out of a positively oriented tetrahedron.
TET_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
TET_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])


@dataclass(frozen=True, slots=True, eq=False)
class CellFaces:
    """The distinct faces of a set of tetrahedra.

    Attributes
    ----------
    nodes : (F, 3), oriented out of the first cell
    first, second : (F,) cells on either side; `second` is -1 on the outside
    """

    nodes: IntArray
    first: IntArray
    second: IntArray


def cell_faces(tets: IntArray) -> CellFaces:
    """All distinct faces of tetrahedra (M, 4); ValueError where more than two share one."""
    nodes = tets[:, TET_FACES].reshape(-1, 3)
    keys = np.sort(nodes, axis=1)
    order = np.lexsort((keys[:, 2], keys[:, 0] * (tets.max(initial=0) + 1) + keys[:, 1]))
    same = (keys[order[1:]] == keys[order[:-1]]).all(axis=1)
    if (same[1:] & same[:-1]).any():
        raise ValueError("more than two tetrahedra share a face")
    first = np.flatnonzero(np.concatenate([[True], ~same]))
    paired = np.concatenate([same, [False]])[first]
    second = np.full(len(first), -1)
    second[paired] = order[first[paired] + 1] // 4
    return CellFaces(nodes[order[first]], order[first] // 4, second)


def edges_of(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """Distinct edges (E, 2), low node first, and for each triangle (T, 3) the index of its three edges."""
    ends = np.sort(triangles[:, TRIANGLE_EDGES].reshape(-1, 2), axis=1)
    codes, index = np.unique(encode(ends), return_inverse=True)
    return decode(codes), index.reshape(-1, 3)


def encode(ends: IntArray) -> IntArray:
    """One integer (E,) for each pair (E, 2) of node indices."""
    return np.asarray(ends[:, 0] << 32 | ends[:, 1])


def decode(codes: IntArray) -> IntArray:
    """The pairs (E, 2) behind the integers (E,) of `encode`."""
    return np.stack([codes >> 32, codes & 0xFFFFFFFF], axis=1)


def boundary_failures(mesh: Mesh) -> list[str]:
    """Return a sentence if the boundary is not that of the tetrahedra: their outer faces, oriented outward."""
    try:
        faces = cell_faces(tets_of(mesh))
    except ValueError as error:
        return [str(error)]
    if np.array_equal(_canonical(faces.nodes[faces.second < 0]), _canonical(skin(mesh).triangles)):
        return []
    return ["the boundary triangles are not the outer faces of the tetrahedra, oriented outward"]


def _canonical(triangles: IntArray) -> IntArray:
    """Triangles (T, 3) rotated to start with their lowest node, in lexicographic order."""
    turn = (np.argmin(triangles, axis=1)[:, None] + np.arange(3)) % 3
    rotated = np.take_along_axis(triangles, turn, axis=1)
    return np.asarray(rotated[np.lexsort(rotated.T[::-1])])
