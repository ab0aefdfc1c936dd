"""Which CAD vertex, edge or face each boundary node belongs to, and the nodes' places on them."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.meshing.generate.topology import decode, encode

if TYPE_CHECKING:
    from sdm_deflect.geometry.model import CadModel

# Nodes within this distance (metres) beyond the nearest one compete for a CAD vertex, so many at most: on
# needle-shaped faces the mesher pulls the right node up to 4 mm away.
RIVALRY = 5e-3
RIVALS = 24


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
        """Nodes (L,) that touch several faces and belong to no CAD edge or vertex."""
        return self.nodes[(self.vertex < 0) & (self.edge < 0) & (self.face < 0)]


def attach(points: FloatArray, triangles: IntArray, face: IntArray, model: "CadModel") -> Attachment:
    """Attach the nodes of boundary triangles (B, 3) whose CAD faces (B,) are known.

    A node of one face belongs to it, a node of two to the nearest edge between them. A CAD vertex takes the
    node that shares most faces with it; among equals, the nearest.
    """
    incidence = decode(np.unique(encode(np.stack([triangles.ravel(), np.repeat(face, 3)], axis=1))))
    nodes, first, count = np.unique(incidence[:, 0], return_index=True, return_counts=True)
    vertex = _vertices(points, nodes, incidence, model)
    edge = np.where(vertex < 0, _edges(points, nodes, incidence, model), -1)
    single = (count == 1) & (vertex < 0)
    return Attachment(nodes, vertex, edge, np.where(single, incidence[first, 1], -1), incidence)


def _vertices(points: FloatArray, nodes: IntArray, incidence: IntArray, model: "CadModel") -> IntArray:
    """CAD vertex (K,) of nodes (K,) by the faces that they touch, incidence (P, 2); -1 for most."""
    vertex = np.full(len(nodes), -1)
    if not len(model.vertices):
        return vertex
    touched: dict[int, set[int]] = {}
    for node, face in incidence.tolist():
        touched.setdefault(node, set()).add(face)
    distances, candidates = cKDTree(points[nodes]).query(model.vertices, k=min(RIVALS, len(nodes)))
    for index, faces in enumerate(model.vertex_faces):
        rivals = [
            (-len(touched[int(nodes[k])] & faces), distance, k)
            for distance, k in zip(distances[index], candidates[index], strict=True)
            if vertex[k] < 0 and distance < distances[index, 0] + RIVALRY
        ]
        if rivals:
            vertex[min(rivals)[2]] = index
    return vertex


def _edges(points: FloatArray, nodes: IntArray, incidence: IntArray, model: "CadModel") -> IntArray:
    """CAD edge (K,) nearest to each of the nodes (K,) among those between two faces it touches; -1 for none."""
    edge, nearest = np.full(len(nodes), -1), np.full(len(nodes), np.inf)
    on_face = [incidence[incidence[:, 1] == face, 0] for face in range(len(model.faces))]
    for index, cad in enumerate(model.edges):
        shared = np.intersect1d(on_face[cad.faces[0]], on_face[cad.faces[1]], assume_unique=True)
        rows = np.searchsorted(nodes, shared)
        distance = np.linalg.norm(cad.project(points[shared])[0] - points[shared], axis=1)
        better = distance < nearest[rows]
        edge[rows[better]], nearest[rows[better]] = index, distance[better]
    return edge


def snapped(points: FloatArray, attachment: Attachment, model: "CadModel") -> FloatArray:
    """Points (N, 3) with each attached node moved to the nearest point of its CAD vertex, edge or face."""
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
