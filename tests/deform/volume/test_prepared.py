"""A deflection on fixed centres: the deflection itself at its angle, linear in what moves at every other."""

import numpy as np
import pytest

from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.threads import silent
from sdm_deflect.deform.mesh.axis import Axis
from sdm_deflect.deform.surface.motions import Moving, Rotation, Table
from sdm_deflect.deform.volume.deflection import adapted_steps, deflect_box
from sdm_deflect.deform.volume.job import Job, Sliding
from sdm_deflect.deform.volume.prepared import Centers, PreparedDeflection
from tests.deform.jobs import FLAP, blended, box_plan, job
from tests.limits import limited

BOX = [[0.2, -0.2, -0.5], [1.6, 0.95, 0.5]]
SAME = 1e-10


def centers(step):
    def of(fits):
        return {c: fit.interpolant.centers for fit in fits.adaptations for c in fit.components} if fits else {}

    return Centers(of(step.first), of(step.fits))


def ready_for(one):
    return PreparedDeflection.of(one.plan, one.angle, [centers(step) for step in one.steps])


def prepare(plan, steps=1):
    one = adapted_steps(plan, plan.job.amounts, steps, silent)
    return one, ready_for(one)


def flapped(w, angle, angles=(), **more):
    return box_plan(w.mesh, job(FLAP, w.hinge, angle, **blended(w, **more)), angles)


@pytest.fixture
def sliding(block_on_cylinder):
    """A fin that turns on the cylinder on which the mesh around it slides."""
    turn = Rotation(Axis(np.zeros(3), np.array([0.0, 0.0, 1.0])))
    slides = (Sliding("round", "cylinder"),)
    job = Job((Moving(("body",), turn, 4.0),), fixed=("rest",), slides=slides, force=True)
    return box_plan(block_on_cylinder, job)


@pytest.mark.parametrize("steps", [1, 2])
def test_the_angle_of_the_centres_gives_the_deflection(sliding, steps):
    one, ready = prepare(sliding, steps)
    found = ready.at(4.0)
    assert one.steps[0].first
    assert np.abs(found.points - one.points).max() < SAME
    assert found.error == pytest.approx(one.steps[-1].error, rel=1e-6)
    moving = sliding.sites.moving
    assert np.array_equal(found.points[moving], one.points[moving])


def test_a_step_begins_where_the_one_before_ends(sliding):
    _, ready = prepare(sliding, 2)
    assert [ready.step(angle) for angle in (-1.0, 0.1, 2.0, 2.1, 4.0, 9.0)] == [0, 0, 0, 1, 1, 1]
    assert np.abs(ready.at(2.0).points - ready.at(2.0 + 1e-9).points).max() < 1e-8


def test_the_mesh_is_linear_in_a_table(block):
    nodes = block.patch("body").nodes
    table = Table(block.points[nodes], np.random.default_rng(3).normal(scale=0.02, size=(len(nodes), 3)))
    job = Job((Moving(("body",), table, 1.0),), near_wall=False)
    _, ready = prepare(box_plan(block, job))
    one, half = (ready.at(share).points - block.points for share in (1.0, 0.5))
    assert np.allclose(half, 0.5 * one, atol=1e-14)
    assert ready.at(0.0) == (ready.plan.mesh.points, 0.0)


def test_without_a_matrix_the_sums_are_the_same(sliding, monkeypatch):
    _, ready = prepare(sliding)
    limited(monkeypatch, matrix=0)
    _, summed = prepare(sliding)
    assert summed.steps[0].all[0].kernel is None
    assert np.abs(summed.at(3.0).points - ready.at(3.0).points).max() < SAME


def test_centres_that_are_no_sites_are_refused(sliding):
    one, _ = prepare(sliding)
    good = centers(one.steps[0])
    moved = {c: places + 1e-3 for c, places in good.all.items()}
    doubled = {c: np.vstack([places, places[:1]]) for c, places in good.all.items()}
    for bad in (moved, doubled, {}, {0: np.full((3, 3), np.nan)}):
        with pytest.raises(InputError, match="cent"):
            PreparedDeflection.of(sliding, 4.0, [Centers(good.first, bad)])


@pytest.mark.parametrize("angle", [10.0, 4.0, -7.0])
def test_it_is_deflecting_on_the_same_centres(angle, inboard_wing):
    """Where no centre has to be added, the two are one, also on centres that another angle has found."""
    plan = flapped(inboard_wing, -10.0, (-10.0, 10.0), box=BOX)
    known = deflect_box(plan, (10.0,), earlier=deflect_box(plan, (-10.0,)))
    free, found = deflect_box(plan, (angle,), earlier=known), ready_for(known).at(angle)
    for theirs, first in zip(free.steps[0].fits.adaptations, known.steps[0].fits.adaptations, strict=True):
        assert np.array_equal(theirs.chosen, first.chosen)
    assert np.abs(found.points - free.points).max() < SAME


def test_centres_stay_where_a_deflection_would_add_some(inboard_wing):
    plan = flapped(inboard_wing, 2.0, (2.0, 12.0), box=BOX)
    known = deflect_box(plan, (2.0,))
    found, free = ready_for(known).at(12.0), deflect_box(plan, (12.0,), earlier=known)
    assert found.error > plan.sites.tolerance >= free.steps[0].error
    assert np.array_equal(found.points[plan.sites.moving], free.points[plan.sites.moving])


def test_a_deflection_of_two_steps(inboard_wing):
    """Each step serves its half of the angle; the surface is where it was asked to be in any case."""
    plan = flapped(inboard_wing, 8.0, (-8.0, 10.0))
    known, ready = prepare(plan, 2)
    assert np.abs(ready.at(8.0).points - known.points).max() < SAME
    moving, outside = plan.sites.moving, np.setdiff1d(np.arange(len(plan.mesh.points)), plan.changed)
    for angle in (10.0, 5.0, 4.0, 1.0, -6.0):
        found = ready.at(angle).points
        assert np.array_equal(found[moving], plan.mesh.points[moving] + plan.boundary.displacement((angle,)))
        assert np.array_equal(found[outside], plan.mesh.points[outside])


def test_an_angle_beyond_the_box_is_refused(inboard_wing):
    ready = ready_for(deflect_box(flapped(inboard_wing, 10.0, box=[[0.2, -0.2, -0.12], [1.6, 0.95, 0.12]]), (10.0,)))
    with pytest.raises(InputError, match=r"moving nodes of flap_.* leave the box at 40; enlarge it"):
        ready.at(40.0)
