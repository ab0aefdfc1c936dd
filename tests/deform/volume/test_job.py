"""Jobs of several surfaces: each with its own hinge and angle, in proportion to the first."""

import numpy as np
import pytest

from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.loop import run
from sdm_deflect.deform.surface.motions import Moving, Rotation
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import Job
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
    plan = Plan.of(pair, [pair_job(12.0, -6.0)], (12.0, -4.0))
    return {one.angle: one for one, _ in run(plan, (12.0, -4.0))}


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
    ends = [deflect(result.plan, 12.0 + d, earlier=result).points for d in (-h, h)]
    np.testing.assert_allclose(result.sensitivity(), (ends[1] - ends[0]) / (2.0 * h), atol=1e-8)


def test_the_box_holds_all_surfaces(both, pair):
    box = both[12.0].plan.boxes[0].region.hexahedron
    for result in both.values():
        assert box.contains(result.points[pair.on("left", "right")]).all()


def test_a_first_surface_that_stays_does_not_keep_the_others_from_moving(pair):
    """The others' amounts are no multiples of zero: they are what was asked."""
    result = deflect(Plan.of(pair, [pair_job(0.0, 15.0)]), 0.0)
    left, right = pair.on("left"), pair.on("right")
    assert np.array_equal(result.points[left], pair.points[left])
    np.testing.assert_allclose(result.points[right], RIGHT.axis.rotated(pair.points[right], 15.0), atol=1e-14)
    assert all(check.passed for check in checks_of(result))


def test_a_sweep_of_a_first_surface_that_stays_is_refused(pair):
    job = pair_job(0.0, 15.0)
    assert job.amounts_at(0.0) == (0.0, 15.0)
    with pytest.raises(InputError, match="angle = 0 of left, the first surface: the others cannot be in proportion"):
        job.amounts_at(5.0)
    with pytest.raises(InputError, match="put right first"):
        Plan.of(pair, [job], (0.0, 5.0))


def test_nothing_has_a_sensitivity_to_the_angle_of_a_first_surface_that_stays(pair):
    result = deflect(Plan.of(pair, [pair_job(0.0, 15.0)]), 0.0)
    with pytest.raises(InputError, match="put right first"):
        result.sensitivity()
    still = deflect(Plan.of(pair, [pair_job(0.0, 0.0)]), 0.0)
    points = Surface.of(pair, ("right",)).points
    expected = np.radians(1.0) * np.cross(RIGHT.axis.direction, points - RIGHT.axis.point)
    np.testing.assert_allclose(still.sensitivity()[pair.on("right")], expected, atol=1e-12)


def test_amounts_keep_their_proportion():
    job = pair_job(12.0, -6.0)
    assert job.amounts_at(12.0) == job.amounts == (12.0, -6.0)
    assert job.amounts_at(-4.0) == (-4.0, 2.0)
    assert job.amounts_at(0.0) == (0.0, 0.0)
    assert job.at(3.0).amounts == (3.0, -1.5)
    assert pair_job(0.0, 0.0).amounts_at(7.0) == (7.0, 7.0)


def test_a_job_moves_something():
    with pytest.raises(InputError, match="no surface to move: name one"):
        Job(())
