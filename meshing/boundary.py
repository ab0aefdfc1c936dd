"""Whether the boundary triangles of a mesh are exactly the closed, manifold skin of its tetrahedra."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sdm_deflect.meshing.mesh import IntArray, TetMesh
from sdm_deflect.meshing.topology import TRIANGLE_EDGES, cell_faces, encode


def boundary_failures(mesh: TetMesh) -> list[str]:
    """One sentence for each way in which the boundary is not a closed manifold around the tetrahedra."""
    failures = []
    faces = cell_faces(mesh.tets)
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
    """How many fans of triangles there are around nodes, on a surface with two triangles at each edge."""
    corner = np.arange(triangles.size).reshape(-1, 3)
    directed = triangles[:, TRIANGLE_EDGES].reshape(-1, 2)
    starts, ends = (corner[:, TRIANGLE_EDGES].reshape(-1, 2)[:, i] for i in range(2))
    here, there = np.argsort(encode(directed)), np.argsort(encode(directed[:, ::-1]))
    # The edge from a to b meets the edge from b to a: its start the other's end, its end the other's start.
    rows = np.concatenate([starts[here], ends[here]])
    columns = np.concatenate([ends[there], starts[there]])
    links = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(corner.size, corner.size))
    return int(connected_components(links, directed=False)[0])
