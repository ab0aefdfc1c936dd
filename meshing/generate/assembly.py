"""From the mesher's tetrahedra, which fill a whole box, to the named flow mesh on the exact CAD."""

from typing import Any, cast

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import VTK_ID_TYPE, reference, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkGenericCell, vtkPolyData, vtkStaticCellLocator

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.child import MeshingError
from sdm_deflect.meshing.mesh.labelled import Skin, tetrahedral
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import signed_volumes

from .attachment import TRIANGLE_EDGES, CellFaces, attach, cell_faces, snap
from .parameters import FAR_FIELD
from .volume import Filling, InputSurface

# The mesher keeps its surface within one envelope of the input; faces within this many may be surface.
MARGIN = 1.5

# What disagreement of normals counts for, beside distance, in units of the triangle's edge.
NORMAL_WEIGHT = 0.5


def inside_solid(
    points: FloatArray, tets: IntArray, faces: CellFaces, surface: InputSurface, envelope: float
) -> BoolArray:
    """Return which tetrahedra (M,) are inside the solid.

    Every face of the surface lies in its envelope, so a region that does not cross the envelope is on one side. The
    winding number in the region's largest cell decides which.
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
    """Return how often a closed surface (T, 3), oriented outward, winds around each query point (Q, 3).

    The solid angle of a triangle follows van Oosterom and Strackee (1983).
    """
    winding = np.empty(len(queries))
    for i, query in enumerate(queries):
        a, b, c = (points[triangles[:, j]] - query for j in range(3))
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        over = _dots(a, np.cross(b, c))
        under = la * lb * lc + _dots(a, b) * lc + _dots(b, c) * la + _dots(c, a) * lb
        winding[i] = np.arctan2(over, under).sum() / (2.0 * np.pi)
    return winding


def _within(points: FloatArray, nodes: IntArray, surface: InputSurface, tolerance: float) -> BoolArray:
    """Return which faces (F, 3) have their nodes, edge midpoints and centre within the tolerance."""
    closest = ClosestTriangle(surface.points, surface.outer)
    low, high = surface.points.min(axis=0) - tolerance, surface.points.max(axis=0) + tolerance
    used = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    near = np.zeros(len(points), dtype=bool)
    near[used] = closest(points[used])[0] <= tolerance
    within: BoolArray = np.all(near[nodes], axis=1, keepdims=False)
    for part in (np.arange(3), *TRIANGLE_EDGES):
        candidates = np.flatnonzero(within)
        middle = points[nodes[candidates][:, part]].mean(axis=1)
        within[candidates] = closest(middle)[0] <= tolerance
    return within


def _dots(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", a, b))


def boundary_triangles(faces: CellFaces, fluid: BoolArray) -> tuple[IntArray, BoolArray]:
    """Return the boundary triangles (B, 3) of the flow, oriented outward, and which (B,) lie on the mesher's box."""
    outermost = faces.second < 0
    first = fluid[faces.first]
    second = fluid[faces.second] & ~outermost
    boundary = first != second
    triangles = faces.nodes[boundary].copy()
    backward = second[boundary]
    triangles[backward] = triangles[backward][:, ::-1]
    return triangles, outermost[boundary]


def cad_faces(points: FloatArray, triangles: IntArray, surface: InputSurface) -> IntArray:
    """Return the CAD face (B,) of each triangle (B, 3), oriented out of the solid; -1 if none is near.

    It is the face of the nearest input triangle; a difference of the normals counts as distance. The normals' sign
    matters: at a thin trailing edge the upper and the lower side are equally near.
    """
    corners = points[triangles]
    centres = corners.mean(axis=1)
    edges = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    normals = unit_normals(points, triangles)
    best, chosen = np.full(len(triangles), np.inf), np.full(len(triangles), -1)
    for face in np.unique(surface.face):
        nearby = surface.outer[surface.face == face]
        extent = surface.points[nearby].reshape(-1, 3)
        above, below = centres + edges[:, None] > extent.min(axis=0), centres - edges[:, None] < extent.max(axis=0)
        near = np.flatnonzero((above & below).all(axis=1))
        distance, index = ClosestTriangle(surface.points, nearby)(centres[near])
        agreement = _dots(unit_normals(surface.points, nearby)[index], normals[near])
        cost = distance + NORMAL_WEIGHT * edges[near] * (1.0 - agreement)
        better = cost < best[near]
        best[near[better]], chosen[near[better]] = cost[better], face
    return chosen


def unit_normals(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the unit normals (T, 3) of triangles (T, 3), right-handed in the order of their nodes."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def assemble(filling: Filling, surface: InputSurface, model: CadModel, envelope: float) -> Mesh:
    """Select the flow, name its boundary, and move that onto the CAD; MeshingError if the two do not match.

    The filling's surface strays by the `envelope` (metres) from the surface mesh.
    """
    faces = cell_faces(filling.tets)
    solid = inside_solid(filling.points, filling.tets, faces, surface, envelope)
    fluid = solid if model.fluid_inside else ~solid
    triangles, outermost = boundary_triangles(faces, fluid)
    if model.fluid_inside and outermost.any():
        raise MeshingError("the flow inside the solid leaks to the outside")
    body = triangles[~outermost]
    out_of_solid = body if model.fluid_inside else body[:, ::-1]
    face = cad_faces(filling.points, out_of_solid, surface)
    if (face < 0).any():
        raise MeshingError(f"{np.count_nonzero(face < 0)} boundary triangles are near no CAD face")
    points = snap(filling.points, attach(filling.points, body, face, model), model)
    return _named_mesh(points, filling.tets[fluid], (body, face), triangles[outermost], model)


def _named_mesh(
    points: FloatArray, tets: IntArray, body: tuple[IntArray, IntArray], far: IntArray, model: CadModel
) -> Mesh:
    """Return the mesh of the used points (N, 3), with patches in the order of CAD faces, the far field (K, 3) last.

    `body` holds the triangles (B, 3) on the CAD and the face (B,) of each.
    """
    names = (*model.patches, *([FAR_FIELD] if len(far) else []))
    patch_of_face = np.array([names.index(face.patch) for face in model.faces])
    triangles, face = body
    used, compact = np.unique(np.concatenate([tets.ravel(), triangles.ravel(), far.ravel()]), return_inverse=True)
    skin = Skin(
        triangles=compact[tets.size :].reshape(-1, 3),
        patch=np.concatenate([patch_of_face[face], np.full(len(far), len(names) - 1)]),
        face=np.concatenate([face, np.full(len(far), -1)]),
    )
    return tetrahedral(points[used], compact[: tets.size].reshape(-1, 4), skin, names)


class ClosestTriangle:
    """Search for the nearest of some triangles (T, 3) on points (N, 3)."""

    def __init__(self, points: FloatArray, triangles: IntArray) -> None:
        used, compact = np.unique(triangles, return_inverse=True)
        nodes = vtkPoints()
        nodes.SetData(numpy_to_vtk(np.ascontiguousarray(points[used]), True))
        offsets = 3 * np.arange(len(triangles) + 1)
        cells = vtkCellArray()
        cells.SetData(numpy_to_vtk(offsets, True, VTK_ID_TYPE), numpy_to_vtk(compact.ravel(), True, VTK_ID_TYPE))
        surface = vtkPolyData()
        surface.SetPoints(nodes)
        surface.SetPolys(cells)
        self._locator = vtkStaticCellLocator()
        self._locator.SetDataSet(surface)
        self._locator.BuildLocator()

    def __call__(self, points: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the distance (P,) in metres and the index (P,) of the triangle nearest to each point (P, 3)."""
        squared, index = np.empty(len(points)), np.empty(len(points), dtype=np.intp)
        cell, spot = vtkGenericCell(), [0.0, 0.0, 0.0]
        triangle, part, away = (cast("Any", reference(zero)) for zero in (0, 0, 0.0))
        for i, point in enumerate(points.tolist()):
            self._locator.FindClosestPoint(point, spot, cell, triangle, part, away)
            squared[i], index[i] = away, triangle
        return np.sqrt(squared), index
