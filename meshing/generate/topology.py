"""Faces of tetrahedra, edges of triangles, and whether a boundary is closed around its cells."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sdm_deflect.deform.base.arrays import IntArray
from sdm_deflect.meshing.mesh import TetMesh

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


def boundary_failures(mesh: TetMesh) -> list[str]:
    """One sentence for each way in which the boundary is not a closed manifold around the tetrahedra."""
    failures = []
    try:
        faces = cell_faces(mesh.tets)
    except ValueError as error:
        return [str(error)]
    if not np.array_equal(_canonical(faces.nodes[faces.second < 0]), _canonical(mesh.triangles)):
        failures.append("the boundary triangles are not the outer faces of the tetrahedra, oriented outward")
    directed = mesh.triangles[:, TRIANGLE_EDGES].reshape(-1, 2)
    forward, backward = np.sort(encode(directed)), np.sort(encode(directed[:, ::-1]))
    if not np.array_equal(forward, backward) or (forward[1:] == forward[:-1]).any():
        failures.append("the boundary is not closed with two triangles at each edge")
        return failures
    pinched = _fans(mesh.triangles) - len(np.unique(mesh.triangles))
    if pinched:
        failures.append(f"the boundary touches itself at {pinched} nodes")
    return failures


def _canonical(triangles: IntArray) -> IntArray:
    """Triangles (T, 3) rotated to start with their lowest node, in lexicographic order."""
    turn = (np.argmin(triangles, axis=1)[:, None] + np.arange(3)) % 3
    rotated = np.take_along_axis(triangles, turn, axis=1)
    return np.asarray(rotated[np.lexsort(rotated.T[::-1])])


def _fans(triangles: IntArray) -> int:
    """How many fans of triangles (T, 3) there are around nodes, on a surface with two triangles at each edge."""
    corner = np.arange(triangles.size).reshape(-1, 3)
    directed = triangles[:, TRIANGLE_EDGES].reshape(-1, 2)
    starts, ends = (corner[:, TRIANGLE_EDGES].reshape(-1, 2)[:, i] for i in range(2))
    here, there = np.argsort(encode(directed)), np.argsort(encode(directed[:, ::-1]))
    # The edge from a to b meets the edge from b to a: its start the other's end, its end the other's start.
    rows = np.concatenate([starts[here], ends[here]])
    columns = np.concatenate([ends[there], starts[there]])
    links = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(corner.size, corner.size))
    return int(connected_components(links, directed=False)[0])
