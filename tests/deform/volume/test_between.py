"""The error between the sites: where a rotation brings the points of a finer mesh, and what the interpolant does."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.base.arrays import first_coincident
from sdm_deflect.base.threads import silent
from sdm_deflect.deform.rbf.fitting import Fitting
from sdm_deflect.deform.surface.appendix_a import blend
from sdm_deflect.deform.volume import deflection as between
from sdm_deflect.deform.volume.deflection import ErrorBetween, _corners, _means, deflect, deflect_in_steps
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import Polygons
from sdm_deflect.meshing.mesh.edges import polygons_of
from tests.deform.blocks import block_with_body
from tests.deform.jobs import FLAP, Y_AXIS, blended, box_plan, job, turn

TIGHT = Fitting(tolerance=1e-7)


def finer_points(n):
    """Midpoints of edges and centres of faces of the body: the nodes of a mesh twice as fine that are not its own."""
    coarse, fine = (block_with_body(count).patch("body") for count in (n, 2 * n))
    own, all_points = (block_with_body(c).points[p.nodes] for c, p in ((n, coarse), (2 * n, fine)))
    both = np.vstack([own, all_points])
    return all_points[first_coincident(both, 1e-9)[len(own) :] >= len(own)]


@pytest.mark.parametrize("steps", [1, 2])
def test_it_is_the_error_at_the_nodes_of_a_finer_mesh(steps):
    mesh = block_with_body(8)
    plan = box_plan(mesh, job(("body",), angle=20.0, near_wall=False))
    one = deflect_in_steps(plan, (20.0,), steps, silent)
    start = finer_points(8)
    places = start.copy()
    for step in one.steps:
        places += step.fits.interpolant(places)
    off = np.abs(places - start - Axis.through(*np.array(Y_AXIS)).displacement(start, 20.0)).max(axis=1)
    found = one.error_between
    assert found.points == len(start)
    assert found.max == pytest.approx(off.max(), rel=1e-9)
    assert found.p99 == pytest.approx(np.quantile(off, 0.99), rel=1e-9)
    assert 0.0 < found.p99 <= found.max


def test_it_is_no_error_of_rounding_where_every_node_is_a_centre():
    """At the sites nothing is left; between them there is."""
    found = turn(block_with_body(8), angle=20.0, near_wall=False, fitting=TIGHT)
    assert found.boxes[0].steps[0].error < 1e-7 < 1e-5 < found.boxes[0].error_between.max


def test_points_are_bounded_and_the_same_each_time(monkeypatch):
    whole = turn(block_with_body(16), angle=20.0, near_wall=False)
    measured = whole.boxes[0].error_between
    monkeypatch.setattr(between, "MOST_MIDPOINTS", 50)
    amounts = whole.plan.boxes[0].boundary.displacement(whole.amounts)
    few, again = (ErrorBetween.of(whole.plan.boxes[0].boundary, whole.boxes[0].steps, amounts) for _ in range(2))
    assert few == again
    assert 25 < few.points <= 50 < measured.points
    assert 0.3 * measured.max < few.max <= measured.max


def test_corners_of_edges_once_and_of_faces():
    corners = _corners(Polygons(np.array([0, 1, 2, 3, 1, 4, 2]), np.array([0, 4, 7])))
    rows = [corners.nodes[a:b].tolist() for a, b in zip(corners.offsets, corners.offsets[1:], strict=False)]
    assert rows == [[0, 1], [0, 3], [1, 2], [1, 4], [2, 3], [2, 4], [0, 1, 2, 3], [1, 4, 2]]
    assert _means(np.eye(5, 3), corners)[0].tolist() == [0.5, 0.5, 0.0]


def test_a_blended_flap_bends_little_within_its_faces(inboard_wing):
    """Its law, so far as it can be asked, brings points near to where the mean of their corners comes to be.

    By how much less than the interpolant errs, on an airfoil of four faces from hinge to trailing edge.
    """
    one = deflect(Plan.of(inboard_wing.mesh, [job(FLAP, inboard_wing.hinge, 10.0, **blended(inboard_wing))]), (10.0,))
    mesh, (law,), (surface,) = one.plan.mesh, one.plan.boxes[0].boundary.laws, one.plan.boxes[0].boundary.surfaces
    corners = _corners(polygons_of(mesh.faces_of(surface.patches)))
    moved, beside = np.zeros_like(mesh.points), np.zeros(len(mesh.points))
    moved[surface.nodes], beside[surface.nodes] = law.displacement(10.0), law.strip
    full, points = law.base.displacement(10.0), _means(mesh.points, corners)
    asked = blend(points, law.points[law.front], law.points[law.driven], full[law.driven], law.kernel)
    off_strip = np.add.reduceat(beside[corners.nodes], corners.offsets[:-1]) == 0.0
    assert 50 < off_strip.sum() < len(off_strip)
    assert np.abs(asked - _means(moved, corners))[off_strip].max() < 0.25 * one.boxes[0].error_between.max


def test_a_surface_without_faces_has_none(block):
    one = turn(block)
    bare = tuple(replace(patch, faces=()) if patch.name == "body" else patch for patch in block.patches)
    boundary = replace(one.plan.boxes[0].boundary, mesh=replace(block, patches=bare))
    assert ErrorBetween.of(boundary, one.boxes[0].steps, one.plan.boxes[0].boundary.displacement(one.amounts)) is None
