"""The section of tetrahedra by a plane."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from sdm_deflect.cases.view.pieces import ClipPlane, Solids
from sdm_deflect.deform.mesh.mesh import Cells, Mesh


@pytest.fixture(scope="module")
def cube():
    """The unit cube in tetrahedra."""
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    points = np.vstack([corners, np.random.default_rng(1).random((200, 3))])
    return Mesh(points, (Cells("tetra", Delaunay(points).simplices.astype(np.intp)),), ())


def section(mesh, plane):
    """The polygons in which a plane cuts a mesh, and their cells."""
    count = len(mesh.cells[0])
    rgb = np.column_stack([np.arange(count) // 256, np.arange(count) % 256, np.zeros(count, dtype=np.intp)])
    piece = Solids.of(mesh, [np.arange(count)]).cut(mesh.points, plane, rgb)
    polygons = np.split(piece.points[piece.nodes], np.cumsum(piece.sizes)[:-1]) if len(piece.sizes) else []
    return polygons, piece.rgb @ np.array([256, 1, 0])


def area(corners):
    return 0.5 * np.linalg.norm(np.cross(corners[1:-1] - corners[0], corners[2:] - corners[0]), axis=1).sum()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("position", [0.0, 0.25, 0.7, 1.0])
def test_the_section_of_a_cube_is_its_unit_square(cube, axis, position):
    polygons, _ = section(cube, ClipPlane(axis, position))
    assert all(np.array_equal(corners[:, axis], np.full(len(corners), position)) for corners in polygons)
    total = sum(map(area, polygons))
    assert total == pytest.approx(0.0 if position == 0.0 else 1.0)  # nodes in the plane count as above it


def test_every_polygon_lies_in_its_cell(cube):
    polygons, cells = section(cube, ClipPlane(2, 0.4))
    assert {len(corners) for corners in polygons} == {3, 4}
    assert len(set(cells.tolist())) == len(polygons)
    for corners, cell in zip(polygons, cells, strict=True):
        own = cube.points[cube.cells[0].nodes[cell]]
        assert own[:, 2].min() < 0.4 <= own[:, 2].max()
        barycentric = np.linalg.solve(np.vstack([own.T, np.ones(4)]), np.vstack([corners.T, np.ones(len(corners))]))
        assert barycentric.min() > -1e-9


def test_a_plane_beside_the_mesh_cuts_nothing(cube):
    assert section(cube, ClipPlane(0, 2.0))[0] == []
