"""Meshes of a cube that the tests of this folder share."""

import itertools

import numpy as np
import pytest

from sdm_deflect.meshing.mesh.labelled import Skin, tetrahedral
from sdm_deflect.meshing.mesh.mesh import Mesh


def grid_mesh(cells: int = 3) -> Mesh:
    """The unit cube of cells^3 boxes of six tetrahedra each, its sides named low (x = 0) and rest."""
    n = cells + 1
    points = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    corner = np.array(list(itertools.product(range(cells), repeat=3))) @ [n * n, n, 1]
    steps = np.array([n * n, n, 1])
    tets = []
    for order in itertools.permutations(range(3)):
        path = np.cumsum([0, *steps[list(order)]])
        odd = np.linalg.det(np.eye(3)[list(order)]) < 0
        tets.append(corner[:, None] + path[[0, 2, 1, 3] if odd else [0, 1, 2, 3]])
    cube = np.vstack(tets).astype(np.intp)
    faces = cube[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outer = faces[first[count == 1]]
    low = (points[outer, 0] == 0.0).all(axis=1)
    return tetrahedral(points, cube, Skin(outer, np.where(low, 0, 1), np.where(low, 0, -1)), ("low", "rest"), "cube")


@pytest.fixture
def cube() -> Mesh:
    return grid_mesh()


@pytest.fixture
def fine_cube() -> Mesh:
    return grid_mesh(6)
