"""Donor cells are found in meshes of any grading, and nowhere else."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from sdm_deflect.cases.aircraft.overset import has_donor
from sdm_deflect.meshing.mesh.labelled import Skin, tetrahedral

NOTHING = np.empty(0, dtype=np.intp)


@pytest.fixture(scope="module")
def cells():
    """Tetrahedra between random points, most of them close to one corner of a cube."""
    return Delaunay(np.random.default_rng(5).random((2000, 3)) ** 4)


def mesh_of(points, tets):
    """A mesh without a boundary; cells of a triangulation may be inside out."""
    volume = np.linalg.det(points[tets[:, 1:]] - points[tets[:, :1]])
    tets = np.where(volume[:, None] < 0.0, tets[:, [1, 0, 2, 3]], tets)
    return tetrahedral(points, tets.astype(np.intp), Skin(NOTHING.reshape(0, 3), NOTHING, NOTHING), ())


def test_a_donor_is_found_where_the_triangulation_has_a_cell(cells):
    points = 1.4 * np.random.default_rng(6).random((3000, 3)) ** 3 - 0.1
    expected = cells.find_simplex(points) >= 0
    assert 300 < np.count_nonzero(expected) < 2700
    np.testing.assert_array_equal(has_donor(points, mesh_of(cells.points, cells.simplices)), expected)


def test_no_node_needs_no_donor(cells):
    assert has_donor(np.empty((0, 3)), mesh_of(cells.points, cells.simplices)).shape == (0,)
