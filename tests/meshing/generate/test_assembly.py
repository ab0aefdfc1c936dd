"""What is flow, its boundary, and the CAD face of each boundary triangle."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from sdm_deflect.meshing.generate.assembly import (
    ClosestTriangle,
    boundary_triangles,
    cad_faces,
    inside_solid,
    unit_normals,
    winding_number,
)
from sdm_deflect.meshing.generate.attachment import cell_faces
from sdm_deflect.meshing.generate.volume import InputSurface
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh


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


def test_cells_inside_a_closed_surface_are_found(fine_cube: Mesh) -> None:
    mesh = fine_cube
    centres = mesh.points[tets_of(mesh)].mean(axis=1)
    expected = ((centres > 1 / 3) & (centres < 2 / 3)).all(axis=1)
    faces = cell_faces(tets_of(mesh))
    skin, outermost = boundary_triangles(faces, expected)
    assert not outermost.any()
    surface = InputSurface(mesh.points, skin, np.zeros(len(skin), dtype=int), np.empty((0, 3), dtype=int))
    inside = inside_solid(mesh.points, tets_of(mesh), faces, surface, 1e-9)
    assert np.array_equal(inside, expected)
    assert inside.sum() == 8 * 6


def wedge(angle: float, cells: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Upper (face 0) and lower (face 1) side of a thin wedge with its sharp edge at x = 1."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, cells + 1), np.linspace(0.0, 1.0, cells + 1), indexing="ij")
    height = np.tan(angle) * (1.0 - x)
    points = np.concatenate([np.stack([x, y, s * height], -1).reshape(-1, 3) for s in (1.0, -1.0)])
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    n = cells + 1
    upper = np.concatenate(
        [np.stack([corner, corner + n, corner + 1], 1), np.stack([corner + 1, corner + n, corner + n + 1], 1)]
    )
    triangles = np.concatenate([upper, upper[:, ::-1] + n * n])
    return points, triangles, np.repeat([0, 1], len(upper))


def test_both_sides_of_a_sharp_edge_are_told_apart_by_their_normals() -> None:
    points, triangles, face = wedge(np.deg2rad(1.0), 5)
    surface = InputSurface(points, triangles, face, np.empty((0, 3), dtype=np.intp))
    other_points, other, expected = wedge(np.deg2rad(1.0), 7)
    wavy = other_points + 2e-3 * np.random.default_rng(0).standard_normal(other_points.shape) * [0, 0, 1]
    assert np.array_equal(cad_faces(wavy, other, surface), expected)


def test_what_is_near_no_face_is_told() -> None:
    points, triangles, face = wedge(0.1, 3)
    surface = InputSurface(points, triangles, face, np.empty((0, 3), dtype=np.intp))
    assert cad_faces(points + 10.0, triangles[:1], surface).tolist() == [-1]


def test_the_flow_s_boundary_is_oriented_out_of_the_flow(fine_cube: Mesh) -> None:
    centres = fine_cube.points[tets_of(fine_cube)].mean(axis=1)
    solid = ((centres > 1 / 3) & (centres < 2 / 3)).all(axis=1)
    triangles, outermost = boundary_triangles(cell_faces(tets_of(fine_cube)), ~solid)
    middles = fine_cube.points[triangles].mean(axis=1) - 0.5
    outward = np.einsum("ij,ij->i", unit_normals(fine_cube.points, triangles), middles) > 0.0
    assert np.array_equal(outward, outermost)
    assert outermost.sum() == len(skin(fine_cube).triangles)
    assert (~outermost).sum() == 6 * 4 * 2
