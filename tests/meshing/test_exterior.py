import numpy as np
import pytest
from scipy.spatial import ConvexHull

from sdm_deflect.meshing.closest import ClosestTriangle
from sdm_deflect.meshing.exterior import inside_solid, winding_number
from sdm_deflect.meshing.mesh import TetMesh
from sdm_deflect.meshing.naming import boundary_triangles
from sdm_deflect.meshing.surface import Surface
from sdm_deflect.meshing.topology import cell_faces


def sphere(count: int = 300) -> tuple[np.ndarray, np.ndarray]:
    points = np.random.default_rng(0).standard_normal((count, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    hull = ConvexHull(points)
    triangles = hull.simplices.astype(np.intp)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    return points, triangles


def test_the_winding_number_is_one_inside_and_zero_outside() -> None:
    points, triangles = sphere()
    queries = np.array([[0.0, 0, 0], [0.5, 0.5, 0.5], [2.0, 0, 0], [0, 0, -1.5]])
    assert winding_number(queries, points, triangles) == pytest.approx([1, 1, 0, 0], abs=1e-12)


def test_distances_to_triangles_are_exact() -> None:
    points, triangles = sphere()
    queries = 2.0 * np.random.default_rng(1).standard_normal((200, 3))
    distance, index = ClosestTriangle(points, triangles)(queries)
    weights = np.random.default_rng(2).dirichlet((1, 1, 1), 500)
    for query, found, nearest in zip(queries[:10], distance, index, strict=False):
        spots = np.einsum("sk,tkj->tsj", weights, points[triangles])
        away = np.linalg.norm(spots - query, axis=2)
        assert found <= away.min() + 1e-12
        assert away[nearest].min() < found + 0.05


def test_cells_inside_a_closed_surface_are_found(fine_cube: TetMesh) -> None:
    mesh = fine_cube
    centres = mesh.points[mesh.tets].mean(axis=1)
    expected = ((centres > 1 / 3) & (centres < 2 / 3)).all(axis=1)
    faces = cell_faces(mesh.tets)
    skin, outermost = boundary_triangles(faces, expected)
    assert not outermost.any()
    surface = Surface(mesh.points, skin, np.zeros(len(skin), dtype=int), np.empty((0, 3), dtype=int))
    inside = inside_solid(mesh.points, mesh.tets, faces, surface, 1e-9)
    assert np.array_equal(inside, expected)
    assert inside.sum() == 8 * 6
