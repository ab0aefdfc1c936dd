"""The validations fail when they should."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.job import axis_of, plan_of
from sdm_deflect.cases.aircraft.rigid import Shape, distance, parts_of
from sdm_deflect.cases.aircraft.validation import plane_deviation, validate
from sdm_deflect.deform.checks import Check, checks_of
from sdm_deflect.deform.volume.deflection import Deflection, deflect
from sdm_deflect.meshing.mesh.labelled import nodes_by_face
from tests.cases.sdm.deflected_cad import built

pytestmark = pytest.mark.mesher


def checked(run, points, case=None):
    """The checks of these points by name."""
    case = case or run.case
    found = Deflection.at(plan_of(case, run.mesh), points, run.deflection.moved_by_repair)
    checks = validate(case, found, checks_of(found, "m"), built(case))
    return {check.name: check for check in checks}


def failing(run, points, case=None):
    """Names of the checks that fail on these points."""
    return {name for name, check in checked(run, points, case).items() if not check.passed}


def test_the_right_mesh_passes(tail_run):
    run, _ = tail_run
    assert failing(run, run.deflected.points) == set()


def test_a_wrong_angle_is_noticed(aileron_run, tail_run):
    run, _ = aileron_run
    wrong = replace(run.case, angle=-12.001)
    assert {"exact_to_cad", "rigid_cad_predicted", "trailing_edge_angle"} <= failing(run, run.deflected.points, wrong)
    run, _ = tail_run
    wrong = {"surface_to_cad", "exact_to_cad", "rigid_cad_predicted", "root_on_cylinder"}
    assert wrong <= failing(run, run.deflected.points, replace(run.case, angle=12.001))


# Distances (m) of the aileron at -12 degrees from CAD turned rigidly.
LARGEST = {
    "strip": pytest.approx(4.42e-3, rel=0.02),
    "hinge_edges": pytest.approx(9.03e-4, rel=0.01),
    "faces": pytest.approx(2.0e-4, rel=0.4),  # of the node nearest to the hinge
    "trailing_edge": pytest.approx(0.0, abs=1e-15),
    "cad_to_surface": pytest.approx(4.38e-3, rel=0.02),
}


def test_every_node_of_an_aileron_is_compared_with_rigid_cad(aileron_run):
    run, _ = aileron_run
    checks = checked(run, run.deflected.points)
    rigid, predicted = checks["surface_to_rigid_cad"], checks["rigid_cad_predicted"]
    nodes = run.mesh.patch("aileron_left").nodes
    np.testing.assert_array_equal(rigid.nodes, nodes)
    assert {part: one["largest"] for part, one in predicted.figures.items()} == LARGEST
    assert sum(one["points"] for part, one in predicted.figures.items() if part in PARTS) == len(nodes)
    for one in predicted.figures.values():
        assert 0.0 <= one["mean"] <= one["rms"] <= one["largest"]
        assert one["largest"] == pytest.approx(one["predicted"], abs=1e-12)
    assert rigid.value == max(one["largest"] for one in predicted.figures.values())
    assert rigid.distances.max() == predicted.figures["strip"]["largest"]
    for words in ("4.42 mm beside the closed rib", "0.906 mm at the hinge edges", "nothing elsewhere"):
        assert words in rigid.where


PARTS = ("strip", "hinge_edges", "faces", "trailing_edge", "root", "beyond_root")


def test_a_tail_is_rigid_cad_but_for_its_root(tail_run):
    run, _ = tail_run
    figures = checked(run, run.deflected.points)["rigid_cad_predicted"].figures
    assert figures.keys() == {"root", "beyond_root", "cad_to_surface"}
    assert figures["root"]["largest"] == pytest.approx(2.88e-3, rel=0.02)
    assert figures["beyond_root"]["largest"] < 1e-12


@pytest.mark.parametrize("part", ["strip", "hinge_edges", "faces", "trailing_edge"])
def test_a_node_off_its_face_by_a_tenth_of_a_millimetre_is_noticed(aileron_run, part):
    run, _ = aileron_run
    nodes = run.mesh.patch("aileron_left").nodes
    shape = Shape(run.case, run.mesh, run.deflected, run.deflection.boxes[0].plan)
    points = run.deflected.points.copy()
    node = nodes[np.flatnonzero(parts_of(shape)[part])[3]]
    points[node, 2] += 1e-4
    assert "rigid_cad_predicted" in failing(run, points)


def test_a_face_that_turned_by_a_tenth_of_a_degree_less_is_noticed(aileron_run):
    run, _ = aileron_run
    axis = axis_of(run.case.fighter, "aileron_left")
    upper = next(nodes for nodes in nodes_by_face(run.mesh, "aileron_left") if run.mesh.points[nodes, 2].min() >= 0.0)
    points = run.deflected.points.copy()
    points[upper] = axis.rotated(points[upper], 0.1)
    assert {"rigid_cad_predicted", "surface_to_rigid_cad"} & failing(run, points)


@pytest.mark.parametrize("angle", [-11.0, *(pytest.param(angle, marks=pytest.mark.nightly) for angle in (-13.0, 12.0))])
def test_an_aileron_turned_by_another_angle_is_far_from_the_rigid_cad(aileron_run, angle):
    run, _ = aileron_run
    assert "rigid_cad_predicted" in failing(run, run.deflected.points, replace(run.case, angle=angle))


def test_distances_are_exact_below_the_tolerance_of_the_library():
    """Trimesh takes triangles whose squared distances differ by 1e-8 for equally near."""
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0.0, 0, 3e-5], [0, 1, 3e-5], [1, 0, 3e-5]]])
    points = np.array([[0.2, 0.2, 4e-5], [0.2, 0.2, -1e-5], [0.9, 0.9, 1e-5]])
    expected = [1e-5, 1e-5, np.hypot(0.4 * np.sqrt(2.0), 1e-5)]
    np.testing.assert_allclose(distance(points, corners), expected, rtol=1e-9)


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
    assert {"planarity", "surface_to_cad", "rigid_cad_predicted"} <= failing(run, points)


def test_one_moved_border_node_is_noticed(tail_run):
    run, _ = tail_run
    points = run.deflected.points.copy()
    border = np.intersect1d(run.mesh.on("fuselage_panel_left"), run.mesh.on("fuselage_rear"))
    points[border[0], 0] += 1e-12
    assert failing(run, points) == {"held_moved"}


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
    assert failing(run, points) == {"held_moved"}


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
    result = deflect(plan)
    assert len(result.boxes[0].steps) > 1
    boundary = result.plan.boxes[0].boundary
    np.testing.assert_allclose(
        result.points[boundary.nodes],
        run.mesh.points[boundary.nodes] + boundary.displacement((stiff.angle,)),
        atol=1e-15,
    )
