"""Sensitivities and sweeps: the same centres for other values."""

from dataclasses import replace

import numpy as np
import pytest
from sdm_deflect.cases.own import Blended, Fitting, OnPatches, Rotation, deflect, sweep
from sdm_deflect.cases.own.course import followed, sensitivity
from sdm_deflect.cases.own.step import solve

FLAP_MOVES = ("flap_*",)


def options(w, **more):
    motion = Blended(Rotation.about(*w.hinge), held=OnPatches(("wing_*",)))
    return {"motion": motion, "fixed": ("wing_*",), "slide": {"symmetry": "plane"}, **more}


def report(text, fraction):
    pass


@pytest.fixture(scope="module")
def swept(inboard_wing):
    w = inboard_wing
    box = [[0.2, -0.2, -0.5], [1.6, 0.95, 0.5]]
    return list(sweep(w.mesh, FLAP_MOVES, w.hinge, (-10.0, -5.0, 0.0, 5.0, 10.0), **options(w, box=box)))


@pytest.mark.parametrize("strategy", ["squv", "mv"])
def test_sensitivities_are_central_differences(inboard_wing, strategy):
    w, h = inboard_wing, 1e-3
    result = deflect(w.mesh, FLAP_MOVES, w.hinge, 8.0, **options(w, fitting=Fitting(strategy=strategy)))
    plan = result.plan
    either = [followed(plan, 8.0 + step, report, result.course) for step in (-h, h)]
    for one in either:  # the same centres, so the field is a smooth function of the angle
        assert [len(fit.chosen) for fit in one.solutions[0].fits.adaptations] == [
            len(fit.chosen) for fit in result.course.solutions[0].fits.adaptations
        ]
    difference = (either[1].points - either[0].points) / (2.0 * h)
    np.testing.assert_allclose(result.sensitivity, difference, atol=2e-9)
    assert np.abs(difference).max() > 1e-3


def test_sensitivities_on_a_cylinder(block_on_cylinder):
    mesh, h = block_on_cylinder, 1e-3
    result = deflect(mesh, ("body",), [[0, 0, 0], [0, 0, 1]], 5.0, slide={"round": "cylinder"}, fixed=("rest",))
    either = [followed(result.plan, 5.0 + step, report, result.course) for step in (-h, h)]
    difference = (either[1].points - either[0].points) / (2.0 * h)
    np.testing.assert_allclose(result.sensitivity, difference, atol=1e-8)


def test_sensitivity_of_the_last_of_several_steps(inboard_wing):
    """The end of the last step varies, the steps before it do not."""
    w, h = inboard_wing, 1e-3
    result = deflect(w.mesh, FLAP_MOVES, w.hinge, 8.0, **options(w))
    from sdm_deflect.cases.own.course import _stepped

    course = _stepped(result.plan, 8.0, 2, report, None)
    boundary, last = result.plan.boundary, course.solutions[-1]
    before = boundary.displacement(4.0)
    ends = [solve(course.last, boundary.displacement(8.0 + d) - before, report, last).points for d in (-h, h)]
    np.testing.assert_allclose(sensitivity(result.plan, course), (ends[1] - ends[0]) / (2.0 * h), atol=1e-8)


def test_a_sweep_equals_single_runs_within_the_tolerance(swept, inboard_wing):
    w = inboard_wing
    box = [[0.2, -0.2, -0.5], [1.6, 0.95, 0.5]]
    by_angle = {result.report.angle: result for result in swept}
    assert sorted(by_angle) == [-10.0, -5.0, 0.0, 5.0, 10.0]
    tolerance = swept[0].plan.sites.tolerance
    for angle in (-5.0, 10.0):
        single = deflect(w.mesh, FLAP_MOVES, w.hinge, angle, **options(w, box=box))
        nodes = w.mesh.on("flap_upper", "flap_lower", "symmetry")
        np.testing.assert_allclose(by_angle[angle].points[nodes], single.points[nodes], atol=10.0 * tolerance)
        assert np.abs(by_angle[angle].points - single.points).max() < 30.0 * tolerance


def test_every_angle_of_a_sweep_is_verified_at_all_sites(swept):
    for result in swept:
        assert result.report.passed
        checks = {check.name: check for check in result.report.checks}
        assert checks["site_error"].value <= result.plan.sites.tolerance
    zero = next(result for result in swept if result.report.angle == 0.0)
    assert np.array_equal(zero.points, zero.plan.subject.points)


def test_centres_are_added_where_a_site_exceeds_the_tolerance(inboard_wing):
    w = inboard_wing
    result = deflect(w.mesh, FLAP_MOVES, w.hinge, 2.0, **options(w, box=[[0.2, -0.2, -0.5], [1.6, 0.95, 0.5]]))
    plan = replace(result.plan, angles=(12.0,))
    more = followed(plan, 12.0, report, result.course)
    old, new = (c.solutions[0].fits for c in (result.course, more))
    assert sum(len(f.chosen) for f in new.adaptations) > sum(len(f.chosen) for f in old.adaptations)
    for before, after in zip(old.adaptations, new.adaptations, strict=True):
        assert np.array_equal(after.chosen[: len(before.chosen)], before.chosen)
    assert new.error <= plan.sites.tolerance
