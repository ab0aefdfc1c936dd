"""Which of the mesher's tetrahedra are flow: the mesher fills its whole box, bodies included."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sdm_deflect.meshing.closest import ClosestTriangle
from sdm_deflect.meshing.mesh import BoolArray, FloatArray, IntArray
from sdm_deflect.meshing.quality import signed_volumes
from sdm_deflect.meshing.surface import Surface
from sdm_deflect.meshing.topology import TRIANGLE_EDGES, CellFaces

# The mesher keeps its surface within one envelope of the input; faces within this many may be surface.
MARGIN = 1.5


def inside_solid(points: FloatArray, tets: IntArray, faces: CellFaces, surface: Surface, envelope: float) -> BoolArray:
    """True (M,) for tetrahedra inside the solid.

    Every face of the surface lies in its envelope, so regions that connect without crossing the envelope are
    on one side of it: one winding number per region decides, taken in the region's largest cell.
    """
    blocked = _within(points, faces.nodes, surface, MARGIN * envelope)
    through = ~blocked & (faces.second >= 0)
    links = (np.ones(through.sum(), dtype=bool), (faces.first[through], faces.second[through]))
    count, region = connected_components(coo_array(links, shape=(len(tets), len(tets))), directed=False)
    by_volume = np.argsort(signed_volumes(points, tets), kind="stable")
    largest = np.empty(count, dtype=np.intp)
    largest[region[by_volume]] = by_volume
    winding = winding_number(points[tets[largest]].mean(axis=1), surface.points, surface.outer)
    return np.asarray(winding[region] > 0.5)


def winding_number(queries: FloatArray, points: FloatArray, triangles: IntArray) -> FloatArray:
    """How often a closed surface (T, 3), oriented outward, winds around each query point (Q, 3).

    The solid angle of a triangle follows van Oosterom and Strackee (1983).
    """
    winding = np.empty(len(queries))
    for i, query in enumerate(queries):
        a, b, c = (points[triangles[:, j]] - query for j in range(3))
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        over = np.einsum("ij,ij->i", a, np.cross(b, c))
        under = la * lb * lc + _dots(a, b) * lc + _dots(b, c) * la + _dots(c, a) * lb
        winding[i] = np.arctan2(over, under).sum() / (2.0 * np.pi)
    return winding


def _within(points: FloatArray, nodes: IntArray, surface: Surface, tolerance: float) -> BoolArray:
    """True (F,) for faces (F, 3) whose nodes, edge midpoints and centre lie within the tolerance."""
    closest = ClosestTriangle(surface.points, surface.outer)
    used = np.flatnonzero(_in_box(points, surface.points, tolerance))
    near = np.zeros(len(points), dtype=bool)
    near[used] = closest(points[used])[0] <= tolerance
    within: BoolArray = np.all(near[nodes], axis=1, keepdims=False)
    for part in (np.arange(3), *TRIANGLE_EDGES):
        candidates = np.flatnonzero(within)
        middle = points[nodes[candidates][:, part]].mean(axis=1)
        within[candidates] = closest(middle)[0] <= tolerance
    return within


def _in_box(points: FloatArray, around: FloatArray, margin: float) -> BoolArray:
    low, high = around.min(axis=0) - margin, around.max(axis=0) + margin
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def _dots(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", a, b))
