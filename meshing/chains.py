"""Whether each CAD edge is one clean chain of mesh edges."""

from __future__ import annotations

import numpy as np

from sdm_deflect.geometry.model import CadEdge, CadModel
from sdm_deflect.meshing.attachment import Attachment
from sdm_deflect.meshing.mesh import FloatArray, IntArray
from sdm_deflect.meshing.topology import edges_of, encode


def broken_chains(
    points: FloatArray, triangles: IntArray, face: IntArray, attachment: Attachment, model: CadModel
) -> dict[int, str]:
    """What is wrong with the mesh edges along each CAD edge; clean ones are left out.

    Mesh edges between triangles of two CAD faces belong to the nearest CAD edge between these. They are clean
    if, sorted along the CAD edge, they lead from its first vertex to its last without gap, fold or branch.
    """
    ends, pairs = _feature_edges(triangles, face)
    node_of_vertex = np.full(len(model.vertices), -1)
    on_vertex = attachment.vertex >= 0
    node_of_vertex[attachment.vertex[on_vertex]] = attachment.nodes[on_vertex]
    assigned = _assign(points, ends, pairs, model)
    problems = {}
    for index, cad in enumerate(model.edges):
        problem = _problem(points, ends[assigned == index], cad, node_of_vertex)
        if problem:
            problems[index] = problem
    for pair in sorted(set(map(tuple, pairs[assigned < 0].tolist()))):
        problems[-1 - len(problems)] = f"faces {pair[0]} and {pair[1]} share mesh edges but no CAD edge"
    return problems


def _feature_edges(triangles: IntArray, face: IntArray) -> tuple[IntArray, IntArray]:
    """Mesh edges (E, 2) between different CAD faces, and these faces (E, 2), low first."""
    ends, index = edges_of(triangles)
    low, high = np.full(len(ends), np.iinfo(np.intp).max), np.full(len(ends), -1)
    np.minimum.at(low, index, face[:, None])
    np.maximum.at(high, index, face[:, None])
    feature = low != high
    return ends[feature], np.stack([low, high], axis=1)[feature]


def _assign(points: FloatArray, ends: IntArray, pairs: IntArray, model: CadModel) -> IntArray:
    """The CAD edge (E,) nearest to each feature edge's middle, among those between its faces; -1 for none."""
    middle = points[ends].mean(axis=1)
    codes = encode(pairs)
    assigned, nearest = np.full(len(ends), -1), np.full(len(ends), np.inf)
    for index, cad in enumerate(model.edges):
        rows = np.flatnonzero(codes == (min(cad.faces) << 32 | max(cad.faces)))
        distance = np.linalg.norm(cad.project(middle[rows])[0] - middle[rows], axis=1)
        better = rows[distance < nearest[rows]]
        assigned[better], nearest[better] = index, distance[distance < nearest[rows]]
    return assigned


def _problem(points: FloatArray, ends: IntArray, cad: CadEdge, node_of_vertex: IntArray) -> str:
    if not len(ends):
        return "has no mesh edge"
    nodes = np.unique(ends)
    _, parameter = cad.project(points[nodes])
    chain = nodes[np.argsort(parameter, kind="stable")]
    if (np.diff(np.sort(parameter)) <= 0.0).any():
        return "has nodes that coincide"
    start, end = node_of_vertex[list(cad.vertices)]
    if cad.vertices[0] != cad.vertices[1] and (chain[0] != start or chain[-1] != end):
        return "does not lead from vertex to vertex"
    links = np.stack([chain[:-1], chain[1:]], axis=1)
    if cad.vertices[0] == cad.vertices[1]:
        links = np.concatenate([links, [[chain[-1], chain[0]]]])
    if not np.array_equal(np.sort(encode(np.sort(links, axis=1))), np.sort(encode(ends))):
        return "is not one chain of mesh edges"
    return ""
