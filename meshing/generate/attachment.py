"""The CAD vertex, edge or face to which each boundary node belongs, and the nodes' places on them.

Also faces of tetrahedra, edges of triangles, and the check that a boundary is that of its cells.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh

if TYPE_CHECKING:
    from sdm_deflect.geometry.model import CadModel


# Face i is opposite node i; its normal points out of a positively oriented tetrahedron.
TET_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
TET_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])
# Nodes within this distance (metres) beyond the nearest one compete for a CAD vertex, so many at most: on
# needle-shaped faces the mesher pulls the right node up to 4 mm away.
RIVALRY = 5e-3
RIVALS = 24


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
    """Return all distinct faces of tetrahedra (M, 4); ValueError if more than two share one."""
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
    """Return the distinct edges (E, 2), low node first, and the three edges (T, 3) of each triangle (T, 3)."""
    ends = np.sort(triangles[:, TRIANGLE_EDGES].reshape(-1, 2), axis=1)
    codes, index = np.unique(encode(ends), return_inverse=True)
    return decode(codes), index.reshape(-1, 3)


def encode(ends: IntArray) -> IntArray:
    """Return one integer (E,) for each pair (E, 2) of node indices."""
    return np.asarray(ends[:, 0] << 32 | ends[:, 1])


def decode(codes: IntArray) -> IntArray:
    """Return the pairs (E, 2) from the integers (E,) of `encode`."""
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
    """Return triangles (T, 3) that begin with their lowest node, in lexicographic order."""
    turn = (np.argmin(triangles, axis=1)[:, None] + np.arange(3)) % 3
    rotated = np.take_along_axis(triangles, turn, axis=1)
    return np.asarray(rotated[np.lexsort(rotated.T[::-1])])


@dataclass(frozen=True, slots=True, eq=False)
class Attachment:
    """The CAD entity of each boundary node.

    Attributes
    ----------
    nodes : (K,) sorted node indices
    vertex, edge, face : (K,) index of the CAD vertex, else of the CAD edge, else of the CAD face; -1 elsewhere
    incidence : (P, 2) distinct pairs of a node and a CAD face that it touches
    """

    nodes: IntArray
    vertex: IntArray
    edge: IntArray
    face: IntArray
    incidence: IntArray

    @property
    def lost(self) -> IntArray:
        """Return the nodes (L,) that touch several faces and belong to no CAD edge or vertex."""
        return self.nodes[(self.vertex < 0) & (self.edge < 0) & (self.face < 0)]


def attach(points: FloatArray, triangles: IntArray, face: IntArray, model: "CadModel") -> Attachment:
    """Attach the nodes of boundary triangles (B, 3) whose CAD faces (B,) are known.

    A node of one face belongs to this face, a node of two faces to the nearest edge between them. A CAD vertex takes
    the node that shares most faces with it; among equals, the nearest.
    """
    incidence = decode(np.unique(encode(np.stack([triangles.ravel(), np.repeat(face, 3)], axis=1))))
    nodes, first, count = np.unique(incidence[:, 0], return_index=True, return_counts=True)
    vertex = _vertices(points, nodes, incidence, model)
    edge = np.where(vertex < 0, _edges(points, nodes, incidence, model), -1)
    single = (count == 1) & (vertex < 0)
    return Attachment(nodes, vertex, edge, np.where(single, incidence[first, 1], -1), incidence)


def _vertices(points: FloatArray, nodes: IntArray, incidence: IntArray, model: "CadModel") -> IntArray:
    """Return the CAD vertex (K,) of nodes (K,), by the faces that they touch, as incidence (P, 2); -1 for most."""
    vertex = np.full(len(nodes), -1)
    if not len(model.vertices):
        return vertex
    affected: dict[int, set[int]] = {}
    for node, face in incidence.tolist():
        affected.setdefault(node, set()).add(face)
    distances, candidates = cKDTree(points[nodes]).query(model.vertices, k=min(RIVALS, len(nodes)))
    for index, faces in enumerate(model.vertex_faces):
        rivals = [
            (-len(affected[int(nodes[k])] & faces), distance, k)
            for distance, k in zip(distances[index], candidates[index], strict=True)
            if vertex[k] < 0 and distance < distances[index, 0] + RIVALRY
        ]
        if rivals:
            vertex[min(rivals)[2]] = index
    return vertex


def _edges(points: FloatArray, nodes: IntArray, incidence: IntArray, model: "CadModel") -> IntArray:
    """Return the CAD edge (K,) nearest to each node (K,) between two faces that the node touches; -1 without one."""
    edge, nearest = np.full(len(nodes), -1), np.full(len(nodes), np.inf)
    on_face = [incidence[incidence[:, 1] == face, 0] for face in range(len(model.faces))]
    for index, cad in enumerate(model.edges):
        shared = np.intersect1d(on_face[cad.faces[0]], on_face[cad.faces[1]], assume_unique=True)
        rows = np.searchsorted(nodes, shared)
        distance = np.linalg.norm(cad.project(points[shared])[0] - points[shared], axis=1)
        better = distance < nearest[rows]
        edge[rows[better]], nearest[rows[better]] = index, distance[better]
    return edge


def snap(points: FloatArray, attachment: Attachment, model: "CadModel") -> FloatArray:
    """Return points (N, 3) with each attached node at the nearest point of its CAD vertex, edge or face."""
    moved = points.copy()
    on_vertex = attachment.vertex >= 0
    moved[attachment.nodes[on_vertex]] = model.vertices[attachment.vertex[on_vertex]]
    for index in np.unique(attachment.edge[attachment.edge >= 0]):
        nodes = attachment.nodes[attachment.edge == index]
        moved[nodes] = model.edges[index].project(points[nodes])[0]
    for index in np.unique(attachment.face[attachment.face >= 0]):
        nodes = attachment.nodes[attachment.face == index]
        moved[nodes] = model.faces[index].project(points[nodes])
    return moved
