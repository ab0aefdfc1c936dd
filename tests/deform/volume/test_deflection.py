"""One angle, several, sensitivities: the same centres for other values; steps where one inverts cells."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import silent
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.loop import run
from sdm_deflect.deform.rbf.data_sites import CoincidentSitesError
from sdm_deflect.deform.rbf.fitting import Fitting
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.deform.volume import deflection
from sdm_deflect.deform.volume.deflection import Deflection, deflect
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.deform.volume.step import take
from sdm_deflect.meshing.mesh.affected import Least
from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import block_with_body, two_bodies
from tests.deform.jobs import FLAP, blended, box_plan, job, sensitivity, turn

BOX = [[0.2, -0.2, -0.5], [1.6, 0.95, 0.5]]
ANGLES = (-10.0, -5.0, 0.0, 5.0, 10.0)


def flapped(w, angle, angles=(), **more):
    return Plan.of(w.mesh, [job(FLAP, w.hinge, angle, **blended(w, **more))], [(own,) for own in angles])


def central(ends, h):
    return (ends[1] - ends[0]) / (2.0 * h)


@pytest.fixture(scope="module")
def swept(inboard_wing):
    """By angle; in the order of computing."""
    plan = flapped(inboard_wing, -10.0, ANGLES, box=BOX)
    return {one.angle: one for one, _ in run(plan)}


@pytest.mark.parametrize("strategy", ["squv", "mv"])
def test_sensitivities_are_central_differences(inboard_wing, strategy):
    h = 1e-3
    plan = flapped(inboard_wing, 8.0, fitting=Fitting(strategy=strategy))
    result = deflect(plan, (8.0,))
    either = [deflect(plan, (8.0 + step,), earlier=result) for step in (-h, h)]
    for one in either:  # the same centres, so the field is a smooth function of the angle
        assert [len(fit.chosen) for fit in one.boxes[0].steps[0].fits.adaptations] == [
            len(fit.chosen) for fit in result.boxes[0].steps[0].fits.adaptations
        ]
    difference = central([one.points for one in either], h)
    np.testing.assert_allclose(sensitivity(result), difference, atol=2e-9)
    assert np.abs(difference).max() > 1e-3


def test_sensitivities_on_a_cylinder(block_on_cylinder):
    h, hinge = 1e-3, [[0, 0, 0], [0, 0, 1]]
    result = turn(block_on_cylinder, hinge=hinge, angle=5.0, slide={"round": "cylinder"}, fixed=("rest",))
    ends = [deflect(result.plan, (5.0 + step,), earlier=result).points for step in (-h, h)]
    np.testing.assert_allclose(sensitivity(result), central(ends, h), atol=1e-8)


def test_sensitivity_of_the_last_of_several_steps(inboard_wing):
    """The end of the last step varies, the steps before it do not."""
    h, plan = 1e-3, flapped(inboard_wing, 8.0)
    (box,) = plan.boxes
    course = deflection.deflect_in_steps(box, (8.0,), 2, silent)
    boundary, last = box.boundary, course.steps[-1]
    assert len(course.steps) == 2
    before = boundary.displacement((4.0,))
    ends = [take(last.start, boundary.displacement((8.0 + d,)) - before, last).points for d in (-h, h)]
    rate = sensitivity(Deflection(plan, (course,)))
    np.testing.assert_allclose(rate, central(ends, h), atol=1e-8)


def test_a_sweep_equals_single_runs_within_the_tolerance(swept, inboard_wing):
    """Prescribed nodes are the same to the bit.

    Two interpolants that each keep every site within the tolerance differ there by at most twice that in each
    direction; they were never found to differ by more between the sites either (1.6 times it).
    """
    mesh = inboard_wing.mesh
    assert tuple(sorted(swept)) == ANGLES
    for angle in (-5.0, 5.0, 10.0):
        plan = flapped(inboard_wing, angle, box=BOX)
        single, one = deflect(plan), swept[angle]
        nodes = plan.walls
        assert len(nodes) > len(mesh.on("flap_upper", "flap_lower"))
        assert np.array_equal(one.points[nodes], single.points[nodes])
        on_plane = mesh.on("symmetry")
        assert np.array_equal(one.points[on_plane, 1], single.points[on_plane, 1])
        assert np.abs(one.points - single.points).max() < 2.0 * plan.boxes[0].sites.tolerance


def test_every_angle_of_a_sweep_is_verified_at_all_sites(swept):
    for result in swept.values():
        checks = {check.name: check for check in checks_of(result)}
        assert all(check.passed for check in checks.values())
        assert checks["site_error"].value <= result.plan.boxes[0].sites.tolerance
    assert np.array_equal(swept[0.0].points, swept[0.0].plan.mesh.points)


def test_a_sweep_starts_with_the_largest_angle(swept):
    assert next(iter(swept)) == -10.0
    plan = swept[0.0].plan
    found = list(run(replace(plan, poses=((2.0,), (-6.0,), (4.0,)))))
    assert [one.angle for one, _ in found] == [-6.0, 2.0, 4.0]


def test_a_sweep_adds_centres_to_those_of_the_largest_angle(swept):
    first = swept[-10.0].boxes[0].steps[0].fits
    for angle in (-5.0, 5.0):
        fits = swept[angle].boxes[0].steps[0].fits
        for before, after in zip(first.adaptations, fits.adaptations, strict=True):
            assert np.array_equal(after.chosen[: len(before.chosen)], before.chosen)


def test_centres_are_added_where_a_site_exceeds_the_tolerance(inboard_wing):
    plan = flapped(inboard_wing, 2.0, (2.0, 12.0), box=BOX)
    first = deflect(plan, (2.0,))
    more = deflect(plan, (12.0,), earlier=first)
    old, new = (one.boxes[0].steps[0].fits for one in (first, more))
    assert sum(len(f.chosen) for f in new.adaptations) > sum(len(f.chosen) for f in old.adaptations)
    for before, after in zip(old.adaptations, new.adaptations, strict=True):
        assert np.array_equal(after.chosen[: len(before.chosen)], before.chosen)
    assert new.error <= plan.boxes[0].sites.tolerance


@pytest.fixture
def counted(monkeypatch):
    """Let inverted cells depend on the number of steps alone: {steps: count}; record the numbers that are tried."""

    def count(mesh, inverted, max_steps=8):
        plan = box_plan(mesh, job(("body",), fitting=Fitting(max_steps=max_steps)))
        tried, stepped = [], deflection.deflect_in_steps

        def known(plan, amounts, count, progress, earlier=None):
            tried.append(count)
            found = stepped(plan, amounts, count, progress, earlier)
            found.__dict__["inverted"] = inverted[count]  # the cached value
            return found

        monkeypatch.setattr(deflection, "deflect_in_steps", known)
        return deflection.deflect_box(plan, plan.job.amounts), tried

    return count


def test_steps_are_halved_until_no_further_cell_is_inverted(block, counted):
    found, tried = counted(block, {1: 9, 2: 3, 4: 0, 8: 5})
    assert (tried, len(found.steps), found.inverted) == ([1, 2, 4], 4, 0)


def test_the_best_attempt_is_kept_if_none_succeeds(block, counted):
    found, tried = counted(block, {1: 9, 2: 3, 4: 5, 8: 7})
    assert (tried, len(found.steps), found.inverted) == ([1, 2, 4, 8], 2, 3)


@pytest.mark.parametrize(("before", "after", "steps"), [
    (0.5, {1: 0.2, 2: 0.3}, 2),  # more than half is lost: two steps are better
    (0.5, {1: 0.2, 2: 0.15}, 1),  # and here they are not
    (0.15, {1: 0.09, 2: 0.12}, 2),  # newly below .1
    (0.5, {1: 0.26, 2: 0.5}, 1),  # less than half is lost: two steps are not tried
    (0.08, {1: 0.01, 2: 0.08}, 1),  # poor before
])  # fmt: skip
def test_two_steps_are_tried_where_one_leaves_cells_poor(block, monkeypatch, before, after, steps):
    plan, stepped = box_plan(block, job(("body",))), deflection.deflect_in_steps
    tried = []

    def known(plan, amounts, count, *rest):
        tried.append(count)
        return stepped(plan, amounts, count, *rest)

    def least(affected, points, quality):
        return ((Least(before, 1), Least(after[tried[-1]], 1)),)

    monkeypatch.setattr(deflection, "deflect_in_steps", known)
    monkeypatch.setattr(deflection, "least_of", least)
    quality = {}
    monkeypatch.setattr(deflection, "_worst_share", lambda one, own=deflection._worst_share: quality.setdefault(
        len(one.steps), own(one)
    ))  # fmt: skip
    found = deflection.deflect_box(plan, (5.0,))
    assert len(found.steps) == steps
    assert tried == ([1] if before < 0.1 or after[1] == 0.26 else [1, 2])


def test_an_angle_after_two_steps_starts_from_the_centres_of_the_first(inboard_wing):
    plan = flapped(inboard_wing, 8.0, box=BOX)
    (box,) = plan.boxes
    twice = deflection.deflect_in_steps(box, (8.0,), 2, silent)
    found = deflection.deflect_box(box, (5.0,), silent, twice)
    old, new = (one.steps[0].fits.adaptations for one in (twice, found))
    for first, after in zip(old, new, strict=True):
        assert np.array_equal(after.chosen[: len(first.chosen)], first.chosen)


def test_a_number_of_steps_at_which_a_node_meets_another_is_passed_over():
    """After half of the way a node of the body is where the far side's is; the end is beyond it, and judged there."""
    mesh = block_with_body(8)
    moving, other = mesh.on("body"), mesh.on("z+")
    rise = 2.0 * (mesh.points[other, 2].min() - mesh.points[moving, 2].max())
    table = Table(mesh.points[moving], np.tile([0.0, 0.0, rise], (len(moving), 1)))
    box = [[-1.9, -1.9, -1.9], [1.9, 1.9, 2.0 + 2.0 * rise]]
    given = {"motion": table, "angle": 1.0, "box": box, "fixed": ("z+",), "fitting": Fitting(max_steps=4)}
    plan = box_plan(mesh, job(("body",), **given))
    with pytest.raises(CoincidentSitesError, match="data sites coincide"):
        deflection.deflect_in_steps(plan, (1.0,), 2, silent)
    found = deflection.deflect_box(plan, (1.0,))
    assert found.inverted
    assert len(found.steps) != 2


def test_of_equal_attempts_the_one_of_fewer_steps_is_kept(block, counted):
    found, _ = counted(block, {1: 4, 2: 4}, max_steps=2)
    assert (len(found.steps), found.inverted) == (1, 4)


def test_steps_end_where_one_step_does_and_at_the_places_asked_for(block):
    """The moving nodes are set, not added up: no rounding of steps is left in them."""
    plan = box_plan(block, job(("body",)))
    one, four = (deflection.deflect_in_steps(plan, (10.0,), count, silent) for count in (1, 4))
    moving = plan.sites.moving
    assert np.array_equal(one.points[moving], four.points[moving])
    assert np.array_equal(four.points[moving], block.points[moving] + plan.boundary.displacement((10.0,)))


def sides(width=0.9, angles=(10.0, 10.0)):
    return [
        job((name,), [[x, 0, 0], [x, 1, 0]], angle, box=[[x - width, -1.4, -1.5], [x + width, 1.4, 1.5]])
        for name, x, angle in (("left", -1.25, angles[0]), ("right", 1.25, angles[1]))
    ]


def test_several_boxes_of_one_mesh_give_what_each_gives_alone():
    mesh, jobs = two_bodies(), sides(angles=(10.0, -4.0))
    plan = Plan.of(mesh, jobs, ((5.0, -2.0), (10.0, -4.0)))
    found = [one for one, _ in run(plan)]
    for i, angles in enumerate(((10.0, -4.0), (5.0, -2.0))):
        both, rest = found[i], np.ones(len(mesh.points), dtype=bool)
        for k, (own, angle) in enumerate(zip(jobs, angles, strict=True)):
            alone = Plan.of(mesh, [own], [((5.0,), (10.0,)), ((-2.0,), (-4.0,))][k])
            one = [one for one, _ in run(alone)][i]
            assert one.angle == angle
            assert np.array_equal(both.points[alone.movable], one.points[alone.movable])
            assert np.array_equal(both.boxes[k].points, one.points)
            rest[alone.movable] = False
        assert np.array_equal(both.points[rest], mesh.points[rest])
        assert both.amounts == angles
        assert not both.inverted
    assert plan.affected.count == sum(part.affected.count for part in plan.boxes)
    checks = {check.name: check for check in checks_of(found[0])}
    assert {"site_error:left", "site_error:right", "outside_moved", "quality_min:hexahedron"} < checks.keys()
    assert all(check.passed for check in checks.values())


def test_each_surface_has_a_sensitivity_of_its_own_in_several_boxes():
    mesh = two_bodies()
    ((both, _),) = run(Plan.of(mesh, sides(angles=(10.0, -5.0))))
    one, other = (deflect(Plan.of(mesh, [own]), (own.angle,)) for own in sides(angles=(10.0, -5.0)))
    rates = both.sensitivity()
    assert list(rates) == ["left", "right"]
    assert np.array_equal(rates["left"], sensitivity(one))
    assert np.array_equal(rates["right"], sensitivity(other))


def test_boxes_that_overlap_are_refused():
    with pytest.raises(InputError, match=r"the boxes of left and right overlap by 0\.1; make them smaller"):
        Plan.of(two_bodies(), sides(1.3))


def test_the_mesh_given_is_never_touched(block):
    before = block.points.copy()
    turn(block)
    assert np.array_equal(block.points, before)


def test_a_mesh_numbered_left_handed_gives_the_same_points(block):
    (cells,) = block.cells
    mirrored = Mesh(block.points, (Cells("hexahedron", cells.nodes[:, [4, 5, 6, 7, 0, 1, 2, 3]]),), block.patches)
    result = turn(mirrored)
    assert result.plan.affected.orientation == (-1.0,)
    assert all(check.passed for check in checks_of(result))
    assert np.array_equal(result.points, turn(block).points)
