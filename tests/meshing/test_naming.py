import numpy as np

from sdm_deflect.meshing.mesh import TetMesh
from sdm_deflect.meshing.naming import boundary_triangles, cad_faces, unit_normals
from sdm_deflect.meshing.surface import Surface
from sdm_deflect.meshing.topology import cell_faces


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
    surface = Surface(points, triangles, face, np.empty((0, 3), dtype=np.intp))
    other_points, other, expected = wedge(np.deg2rad(1.0), 7)
    wavy = other_points + 2e-3 * np.random.default_rng(0).standard_normal(other_points.shape) * [0, 0, 1]
    assert np.array_equal(cad_faces(wavy, other, surface), expected)


def test_what_is_near_no_face_is_told() -> None:
    points, triangles, face = wedge(0.1, 3)
    surface = Surface(points, triangles, face, np.empty((0, 3), dtype=np.intp))
    assert cad_faces(points + 10.0, triangles[:1], surface).tolist() == [-1]


def test_the_flow_s_boundary_is_oriented_out_of_the_flow(fine_cube: TetMesh) -> None:
    centres = fine_cube.points[fine_cube.tets].mean(axis=1)
    solid = ((centres > 1 / 3) & (centres < 2 / 3)).all(axis=1)
    triangles, outermost = boundary_triangles(cell_faces(fine_cube.tets), ~solid)
    middles = fine_cube.points[triangles].mean(axis=1) - 0.5
    outward = np.einsum("ij,ij->i", unit_normals(fine_cube.points, triangles), middles) > 0.0
    assert np.array_equal(outward, outermost)
    assert outermost.sum() == len(fine_cube.triangles)
    assert (~outermost).sum() == 6 * 4 * 2
