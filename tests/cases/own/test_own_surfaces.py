"""Several surfaces in one job, each with its own hinge and angle."""

import numpy as np
import pytest
from sdm_deflect.cases.own import Job, Moving, Rotation, deflect_job

from tests.deform.blocks import two_bodies

LEFT = Rotation.about([-1.0, 0, 0], [-1.0, 1, 0])
RIGHT = Rotation.about([1.0, 0, 0], [1.0, 1, 0])


@pytest.fixture(scope="module")
def pair():
    return two_bodies()


@pytest.fixture(scope="module")
def both(pair):
    job = Job((Moving(("left",), LEFT, 12.0), Moving(("right",), RIGHT, -6.0)))
    return {result.report.angle: result for result in deflect_job(pair, job, (12.0, -4.0))}


@pytest.mark.parametrize("angle", [12.0, -4.0])
def test_each_surface_turns_about_its_hinge_in_proportion(both, pair, angle):
    result = both[angle]
    assert result.report.passed
    for name, motion, factor in (("left", LEFT, 1.0), ("right", RIGHT, -0.5)):
        nodes = pair.on(name)
        expected = motion.axis.rotated(pair.points[nodes], factor * angle)
        np.testing.assert_allclose(result.points[nodes], expected, atol=1e-14)


def test_sensitivities_of_several_surfaces(both, pair):
    result, h = both[12.0], 1e-3
    from sdm_deflect.cases.own.course import followed

    ends = [followed(result.plan, 12.0 + d, lambda *_: None, result.course).points for d in (-h, h)]
    np.testing.assert_allclose(result.sensitivity, (ends[1] - ends[0]) / (2.0 * h), atol=1e-8)


def test_the_box_holds_all_surfaces(both, pair):
    box = both[12.0].plan.region.hexahedron
    for result in both.values():
        assert box.contains(result.points[pair.on("left", "right")]).all()
