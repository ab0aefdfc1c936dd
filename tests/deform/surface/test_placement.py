"""Where a hinge lies beside its surface: slips of units are refused, what is unusual is said, the rest is silent."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.cases.run.metrics import farthest, notes_of, travels
from sdm_deflect.deform.base.errors import InputError
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
        Plan.of(other, job(["body"], HINGE))


def test_a_hinge_that_is_far_away_in_any_unit_is_taken_and_said(mesh):
    notes = notes_of(Plan.of(mesh, job(["body"], HINGE + 2.0 * UP, 1.0)))
    assert notes == ("the hinge passes 1.5 from body, which is 1.414 wide across it: is it the right one?",)


@pytest.mark.parametrize(
    ("hinge", "said"),
    [
        ([[3.0, -0.5, 0.0], [3.0, -5.0, 0.0]], "the second point of the hinge, (3, -5, 0), is 4.5 from body"),
        ([[30.0, -0.5, 0.0], [3.0, 0.5, 0.0]], "the first point of the hinge, (30, -0.5, 0), is 26.5 from body"),
    ],
)
def test_a_point_with_a_wrong_digit_is_named(mesh, hinge, said):
    (note,) = notes_of(Plan.of(mesh, job(["body"], hinge, 1.0)))
    assert note == f"{said}, whose chord is 1: is it right?"


@pytest.mark.parametrize("hinge", [HINGE, [[3.0, -0.5, 0.0], [3.0, -0.4, 0.0]], [[3.0, -1.0, 0.0], [3.0, 1.4, 0.0]]])
def test_two_points_on_or_beside_the_surface_are_taken_silently(mesh, hinge):
    assert notes_of(Plan.of(mesh, job(["body"], hinge, 1.0))) == ()


def test_a_box_that_does_not_fit_says_so_beside_the_hinge(mesh):
    with pytest.raises(InputError, match=r"must not move.*; the hinge passes 3\.5 from body, .*is it the right one\?"):
        Plan.of(mesh, job(["body"], HINGE + 4.0 * UP, 40.0))


def test_the_farthest_node_says_where_the_surface_goes(mesh):
    plan = Plan.of(mesh, job(["body"], HINGE - 0.5 * AFT, 10.0))  # about its front: the rear turns down
    ((name, place, move),) = farthest(plan)
    arm = np.array([[1.0, 0.0, -0.5], [1.0, 0.0, 0.5]])
    turned = plan.job.surfaces[0].motion.axis.matrix(10.0)
    assert name == "body"
    assert np.linalg.norm(move) == pytest.approx(np.linalg.norm(arm @ turned.T - arm, axis=1).max())
    assert move[2] < 0.0
    assert place[0] == pytest.approx(3.5)
    ((_, text),) = travels(plan)
    assert re.fullmatch(rf"{np.linalg.norm(move):.4g}, at \(3\.5, \S+, \S+\) towards \(\S+, \+0\.00, -\S+\)", text)
