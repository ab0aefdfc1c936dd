"""Blocks of tetrahedra made by hand, and what a repair needs to know of them."""

from itertools import permutations

import numpy as np

from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.repair.freedom import FreeNodes
from tests.deform.blocks import grid

NONE = np.empty(0, dtype=np.intp)
CORNER = {
    (0, 0, 0): 0,
    (1, 0, 0): 1,
    (1, 1, 0): 2,
    (0, 1, 0): 3,
    (0, 0, 1): 4,
    (1, 0, 1): 5,
    (1, 1, 1): 6,
    (0, 1, 1): 7,
}


def lattice(high=(1.0, 1.0, 1.0), counts=(6, 6, 6)):
    """A box from the origin, each of its cubes cut into six tetrahedra; its surface is the patch ``wall``."""
    points, cubes = grid([0.0, 0.0, 0.0], list(high), list(counts))
    tets = []
    for order in permutations(range(3)):
        path = np.vstack([np.zeros((1, 3), int), np.cumsum(np.eye(3, dtype=int)[list(order)], axis=0)])
        tets.append(cubes[:, [CORNER[tuple(step)] for step in path]])
    tets = np.concatenate(tets)
    a, b, c, d = (points[tets[:, k]] for k in range(4))
    left = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0.0
    tets[left] = tets[left][:, [0, 2, 1, 3]]
    faces = np.concatenate([tets[:, list(face)] for face in ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1))])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    wall = Patch("wall", (Cells("triangle", faces[first[count == 1]]),))
    return Mesh(points, (Cells("tetra", tets),), (wall,))


def inner(mesh):
    """The nodes that are not on the surface."""
    return np.setdiff1d(np.arange(len(mesh.points)), mesh.on("wall"))


def all_of(mesh, free=None):
    """All cells of a mesh, and the freedom of its inner nodes."""
    nodes = inner(mesh) if free is None else free
    return AffectedCells.of(mesh, np.arange(len(mesh.points))), FreeNodes(nodes, ())
