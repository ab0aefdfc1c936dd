"""Collapsed hexahedra and quads are the cells and faces that are left of them, however they are turned."""

import numpy as np
import pytest

from sdm_deflect.meshing.formats.conforming_zones import CORNERS, TURNS, true_shapes
from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.meshing.formats.examples import grid

# Corners of a collapsed cube, and the volume that is left of it.
ONE = {
    "wedge": ([0, 0, 2, 3, 4, 4, 6, 7], 1.0 / 2.0),
    "pyramid": ([0, 1, 2, 3, 4, 4, 4, 4], 1.0 / 3.0),
    "tetra": ([0, 1, 2, 2, 4, 4, 4, 4], 1.0 / 6.0),
}


def test_there_are_24_turns_and_none_mirrors():
    assert len(np.unique(TURNS, axis=0)) == 24
    a, b, c = (CORNERS[TURNS[:, k]] - CORNERS[TURNS[:, 0]] for k in (1, 3, 4))
    assert np.all(np.einsum("ij,ij->i", np.cross(a, b), c) == 1)


@pytest.mark.parametrize("shape", ONE)
def test_a_collapsed_cube_keeps_its_volume_however_it_is_turned(shape):
    corners, volume = ONE[shape]
    nodes = np.array(corners)[TURNS]
    (block,) = true_shapes(Cells("hexahedron", nodes))
    assert (block.shape, len(block)) == (shape, 24)
    sizes = grid(Mesh(CORNERS.astype(float), (block,), ())).compute_cell_sizes()["Volume"]
    np.testing.assert_allclose(sizes, volume)
    np.testing.assert_array_equal(np.sort(block.nodes, axis=1)[0], np.unique(corners))


def test_whole_cells_stay_in_order_before_the_others():
    whole, seven = np.arange(8), np.array([0, 0, 2, 3, 4, 5, 6, 7])
    nodes = np.array([whole, ONE["pyramid"][0], seven, whole[::-1], ONE["wedge"][0]])
    found = list(true_shapes(Cells("hexahedron", nodes)))
    assert [block.shape for block in found] == ["hexahedron", "wedge", "pyramid"]
    np.testing.assert_array_equal(found[0].nodes, nodes[[0, 2, 3]])
    same = Cells("hexahedron", nodes[:1])
    assert list(true_shapes(same)) == [same]


@pytest.mark.parametrize("shift", range(4))
def test_a_quad_of_three_places_is_a_triangle_and_of_two_is_none(shift):
    nodes = np.array([[0, 1, 2, 3], [4, 5, 6, 6], [7, 7, 8, 8], [9, 9, 9, 9]])
    quads, triangles = true_shapes(Cells("quad", np.roll(nodes, shift, axis=1)))
    assert len(quads) == len(triangles) == 1
    cycle = triangles.nodes[0].tolist()
    assert cycle in ([4, 5, 6], [5, 6, 4], [6, 4, 5])
