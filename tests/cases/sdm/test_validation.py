"""The validations fail when they should."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.validation import plane_deviation, validate
from sdm_deflect.deform.checks import Check
from sdm_deflect.deform.volume.deflection import deflected
from tests.cases.sdm.deflected_cad import built

pytestmark = pytest.mark.mesher


def checked(run, points, case=None):
    """The checks of these points by name."""
    case = case or run.case
    plan = plan_of(case, run.mesh)
    checks = validate(case, run.mesh, run.mesh.with_points(points), plan, built(case))
    return {check.name: check for check in checks}


def failing(run, points, case=None):
    """Names of the checks that fail on these points."""
    return {name for name, check in checked(run, points, case).items() if not check.passed}


def test_the_right_mesh_passes(tail_run):
    run, _ = tail_run
    assert failing(run, run.deflected.points) == set()


def test_a_wrong_angle_is_noticed(aileron_run, tail_run):
    run, _ = aileron_run
    assert {"surface_to_cad", "trailing_edge_angle"} <= failing(
        run, run.deflected.points, replace(run.case, angle=-12.001)
    )
    run, _ = tail_run
    assert {"surface_to_cad", "root_on_cylinder"} <= failing(run, run.deflected.points, replace(run.case, angle=12.001))


def test_a_blended_aileron_is_as_far_from_the_rigid_cad_as_its_hinge_stays_behind(aileron_run):
    run, _ = aileron_run
    check = checked(run, run.deflected.points)["surface_to_rigid_cad"]
    assert check.passed
    assert check.value == pytest.approx(2.76e-4, rel=0.02)
    assert 0.9 * check.limit < check.value
    moved = run.mesh.points[check.nodes] != run.deflected.points[check.nodes]
    trailing = run.mesh.points[check.nodes, 0] > run.case.fighter.wing.x_te - 1e-6
    assert moved[trailing].any()
    assert check.distances[trailing].max() < 1e-15


@pytest.mark.parametrize("angle", [-11.0, -13.0, 12.0])
def test_an_aileron_turned_by_another_angle_is_far_from_the_rigid_cad(aileron_run, angle):
    run, _ = aileron_run
    assert "surface_to_rigid_cad" in failing(run, run.deflected.points, replace(run.case, angle=angle))


def test_a_tail_is_rigid_cad_but_for_its_root(tail_run):
    run, _ = tail_run
    checks = checked(run, run.deflected.points)
    rigid, cad = checks["surface_to_rigid_cad"], checks["surface_to_cad"]
    assert (rigid.value, rigid.limit) == (cad.value, run.case.limits.surface_to_cad)
    wrong = checked(run, run.deflected.points, replace(run.case, angle=12.001))
    assert not wrong["surface_to_rigid_cad"].passed
    assert not wrong["surface_to_cad"].passed


def test_a_bulged_panel_is_noticed(tail_run):
    run, _ = tail_run
    points = run.deflected.points.copy()
    panel = np.setdiff1d(run.mesh.on("fuselage_panel_left"), run.mesh.on("fuselage", "fuselage_rear", "tail_left"))
    panel = np.intersect1d(panel, run.deflection.boxes[0].plan.region.inside)
    points[panel, 1:] *= 1.0 + 1e-9
    assert failing(run, points) == {"cylindricity"}


def test_a_bent_tail_is_noticed(tail_run):
    run, _ = tail_run
    points = run.deflected.points.copy()
    tail = np.setdiff1d(run.mesh.on("tail_left"), run.mesh.on("fuselage_panel_left"))
    span = np.abs(points[tail, 1]) - 0.066
    points[tail, 2] += 1e-5 * (span / 0.1) ** 2
    assert {"planarity", "surface_to_cad"} <= failing(run, points)


def test_one_moved_border_node_is_noticed(tail_run):
    run, _ = tail_run
    points = run.deflected.points.copy()
    border = np.intersect1d(run.mesh.on("fuselage_panel_left"), run.mesh.on("fuselage_rear"))
    points[border[0], 0] += 1e-12
    assert "fixed_surfaces_moved" in failing(run, points)


def test_one_node_moved_outside_is_noticed(aileron_run):
    run, _ = aileron_run
    points = run.deflected.points.copy()
    inner = np.setdiff1d(np.arange(len(points)), run.deflection.boxes[0].plan.region.inside)
    inner = np.setdiff1d(inner, run.mesh.on(*run.mesh.names))
    points[inner[0], 2] = np.nextafter(points[inner[0], 2], 1.0)
    assert failing(run, points) == {"outside_moved"}


def test_a_node_of_the_panel_that_slides_outside_is_noticed(tail_run):
    run, _ = tail_run
    points = run.deflected.points.copy()
    panel = np.setdiff1d(run.mesh.on("fuselage_panel_left"), run.deflection.boxes[0].plan.region.inside)
    panel = np.setdiff1d(panel, run.mesh.on(*(name for name in run.mesh.names if name != "fuselage_panel_left")))
    points[panel[0], 0] += 1e-6
    assert failing(run, points) == {"outside_moved"}


def test_one_inverted_cell_is_noticed(aileron_run):
    run, _ = aileron_run
    points = run.deflected.points.copy()
    free = np.setdiff1d(run.deflection.boxes[0].plan.region.inside, run.mesh.on(*run.mesh.names))
    points[free[0]] += [0.0, 0.0, 0.05]
    assert {"inverted_cells", "quality_min"} <= failing(run, points)


def test_nan_never_passes():
    assert not Check("x", float("nan"), 1.0, "m", "").passed
    assert not Check("x", float("nan"), 1.0, "m", "", "at least").passed


def test_deviation_from_a_plane_is_the_height_of_a_bump():
    grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0), [0.0]), -1).reshape(-1, 3)
    assert plane_deviation(grid).max() < 1e-15
    grid[12, 2] = 0.1
    assert plane_deviation(grid).argmax() == 12


def test_steps_are_taken_where_one_would_invert_cells(chimera_run):
    run, _ = chimera_run
    stiff = replace(run.case, confinement=replace(run.case.confinement, slide=False), repair="off")
    plan = plan_of(stiff, run.mesh)
    result = deflected(plan, plan.angle)
    assert len(result.steps) > 1
    boundary = result.plan.boundary
    np.testing.assert_allclose(
        result.points[boundary.nodes],
        run.mesh.points[boundary.nodes] + boundary.displacement((stiff.angle,)),
        atol=1e-15,
    )
