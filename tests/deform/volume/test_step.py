"""The whole way, on a hybrid wing: hexahedra, prisms, pyramids, tetrahedra, layers."""

import numpy as np
import pytest

from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.rbf.fitting import Fitting
from sdm_deflect.deform.surface.motions import Rotation
from tests.deform.jobs import FLAP, WING, blended, turn
from tests.meshing.formats.examples import grid as vtk_grid


@pytest.fixture(scope="module")
def rigid(hybrid_wing):
    """The whole wing turned by 10 degrees; its root slides on the symmetry plane."""
    w = hybrid_wing
    return turn(w.mesh, WING, w.hinge, slide={"symmetry": "plane"})


@pytest.fixture(scope="module")
def flapped(inboard_wing):
    """The flap blended between its hinge and its trailing edge, in one step."""
    w = inboard_wing
    return turn(w.mesh, FLAP, w.hinge, **blended(w, fitting=Fitting(max_steps=1)))


@pytest.fixture(params=["rigid", "flapped"])
def case(request, hybrid_wing, inboard_wing):
    """A deflection, and the wing that it is of."""
    return request.getfixturevalue(request.param), hybrid_wing if request.param == "rigid" else inboard_wing


def walls(mesh, start):
    return mesh.on(*(patch.name for patch in mesh.patches if patch.name.startswith(start)))


def test_rotation_is_an_isometry_of_the_surface(rigid, hybrid_wing):
    nodes = walls(hybrid_wing.mesh, ("wing", "flap"))[::7]
    before, after = hybrid_wing.mesh.points[nodes], rigid.points[nodes]

    def distances(p):
        return np.linalg.norm(p[:, None] - p[None], axis=2)

    np.testing.assert_allclose(distances(after), distances(before), atol=1e-14)
    moved = Rotation.about(*hybrid_wing.hinge).axis.rotated(before, 10.0)
    np.testing.assert_allclose(after, moved, atol=1e-14)


def test_no_cell_of_any_type_is_inverted(case):
    result, w = case
    whole = vtk_grid(w.mesh.with_points(result.points))
    assert whole.cell_quality("scaled_jacobian")["scaled_jacobian"].min() > 0.0
    assert whole.compute_cell_sizes()["Volume"].min() > 0.0
    assert all(check.passed for check in checks_of(result))


def test_layers_keep_their_first_height_within_a_percent(case):
    result, w = case
    columns = result.points[w.columns]
    heights = np.linalg.norm(columns[:, 1] - columns[:, 0], axis=1)
    np.testing.assert_allclose(heights, w.first_height, rtol=0.01)
    (check,) = (check for check in checks_of(result) if check.name == "layer_height")
    bends = result.plan.boxes[0].sites.sheared.any()  # in the strips of the flap cells lean against the wall
    assert check.value < (0.06 if bends else 1e-6)
    assert check.over > 100


def test_nodes_outside_the_box_keep_their_bits(case):
    result, w = case
    before = w.mesh.points
    outside = ~result.plan.boxes[0].region.hexahedron.contains(before)
    assert 0 < outside.sum() < len(before)
    assert np.array_equal(result.points[outside].view(np.int64), before[outside].view(np.int64))


def test_the_symmetry_plane_stays_plane_to_the_last_bit(case):
    result, w = case
    on = w.mesh.on("symmetry")
    assert np.array_equal(result.points[on, 1], w.mesh.points[on, 1])
    assert (result.points[on] != w.mesh.points[on]).any()


def test_prescribed_nodes_take_their_places_exactly(case):
    """Moving and fixed nodes are where they were asked to be, whatever the interpolant says there."""
    result, w = case
    plan, (step,) = result.plan, result.boxes[0].steps
    move = step.known[: len(plan.boxes[0].sites.moving)]
    assert np.array_equal(move, plan.boxes[0].boundary.displacement((10.0,)))
    assert np.array_equal(result.points[plan.boxes[0].sites.moving], w.mesh.points[plan.boxes[0].sites.moving] + move)
    assert np.array_equal(result.points[plan.boxes[0].sites.fixed], w.mesh.points[plan.boxes[0].sites.fixed])
    known = plan.boxes[0].sites.known
    assert not step.known[len(move) : len(known) - len(plan.boxes[0].sites.slid)].any()
    off = np.linalg.norm(step.known - step.fits.interpolant(w.mesh.points[known]), axis=1)
    assert step.correction == off.max()
    assert len(np.unique(known)) == len(known)


def test_every_site_is_within_the_tolerance(case):
    result, _ = case
    (step,) = result.boxes[0].steps
    for fits in (step.first, step.fits):
        for group in fits.adaptations:
            assert group.max_error < result.plan.boxes[0].sites.tolerance
    assert step.error == max(step.first.error, step.fits.error)


def test_the_fixed_wing_keeps_its_bits_and_the_trailing_edge_turns(flapped, inboard_wing):
    mesh = inboard_wing.mesh
    wing = walls(mesh, "wing")
    assert np.array_equal(flapped.points[wing], mesh.points[wing])
    base = np.setdiff1d(mesh.on("flap_base"), wing)
    corner = base[mesh.points[base, 1] < 1e-9]
    expected = Rotation.about(*inboard_wing.hinge).axis.rotated(mesh.points[corner], 10.0)
    np.testing.assert_allclose(flapped.points[corner], expected, atol=1e-12)


def test_common_centres_do_as_well(inboard_wing, flapped):
    """Prescribed nodes are the same to the bit; elsewhere two fits within the tolerance differ by less than twice it.

    That bound holds at the sites in each direction; the largest difference found anywhere is 1.4 times the tolerance.
    """
    w, plan = inboard_wing, flapped.plan
    other = turn(w.mesh, FLAP, w.hinge, **blended(w, fitting=Fitting(strategy="mv", max_steps=1)))
    assert all(check.passed for check in checks_of(other))
    assert [fit.components for fit in other.boxes[0].steps[0].fits.adaptations] == [(0, 1, 2)]
    known = np.union1d(plan.boxes[0].sites.moving, plan.boxes[0].sites.fixed)
    assert np.array_equal(other.points[known], flapped.points[known])
    assert np.abs(other.points - flapped.points).max() < 2.0 * plan.boxes[0].sites.tolerance


def test_the_interpolants_give_the_points_away_from_the_surfaces(rigid, hybrid_wing):
    (step,) = rigid.boxes[0].steps
    start, near = step.start, step.start.modifiers[0]
    away = np.setdiff1d(start.free, start.free[near.free.follow.rows])
    moved = hybrid_wing.mesh.points[away] + step.fits.interpolant(hybrid_wing.mesh.points[away])
    np.testing.assert_allclose(rigid.points[away], moved, atol=1e-15)


def test_no_turn_moves_nothing(inboard_wing):
    w = inboard_wing
    result = turn(w.mesh, FLAP, w.hinge, angle=0.0, **blended(w))
    assert np.array_equal(result.points, w.mesh.points)
