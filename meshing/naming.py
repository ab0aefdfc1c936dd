"""The flow's boundary triangles and the CAD face that each of them lies on."""

from __future__ import annotations

import numpy as np

from sdm_deflect.meshing.closest import ClosestTriangle
from sdm_deflect.meshing.mesh import BoolArray, FloatArray, IntArray
from sdm_deflect.meshing.surface import Surface
from sdm_deflect.meshing.topology import CellFaces

# What disagreement of normals counts for, beside distance, in units of the triangle's edge.
NORMAL_WEIGHT = 0.5


def boundary_triangles(faces: CellFaces, fluid: BoolArray) -> tuple[IntArray, BoolArray]:
    """Triangles (B, 3) between flow and anything else, oriented out of the flow.

    Returns
    -------
    The triangles, and which of them (B,) lie on the outside of the mesher's box.
    """
    outermost = faces.second < 0
    first = fluid[faces.first]
    second = fluid[faces.second] & ~outermost
    boundary = first != second
    triangles = faces.nodes[boundary].copy()
    backward = second[boundary]
    triangles[backward] = triangles[backward][:, ::-1]
    return triangles, outermost[boundary]


def cad_faces(points: FloatArray, triangles: IntArray, surface: Surface) -> IntArray:
    """Index (B,) of the CAD face of each triangle (B, 3), oriented out of the solid; -1 where none is near.

    The face of the nearest input triangle, where disagreeing normals count as distance. The normals' sign
    matters: at a thin trailing edge the upper and the lower side are equally near.
    """
    corners = points[triangles]
    centres = corners.mean(axis=1)
    edges = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    normals = unit_normals(points, triangles)
    best, chosen = np.full(len(triangles), np.inf), np.full(len(triangles), -1)
    for face in np.unique(surface.face):
        own = surface.outer[surface.face == face]
        extent = surface.points[own].reshape(-1, 3)
        low, high = (
            centres + edges[:, None] > extent.min(axis=0),
            centres - edges[:, None] < extent.max(axis=0),
        )
        near = np.flatnonzero((low & high).all(axis=1))
        distance, index = ClosestTriangle(surface.points, own)(centres[near])
        agreement = np.einsum("ij,ij->i", unit_normals(surface.points, own)[index], normals[near])
        cost = distance + NORMAL_WEIGHT * edges[near] * (1.0 - agreement)
        better = cost < best[near]
        best[near[better]], chosen[near[better]] = cost[better], face
    return chosen


def unit_normals(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Unit normals (T, 3) of triangles (T, 3), right-handed in the order of their nodes."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))
