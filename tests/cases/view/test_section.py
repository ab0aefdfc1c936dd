"""The section of tetrahedra by a plane."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from sdm_deflect.cases.view.section import Plane, Section


@pytest.fixture(scope="module")
def cube():
    """The unit cube in tetrahedra."""
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    points = np.vstack([corners, np.random.default_rng(1).random((200, 3))])
    return points, Delaunay(points).simplices.astype(np.intp)


def area(a, b, c):
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("position", [0.0, 0.25, 0.7, 1.0])
def test_the_section_of_a_cube_is_its_unit_square(cube, axis, position):
    points, tets = cube
    section = Section.of(points, tets, Plane(axis, position))
    count = 3 * len(section.triangles)
    triangles, quads = section.points[:count].reshape(-1, 3, 3), section.points[count:].reshape(-1, 4, 3)
    assert np.allclose(section.points[:, axis], position, atol=1e-15)
    a, b, c, d = quads.transpose(1, 0, 2)
    total = area(*triangles.transpose(1, 0, 2)) + area(a, b, c) + area(a, c, d)
    assert total == pytest.approx(0.0 if position == 0.0 else 1.0)  # nodes in the plane count as above it


def test_every_polygon_lies_in_its_cell(cube):
    points, tets = cube
    section = Section.of(points, tets, Plane(2, 0.4))
    corners = points[tets[section.cells]]
    assert np.all(corners[..., 2].min(axis=1) < 0.4)
    assert np.all(corners[..., 2].max(axis=1) >= 0.4)
    assert len(section.points) == 3 * len(section.triangles) + 4 * len(section.quads)


def test_a_plane_beside_the_mesh_cuts_nothing(cube):
    points, tets = cube
    assert not len(Section.of(points, tets, Plane(0, 2.0)).points)
