"""Faces, edges and closed boundaries of tetrahedra."""

import numpy as np
import pytest

from sdm_deflect.meshing.generate.attachment import TET_FACES, boundary_failures, cell_faces
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.labelled import changed


def test_outer_faces_of_the_cube_are_its_boundary(cube: Mesh) -> None:
    faces = cell_faces(tets_of(cube))
    outer = faces.nodes[faces.second < 0]
    assert {frozenset(row) for row in outer.tolist()} == {frozenset(row) for row in skin(cube).triangles.tolist()}
    assert 4 * len(tets_of(cube)) == 2 * len(faces.nodes) - len(outer)


def test_both_cells_hold_the_face_that_they_share(cube: Mesh) -> None:
    faces = cell_faces(tets_of(cube))
    shared = faces.second >= 0
    for cells in (faces.first, faces.second):
        held = (faces.nodes[shared][:, :, None] == tets_of(cube)[cells[shared]][:, None]).any(axis=2)
        assert held.all()


def test_faces_point_out_of_their_first_cell(cube: Mesh) -> None:
    faces = cell_faces(tets_of(cube))
    a, b, c = (cube.points[faces.nodes[:, i]] for i in range(3))
    inwards = cube.points[tets_of(cube)[faces.first]].mean(axis=1) - a
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), inwards) < 0.0).all()


def test_a_face_of_three_cells_is_refused() -> None:
    with pytest.raises(ValueError, match="more than two"):
        cell_faces(np.array([[0, 1, 2, 3], [0, 1, 2, 4], [0, 1, 2, 5]]))


def test_tet_faces_exclude_their_own_node() -> None:
    assert [set(range(4)) - set(row) for row in TET_FACES.tolist()] == [{0}, {1}, {2}, {3}]


def test_the_cube_has_the_boundary_of_its_cells(cube: Mesh) -> None:
    assert boundary_failures(cube) == []


def test_a_missing_a_turned_and_an_inner_triangle_are_noticed(cube: Mesh) -> None:
    lacking = changed(cube, triangles=skin(cube).triangles[1:], patch=skin(cube).patch[1:], face=skin(cube).face[1:])
    turned = changed(cube, triangles=np.vstack([skin(cube).triangles[:1, ::-1], skin(cube).triangles[1:]]))
    twice = np.vstack([skin(cube).triangles, skin(cube).triangles[:1], skin(cube).triangles[:1, ::-1]])
    doubled = changed(cube, triangles=twice, patch=np.ones(len(twice), dtype=np.intp), face=np.zeros(len(twice), int))
    for broken in (lacking, turned, doubled):
        assert boundary_failures(broken)


def test_a_cell_less_shows_in_the_boundary(cube: Mesh) -> None:
    assert boundary_failures(changed(cube, tets=tets_of(cube)[1:]))
