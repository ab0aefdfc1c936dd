"""Where a hinge lies beside its surface: slips of units are refused, what is unusual is said, the rest is silent."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.cases.run.metrics import farthest, travels, warnings_of
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.edges import median_edge
from sdm_deflect.deform.rbf.fitting import Fitting
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.deform.surface.placement import UNITS, Placement
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.volume.plan import Plan
from tests.deform.blocks import block_with_body
from tests.deform.jobs import job

HINGE = np.array([[3.0, -0.5, 0.0], [3.0, 0.5, 0.0]])
AFT, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def mesh():
    """A unit cube, 3 from the origin, in a block."""
    mesh = block_with_body()
    return replace(mesh, points=mesh.points + 3.0 * AFT)


def test_a_hinge_is_measured_beside_its_surface(mesh):
    surface = Surface.of(mesh, ["body"])
    found = Placement.of(surface, Rotation.about([3.0, 0.0, 2.0], [3.0, 1.0, 2.0]).axis)
    assert found.width == pytest.approx(np.sqrt(2.0))
    assert found.distance == pytest.approx(1.5)
    assert found.covered == pytest.approx(0.5)
    assert not found.near
    assert Placement.of(surface, Rotation.about([3.0, 0.0]).axis).covered == 1.0  # one point: nothing to span


@pytest.mark.parametrize("factor", UNITS)
def test_a_hinge_in_another_unit_is_refused_with_the_factor(mesh, factor):
    other = replace(mesh, points=mesh.points * factor)
    match = rf"hinge: its line passes \S+ from body, which is \S+ wide across it; times {factor:.4g} it would fit"
    with pytest.raises(InputError, match=match):
        Plan.of(other, [job(["body"], HINGE, force=False)])


def warned(mesh, hinge, angle=1.0, force=False, **settings):
    return warnings_of(Plan.of(mesh, [replace(job(["body"], hinge, angle), force=force, **settings)]))


def test_a_hinge_that_is_far_away_in_any_unit_is_refused_unless_it_is_meant(mesh):
    far = "its line passes 1.5 from body, which is 1.414 wide across it"
    with pytest.raises(InputError, match=re.escape(f"hinge: {far}; correct it, or say --force (force = true) if")):
        warned(mesh, HINGE + 2.0 * UP)
    assert warned(mesh, HINGE + 2.0 * UP, force=True) == (f"hinge: {far}: is it the right one?",)


def test_a_hinge_beyond_a_quarter_of_the_width_is_warned_of(mesh):
    assert warned(mesh, HINGE + 0.8 * UP) == ()
    (text,) = warned(mesh, HINGE + 0.9 * UP)
    assert text == "hinge: its line passes 0.4 from body, which is 1.414 wide across it: is it the right one?"


@pytest.mark.parametrize(
    ("hinge", "said"),
    [
        ([[3.0, -0.5, 0.0], [3.0, -5.0, 0.0]], "its second point, (3, -5, 0), is 4.5 from body"),
        ([[30.0, -0.5, 0.0], [3.0, 0.5, 0.0]], "its first point, (30, -0.5, 0), is 26.5 from body"),
    ],
)
def test_a_point_with_a_wrong_digit_is_named(mesh, hinge, said):
    assert f"hinge: {said}, whose chord is 1: is it right?" in warned(mesh, hinge)


@pytest.mark.parametrize("hinge", [HINGE, [[3.0, -1.0, 0.0], [3.0, 1.4, 0.0]]])
def test_two_points_on_or_beside_the_surface_are_taken_silently(mesh, hinge):
    assert warned(mesh, hinge) == ()


@pytest.mark.parametrize(("last", "share"), [(-0.4, "10%"), (-1.5, "0%")])
def test_two_points_that_cover_little_of_the_span_are_warned_of(mesh, last, share):
    (text, *_) = warned(mesh, [[3.0, -0.5, 0.0], [3.0, last, 0.0]])
    assert text == f"hinge: its two points cover {share} of the span of body: is it the right one?"


def test_a_blended_surface_on_both_sides_of_its_hinge_is_warned_of(mesh):
    surface = Surface.of(mesh, ["body"])
    amidships, ahead = (Placement.of(surface, Rotation.about(*(HINGE - x * AFT)).axis) for x in (0.0, 0.5))
    assert list(amidships.warnings(blended=False)) == list(ahead.warnings(blended=True)) == []
    (text,) = amidships.warnings(blended=True)
    assert re.fullmatch(r"hinge: body, 1.414 wide, reaches 0\.7\d* ahead of it: is it right\?", text)


def test_a_tolerance_above_a_tenth_of_an_edge_is_warned_of(mesh):
    edge = median_edge(mesh.points, mesh.faces_of(["body"]))
    for share, count in ((0.09, 0), (0.11, 1)):
        texts = warned(mesh, HINGE, fitting=Fitting(tolerance=share * edge))
        assert len(texts) == count
        assert all("is above 0.1 of the surface's median edge" in text for text in texts)


def test_a_box_that_does_not_fit_says_so_beside_the_hinge(mesh):
    with pytest.raises(InputError, match=r"must not move.*; hinge: its line passes 3\.5 from body, .*the right one\?"):
        Plan.of(mesh, [replace(job(["body"], HINGE + 4.0 * UP, 40.0), force=True)])


def test_the_farthest_node_says_where_the_surface_goes(mesh):
    plan = Plan.of(mesh, [job(["body"], HINGE - 0.5 * AFT, 10.0)])  # about its front: the rear turns down
    ((name, place, move),) = farthest(plan)
    arm = np.array([[1.0, 0.0, -0.5], [1.0, 0.0, 0.5]])
    turned = plan.job.surfaces[0].motion.axis.matrix(10.0)
    assert name == "body"
    assert np.linalg.norm(move) == pytest.approx(np.linalg.norm(arm @ turned.T - arm, axis=1).max())
    assert move[2] < 0.0
    assert place[0] == pytest.approx(3.5)
    ((_, text),) = travels(plan)
    assert re.fullmatch(rf"{np.linalg.norm(move):.4g}, at \(3\.5, \S+, \S+\) towards -z, \(\S+, \+0\.00, -\S+\)", text)
