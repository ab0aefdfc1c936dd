from dataclasses import replace

import numpy as np

from sdm_deflect.meshing.boundary import boundary_failures
from sdm_deflect.meshing.mesh import TetMesh


def test_the_cube_is_closed(cube: TetMesh) -> None:
    assert boundary_failures(cube) == []


def test_a_missing_a_turned_and_an_inner_triangle_are_noticed(cube: TetMesh) -> None:
    lacking = replace(cube, triangles=cube.triangles[1:], patch=cube.patch[1:], face=cube.face[1:])
    turned = replace(cube, triangles=np.vstack([cube.triangles[:1, ::-1], cube.triangles[1:]]))
    for broken in (lacking, turned):
        assert any("not closed" in failure for failure in boundary_failures(broken))
    twice = np.vstack([cube.triangles, cube.triangles[:1], cube.triangles[:1, ::-1]])
    doubled = replace(cube, triangles=twice, patch=np.ones(len(twice), dtype=np.intp), face=np.zeros(len(twice), int))
    assert boundary_failures(doubled)


def test_a_cell_less_shows_in_the_boundary(cube: TetMesh) -> None:
    assert boundary_failures(replace(cube, tets=cube.tets[1:]))


def test_two_bodies_that_touch_at_a_node_are_pinched() -> None:
    first = np.array([[0, 1, 2, 3]])
    second = np.array([[0, 5, 4, 6]])
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], dtype=float)
    sides = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
    triangles = np.vstack([first[0][sides], second[0][sides]])
    labels = np.ones(8, dtype=np.intp)
    mesh = TetMesh(points, np.vstack([first, second]), triangles, labels, labels, ("volume", "skin"))
    assert boundary_failures(mesh) == ["the boundary touches itself at 1 nodes"]
