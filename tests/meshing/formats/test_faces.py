"""Faces, zones and the order of nodes in cells."""

import numpy as np
import pytest

from sdm_deflect.meshing.formats.shapes import loose_faces, mirror_nodes, orient, turn_faces
from sdm_deflect.meshing.formats.zones import join_zones, part
from sdm_deflect.meshing.mesh.cells import MIRRORED, Cells, Patch, Polygons, take_faces
from sdm_deflect.meshing.mesh.faces import FACES, face_keys, node_keys
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.meshing.formats.alike import content
from tests.meshing.formats.examples import hybrid


def volume(points, cells):
    """Volume of each cell by the divergence theorem, with the faces cut into triangles at their mean."""
    total = np.zeros(len(cells))
    for face in FACES[cells.shape]:
        p = points[cells.nodes[:, list(face)]]
        middle = p.mean(axis=1)
        for i in range(len(face)):
            total += np.einsum("ij,ij->i", middle, np.cross(p[:, i - 1], p[:, i])) / 6.0
    return total


def test_faces_close_every_cell_with_normals_out_of_it():
    mesh = hybrid()
    for block in mesh.cells:
        assert volume(mesh.points, block).min() > 0.1
        np.testing.assert_allclose(volume(mesh.points + 7.0, block), volume(mesh.points, block), rtol=1e-12)


@pytest.mark.parametrize("shape", MIRRORED)
def test_mirroring_twice_is_nothing_and_once_turns_the_volume(shape):
    mesh = hybrid()
    (block,) = (block for block in mesh.cells if block.shape == shape)
    once = Cells(shape, mirror_nodes(shape, block.nodes))
    np.testing.assert_array_equal(mirror_nodes(shape, once.nodes), block.nodes)
    np.testing.assert_allclose(volume(mesh.points, once), -volume(mesh.points, block), rtol=1e-12)
    np.testing.assert_array_equal(orient(mesh.points, once).nodes, block.nodes)
    assert orient(mesh.points, block) is block


def test_a_single_inverted_cell_stays_inverted():
    mesh = hybrid()
    nodes = mesh.cells[2].nodes.copy()
    nodes[0] = nodes[0, [1, 0, 2, 3]]
    np.testing.assert_array_equal(orient(mesh.points, Cells("tetra", nodes)).nodes, nodes)


def test_the_key_of_a_face_is_that_of_its_nodes_in_any_order():
    keys = node_keys(20)
    quad = Cells("quad", np.array([[3, 7, 11, 2], [2, 3, 7, 11], [3, 7, 11, 12]]))
    a, b, c = face_keys(quad, keys)
    assert a == b != c
    polygons = Polygons(np.array([11, 2, 3, 7, 0, 1, 2]), np.array([0, 4, 7]))
    assert face_keys(polygons, keys)[0] == a


def test_faces_of_no_cell_are_counted_by_patch():
    mesh = hybrid()
    assert loose_faces(mesh) == {}
    wrong = Cells("triangle", np.array([[0, 1, 2], [1, 2, 8], [12, 13, 8]]))
    assert loose_faces(Mesh(mesh.points, mesh.cells, (*mesh.patches, Patch("wrong", (wrong,))))) == {"wrong": 2}


def test_zones_apart_and_together_are_the_mesh():
    mesh = hybrid(3)
    parts = [part(mesh, zone) for zone in mesh.zones]
    assert [len(own.points) for own in parts] == [14, 14, 14]
    again = join_zones([zone.name for zone in mesh.zones], parts)
    assert content(again) == content(mesh)
    np.testing.assert_array_equal(again.points, mesh.points)


def test_blocks_across_zones_are_divided_and_torn_cells_refused():
    mesh = hybrid(2)
    tets = np.concatenate([mesh.cells[2].nodes, mesh.cells[6].nodes])
    both = Polygons(np.array([0, 3, 2, 1, 14, 17, 16, 15]), np.array([0, 4, 8]))
    whole = Mesh(mesh.points, (Cells("tetra", tets),), (Patch("floor", (both,)),), mesh.zones)
    second = part(whole, mesh.zones[1])
    np.testing.assert_array_equal(second.cells[0].nodes, mesh.cells[2].nodes)
    np.testing.assert_array_equal(second.patch("floor").nodes, [0, 1, 2, 3])
    torn = Mesh(mesh.points, (Cells("tetra", np.array([[0, 1, 2, 14], [0, 1, 2, 4]])),), (), mesh.zones)
    with pytest.raises(ValueError, match="1 tetra cells join zone block 1 to another zone"):
        part(torn, mesh.zones[0])


def test_polygons_are_selected_and_turned():
    faces = Polygons(np.arange(12), np.array([0, 3, 8, 12]))
    some = take_faces(faces, np.array([2, 0]))
    assert (some.nodes.tolist(), some.offsets.tolist()) == ([8, 9, 10, 11, 0, 1, 2], [0, 4, 7])
    backward = turn_faces(faces, np.array([False, True, False]))
    assert backward.nodes.tolist() == [0, 1, 2, 7, 6, 5, 4, 3, 8, 9, 10, 11]
    assert backward.offsets.tolist() == faces.offsets.tolist()
