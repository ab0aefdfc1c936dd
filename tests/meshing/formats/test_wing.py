"""The hybrid wing is what it claims to be."""

import numpy as np
import pytest

from tests.meshing.formats.examples import grid
from tests.meshing.formats.wing import FLAP, boundary_faces, wing


@pytest.fixture(scope="module")
def small():
    return wing(cells=3)


def test_no_cell_of_any_shape_is_inverted(small):
    whole = grid(small.mesh)
    assert {block.shape for block in small.mesh.cells} == {"hexahedron", "wedge", "pyramid", "tetra"}
    assert whole.compute_cell_sizes()["Volume"].min() > 0.0
    assert whole.cell_quality("scaled_jacobian")["scaled_jacobian"].min() > 0.0


def test_layers_have_the_first_height(small):
    points = small.mesh.points[small.columns]
    np.testing.assert_allclose(np.linalg.norm(points[:, 1] - points[:, 0], axis=1), small.first_height)
    assert set(small.columns[:, 0]) == set(small.mesh.on(*(n for n in names(small) if n.startswith(("w", "fl")))))


def test_faces_meet_and_enclose_the_flow(small):
    normals = np.zeros(3)
    for shape, rows in boundary_faces(small.mesh.cells).items():
        assert sum(len(f) for p in small.mesh.patches for f in p.faces if f.shape == shape) == len(rows)
        corner = small.mesh.points[rows]
        for k in range(1, corner.shape[1] - 1):
            normals += np.cross(corner[:, k] - corner[:, 0], corner[:, k + 1] - corner[:, 0]).sum(axis=0) / 2.0
    np.testing.assert_allclose(normals, 0.0, atol=1e-12)


def test_flap_is_behind_the_hinge_and_may_reach_the_symmetry_plane(small):
    assert small.mesh.points[small.mesh.on(*FLAP), 0].min() == pytest.approx(small.hinge[0, 0])
    inboard = wing(flap=(0.0, 0.5), cells=3)
    assert len(np.intersect1d(inboard.mesh.on(*FLAP), inboard.mesh.on("symmetry"))) > 3
    assert inboard.mesh.points[inboard.mesh.on("symmetry"), 1].max() == 0.0


def names(made):
    return [patch.name for patch in made.mesh.patches]
