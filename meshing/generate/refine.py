"""Uniform red refinement: every tetrahedron into eight, new boundary nodes on the exact CAD."""

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.generate.attachment import attach, snapped
from sdm_deflect.meshing.generate.topology import TET_EDGES, TRIANGLE_EDGES, encode
from sdm_deflect.meshing.mesh import Skin, skin, tetrahedral, tets_of

# Nodes 0 ... 3 are the parent's, 4 ... 9 the midpoints of TET_EDGES. Each child keeps the parent's orientation.
CORNER_CHILDREN = np.array([[0, 4, 5, 6], [4, 1, 7, 8], [5, 7, 2, 9], [6, 8, 9, 3]])
DIAGONALS = np.array([[4, 9], [5, 8], [6, 7]])
RINGS = np.array([[5, 6, 8, 7], [4, 7, 9, 6], [4, 5, 9, 8]])
# Nodes 0 ... 2 are the parent's, 3 ... 5 the midpoints of TRIANGLE_EDGES.
TRIANGLE_CHILDREN = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])


def split(mesh: Mesh) -> Mesh:
    """Every tetrahedron into eight and every boundary triangle into four, by the midpoints of all edges.

    The octahedron in the middle is cut along its shortest diagonal (Bey 1995 discusses the choice). The old
    nodes come first and keep their places, so meshes are nested; children of a cell follow each other.
    """
    tets, boundary = tets_of(mesh), skin(mesh)
    codes, middle = np.unique(encode(_ends(tets, TET_EDGES)), return_inverse=True)
    count = len(mesh.points)
    points = np.concatenate([mesh.points, 0.5 * (mesh.points[codes >> 32] + mesh.points[codes & 0xFFFFFFFF])])
    parents = np.concatenate([tets, count + middle.reshape(-1, 6)], axis=1)
    sides = count + np.searchsorted(codes, encode(_ends(boundary.triangles, TRIANGLE_EDGES))).reshape(-1, 3)
    triangles = np.concatenate([boundary.triangles, sides], axis=1)[:, TRIANGLE_CHILDREN]
    finer = Skin(triangles.reshape(-1, 3), np.repeat(boundary.patch, 4), np.repeat(boundary.face, 4))
    return tetrahedral(points, _children(points, parents), finer, mesh.names, mesh.name)


def refined(mesh: Mesh, model: CadModel) -> Mesh:
    """Split a mesh and put its new boundary nodes on the CAD model that it was made from; old nodes stay."""
    finer = split(mesh)
    triangles, _, face = skin(finer)
    attachment = attach(finer.points, triangles[face >= 0], face[face >= 0], model)
    points = snapped(finer.points, attachment, model)
    points[: len(mesh.points)] = mesh.points
    return finer.with_points(points)


def _ends(cells: IntArray, edges: IntArray) -> IntArray:
    """End nodes (K, 2), low first, of all edges of all cells."""
    return np.sort(cells[:, edges].reshape(-1, 2), axis=1)


def _children(points: FloatArray, parents: IntArray) -> IntArray:
    """Eight tetrahedra (8 M, 4) for each parent (M, 10)."""
    ends = points[parents[:, DIAGONALS]]
    lengths = np.einsum("mdk,mdk->md", ends[:, :, 0] - ends[:, :, 1], ends[:, :, 0] - ends[:, :, 1])
    shortest = lengths.argmin(axis=1)
    children = np.empty((len(parents), 8, 4), dtype=np.intp)
    children[:, :4] = parents[:, CORNER_CHILDREN]
    rows = np.arange(len(parents))[:, None]
    diagonal, ring = parents[rows, DIAGONALS[shortest]], parents[rows, RINGS[shortest]]
    children[:, 4:, 0] = diagonal[:, :1]
    children[:, 4:, 1] = diagonal[:, 1:]
    children[:, 4:, 2] = ring
    children[:, 4:, 3] = np.roll(ring, -1, axis=1)
    return children.reshape(-1, 4)
