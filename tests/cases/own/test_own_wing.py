"""The whole way, on a hybrid wing: hexahedra, prisms, pyramids, tetrahedra, layers."""

import numpy as np
import pytest
from sdm_deflect.cases.own import Blended, Fitting, OnPatches, Rotation, deflect

from tests.meshing.formats.examples import grid as vtk_grid

WHOLE = ("wing_*", "flap_*")


@pytest.fixture(scope="module")
def turned(hybrid_wing):
    """The whole wing turned by 10 degrees; its root slides on the symmetry plane."""
    w = hybrid_wing
    return deflect(w.mesh, WHOLE, w.hinge, 10.0, slide={"symmetry": "plane"})


@pytest.fixture(scope="module")
def flapped(inboard_wing):
    """The flap blended between its hinge and its trailing edge."""
    w = inboard_wing
    motion = Blended(Rotation.about(*w.hinge), held=OnPatches(("wing_*",)))
    return deflect(w.mesh, ("flap_*",), w.hinge, 10.0, motion=motion, fixed=("wing_*",), slide={"symmetry": "plane"})


def walls(mesh, start):
    return mesh.on(*(patch.name for patch in mesh.patches if patch.name.startswith(start)))


def test_rotation_is_an_isometry_of_the_surface(turned, hybrid_wing):
    nodes = walls(hybrid_wing.mesh, ("wing", "flap"))[::7]
    before, after = hybrid_wing.mesh.points[nodes], turned.points[nodes]

    def distances(p):
        return np.linalg.norm(p[:, None] - p[None], axis=2)

    np.testing.assert_allclose(distances(after), distances(before), atol=1e-14)
    moved = Rotation.about(*hybrid_wing.hinge).axis.rotated(before, 10.0)
    np.testing.assert_allclose(after, moved, atol=1e-14)


@pytest.mark.parametrize("which", ["turned", "flapped"])
def test_no_cell_of_any_type_is_inverted(which, request):
    result = request.getfixturevalue(which)
    whole = vtk_grid(result.mesh)
    assert whole.cell_quality("scaled_jacobian")["scaled_jacobian"].min() > 0.0
    assert whole.compute_cell_sizes()["Volume"].min() > 0.0
    assert result.report.passed


@pytest.mark.parametrize("which", ["turned", "flapped"])
def test_layers_keep_their_first_height_within_a_percent(which, request, hybrid_wing, inboard_wing):
    result = request.getfixturevalue(which)
    w = hybrid_wing if which == "turned" else inboard_wing
    columns = result.points[w.columns]
    heights = np.linalg.norm(columns[:, 1] - columns[:, 0], axis=1)
    np.testing.assert_allclose(heights, w.first_height, rtol=0.01)
    assert result.report.layers.largest < 0.01


@pytest.mark.parametrize("which", ["turned", "flapped"])
def test_nodes_outside_the_box_keep_their_bits(which, request, hybrid_wing, inboard_wing):
    result = request.getfixturevalue(which)
    before = (hybrid_wing if which == "turned" else inboard_wing).mesh.points
    outside = ~result.plan.region.hexahedron.contains(before)
    assert 0 < outside.sum() < len(before)
    assert np.array_equal(result.points[outside], before[outside])


@pytest.mark.parametrize("which", ["turned", "flapped"])
def test_the_symmetry_plane_stays_plane_to_the_last_bit(which, request, hybrid_wing, inboard_wing):
    result = request.getfixturevalue(which)
    mesh = (hybrid_wing if which == "turned" else inboard_wing).mesh
    on = mesh.on("symmetry")
    assert np.array_equal(result.points[on, 1], mesh.points[on, 1])
    assert (result.points[on] != mesh.points[on]).any()


def test_the_fixed_wing_keeps_its_bits_and_the_trailing_edge_turns(flapped, inboard_wing):
    mesh = inboard_wing.mesh
    wing = walls(mesh, "wing")
    assert np.array_equal(flapped.points[wing], mesh.points[wing])
    base = np.setdiff1d(mesh.on("flap_base"), wing)
    corner = base[mesh.points[base, 1] < 1e-9]
    expected = Rotation.about(*inboard_wing.hinge).axis.rotated(mesh.points[corner], 10.0)
    np.testing.assert_allclose(flapped.points[corner], expected, atol=1e-12)


def test_common_centres_do_as_well(inboard_wing, flapped):
    w = inboard_wing
    motion = Blended(Rotation.about(*w.hinge), held=OnPatches(("wing_*",)))
    other = deflect(
        w.mesh, ("flap_*",), w.hinge, 10.0, motion=motion, fixed=("wing_*",), slide={"symmetry": "plane"},
        fitting=Fitting(strategy="mv"),
    )  # fmt: skip
    assert other.report.passed
    tolerance = flapped.plan.sites.tolerance
    assert np.abs(other.points - flapped.points).max() < 30.0 * tolerance


def test_the_interpolants_give_the_points_away_from_the_surfaces(turned, hybrid_wing):
    start = turned.course.last
    away = np.setdiff1d(start.free, start.free[start.nearest.carried.rows])
    (interpolant,) = turned.interpolants
    moved = hybrid_wing.mesh.points[away] + interpolant(hybrid_wing.mesh.points[away])
    np.testing.assert_allclose(turned.points[away], moved, atol=1e-15)
