"""Case 5.3: planes stay planes, the panel stays on the cylinder, the root line on both."""

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.job import apex_of, axis_of, fuselage_cylinder
from sdm_deflect.geometry.datum import ends
from sdm_deflect.geometry.parameters import Fighter, Tail

pytestmark = pytest.mark.mesher


def test_every_check_passes(tail_run):
    run, _ = tail_run
    assert {c.name for c in run.checks if not c.passed} == set()
    assert {"cylindricity", "root_on_cylinder", "surface_to_cad", "planarity"} <= {c.name for c in run.checks}


def test_quality_of_the_cells_at_the_box_falls_by_less_than_a_tenth(tail_run):
    run, _ = tail_run
    (before,), (after,) = run.deflection.boxes[0].plan.affected.quality_before, run.deflection.boxes[0].quality
    assert after.p01 > before.p01 - 0.1
    assert after.mean > before.mean - 0.03
    assert after.min >= run.case.limits.quality_min  # a single cell, which the mesher makes now better, now worse


def test_beyond_the_root_region_the_tail_is_rigid(tail_run):
    run, _ = tail_run
    nodes = run.mesh.on("tail_left")
    axis = axis_of(run.case.fighter, "tail_left")
    rigid = axis.rotated(run.mesh.points[nodes], 12.0)
    reach = fuselage_cylinder(run.case.fighter).radius + run.case.blending.root
    outboard = np.abs(run.mesh.points[nodes, 1]) > reach
    assert outboard.sum() > 50
    interpolated = run.deflection.boxes[0].interpolated[nodes]
    np.testing.assert_allclose(interpolated[outboard], rigid[outboard], atol=1e-15)
    assert np.linalg.norm(interpolated - rigid, axis=1).max() > 1e-4  # the root was extended


def test_panel_border_stays_and_panel_follows(tail_run):
    run, _ = tail_run
    panel = run.mesh.on("fuselage_panel_left")
    border = np.intersect1d(panel, run.mesh.on("fuselage", "fuselage_rear"))
    moved = np.linalg.norm(run.deflected.points - run.mesh.points, axis=1)
    assert moved[border].max() == 0.0
    assert moved[panel].max() > 0.01


@pytest.mark.parametrize("tail", [Tail(), Tail(half_span=0.2, anhedral=-5.0, le_sweep=30.0)])
def test_all_edges_of_a_tail_meet_in_its_apex(tail):
    sections = ends(Fighter(tail=tail), "tail_left")
    point = apex_of(sections)
    along = sections[1] - sections[0]
    off = np.cross(point - sections[0], along / np.linalg.norm(along, axis=1, keepdims=True))
    assert np.linalg.norm(off, axis=1).max() < 1e-14
