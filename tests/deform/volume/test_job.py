"""Jobs of several surfaces: each with its own hinge and angle, in proportion to the first."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.loop import run
from sdm_deflect.deform.mesh_motion import MeshMotion
from sdm_deflect.deform.surface.motions import Moving, Rotation
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import Job, in_proportion
from sdm_deflect.deform.volume.plan import Plan
from tests.deform.blocks import two_bodies

LEFT = Rotation.about([-1.0, 0, 0], [-1.0, 1, 0])
RIGHT = Rotation.about([1.0, 0, 0], [1.0, 1, 0])


def pair_job(left, right):
    return Job((Moving(("left",), LEFT, left), Moving(("right",), RIGHT, right)))


@pytest.fixture(scope="module")
def pair():
    return two_bodies()


@pytest.fixture(scope="module")
def both(pair):
    job = pair_job(12.0, -6.0)
    return {one.angle: one for one, _ in run(Plan.of(pair, [job], in_proportion([job], (12.0, -4.0))))}


@pytest.mark.parametrize("angle", [12.0, -4.0])
def test_each_surface_turns_about_its_hinge_in_proportion(both, pair, angle):
    result = both[angle]
    assert all(check.passed for check in checks_of(result))
    for name, motion, factor in (("left", LEFT, 1.0), ("right", RIGHT, -0.5)):
        nodes = pair.on(name)
        expected = motion.axis.rotated(pair.points[nodes], factor * angle)
        np.testing.assert_allclose(result.points[nodes], expected, atol=1e-14)


def test_sensitivities_of_several_surfaces(both):
    result, h = both[12.0], 1e-3
    for name, speeds in (("left", (h, 0.0)), ("right", (0.0, h))):
        poses = [tuple(np.add(result.amounts, np.multiply(sign, speeds)).tolist()) for sign in (-1.0, 1.0)]
        ends = [deflect(result.plan, pose, earlier=result).points for pose in poses]
        np.testing.assert_allclose(result.sensitivity()[name], (ends[1] - ends[0]) / (2.0 * h), atol=1e-8)


def test_the_box_holds_all_surfaces(both, pair):
    box = both[12.0].plan.boxes[0].region.hexahedron
    for result in both.values():
        assert box.contains(result.points[pair.on("left", "right")]).all()


def test_a_first_surface_that_stays_does_not_keep_the_others_from_moving(pair):
    """The others' amounts are no multiples of zero: they are what was asked."""
    result = deflect(Plan.of(pair, [pair_job(0.0, 15.0)]))
    left, right = pair.on("left"), pair.on("right")
    assert np.array_equal(result.points[left], pair.points[left])
    np.testing.assert_allclose(result.points[right], RIGHT.axis.rotated(pair.points[right], 15.0), atol=1e-14)
    assert all(check.passed for check in checks_of(result))


def test_a_sweep_of_a_first_surface_that_stays_is_refused():
    job = pair_job(0.0, 15.0)
    assert in_proportion([job], (0.0,)) == ((0.0, 15.0),)
    with pytest.raises(InputError, match=r"angle = 0 of left, the first surface: the others .* put right first"):
        in_proportion([job], (0.0, 5.0))


def test_surfaces_at_rest_have_a_sensitivity(pair):
    still = deflect(Plan.of(pair, [pair_job(0.0, 0.0)]))
    points = Surface.of(pair, ("right",)).points
    expected = np.radians(1.0) * np.cross(RIGHT.axis.direction, points - RIGHT.axis.point)
    np.testing.assert_allclose(still.sensitivity()["right"][pair.on("right")], expected, atol=1e-12)


def test_amounts_keep_their_proportion():
    job = pair_job(12.0, -6.0)
    assert in_proportion([job], (12.0, -4.0, 0.0)) == ((12.0, -6.0), (-4.0, 2.0), (0.0, 0.0))
    assert in_proportion([pair_job(0.0, 0.0)], (7.0,)) == ((7.0, 7.0),)
    assert job.at((3.0, 8.0)).amounts == (3.0, 8.0)


def test_the_poses_of_a_box_are_those_at_which_a_surface_ends():
    rows = ((1.0, 0.0), (-2.0, 5.0), (3.0, 1.0), (0.0, -4.0))
    assert pair_job(3.0, 5.0).ends(rows) == ((-2.0, 5.0), (3.0, 1.0), (0.0, -4.0))
    assert pair_job(3.0, 0.0).ends(((3.0, 0.0),)) == ((3.0, 0.0),)


def test_a_job_moves_something():
    with pytest.raises(InputError, match="no surface to move: name one"):
        Job(())


def test_errors_of_two_surfaces_of_a_plan_add_up_to_less_than_the_tolerance(pair):
    job = pair_job(-3.0, 4.0).over([(-3.0, -2.0), (3.0, 4.0)])
    held = MeshMotion.of(Plan.of(pair, [job]))
    for amounts in ((-3.0, 4.0), (-3.0, 1.0), (3.0, -2.0)):
        assert all(check.passed for check in held.check(amounts))
