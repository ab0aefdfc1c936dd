"""Patches that slide on planes and cylinders."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.volume.job import Sliding
from sdm_deflect.meshing.mesh.sliding import CylinderWall, Plane, SlidingPatch, fit_shape
from tests.deform.jobs import WING, turn

rng = np.random.default_rng(5)


def turned(points, seed=3):
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return points @ q.T


def round_points(count=300, radius=0.7, arc=1.0):
    phi, z = rng.uniform(0.0, arc, count), rng.uniform(-2.0, 2.0, count)
    return np.column_stack([radius * np.cos(phi), radius * np.sin(phi), z])


def test_a_plane_along_the_axes_is_found_exactly():
    points = np.column_stack([rng.random(50), np.full(50, 0.3), rng.random(50)])
    wall = fit_shape("plane", points, "sym")
    assert np.array_equal(np.abs(wall.normal), [0.0, 1.0, 0.0])
    assert np.array_equal(wall.projected(points, rng.random((50, 3)))[:, 1], np.zeros(50))


def test_an_oblique_plane_keeps_nodes_to_rounding():
    points = turned(np.column_stack([rng.random((50, 2)), np.full(50, 0.4)]))
    wall = fit_shape("plane", points, "sym")
    moved = points + wall.projected(points, rng.random((50, 3)))
    assert np.abs(wall.distance(moved)).max() < 1e-15


@pytest.mark.parametrize("arc", [0.4, 2.0, 6.2])
def test_a_cylinder_is_found_in_any_direction(arc):
    points = turned(round_points(arc=arc)) + np.array([3.0, -1.0, 2.0])
    wall = fit_shape("cylinder", points, "tube")
    assert isinstance(wall, CylinderWall)
    assert wall.cylinder.radius == pytest.approx(0.7, rel=1e-6)
    move = 0.05 * rng.normal(size=points.shape)
    assert np.abs(wall.distance(points + wall.projected(points, move))).max() < 1e-9


@pytest.mark.parametrize("shape", ["plane", "cylinder"])
def test_a_patch_of_another_shape_is_refused_with_its_residual(shape):
    x, y = rng.random((2, 100))
    with pytest.raises(InputError, match=f"slide = hill:{shape}: the patch is no {shape}; of 100 nodes one lies"):
        fit_shape(shape, np.column_stack([x, y, x**2 - 0.7 * y**3]), "hill")


@pytest.mark.parametrize("shape", ["plane", "cylinder"])
def test_rates_are_derivatives_of_projections(shape):
    points = turned(round_points() if shape == "cylinder" else rng.random((20, 3)) * [1, 1, 0])
    wall = fit_shape(shape, points, "wall")
    move, speed, h = 0.1 * rng.normal(size=points.shape), rng.normal(size=points.shape), 1e-6
    difference = (wall.projected(points, move + h * speed) - wall.projected(points, move - h * speed)) / (2.0 * h)
    np.testing.assert_allclose(wall.rate(points, move, speed), difference, atol=1e-8)


def test_nodes_around_a_fin_slide_on_their_cylinder(block_on_cylinder):
    mesh = block_on_cylinder
    result = turn(mesh, hinge=[[0, 0, 0], [0, 0, 1]], angle=5.0, slide={"round": "cylinder"}, fixed=("rest",))
    on = mesh.on("round")
    np.testing.assert_allclose(np.linalg.norm(result.points[on, :2], axis=1), 1.0, atol=1e-12)
    free = np.setdiff1d(on, mesh.on("body", "rest"))
    assert np.any(result.points[free] != mesh.points[free])
    assert all(check.passed for check in checks_of(result))


def test_a_node_that_would_leave_the_plane_is_counted(inboard_wing):
    with pytest.raises(InputError, match=r"\d+ nodes shared by the moving surface and symmetry would leave its shape"):
        turn(inboard_wing.mesh, WING, [[0.7, 0, 0], [0.6, 1, 0]], slide={"symmetry": "plane"})


@pytest.mark.parametrize("shape", ["plane", "cylinder"])
def test_nodes_that_do_not_move_keep_their_bits(shape):
    points = turned(round_points() if shape == "cylinder" else rng.random((300, 3)) * [1, 1, 0])
    wall, none = fit_shape(shape, points, "wall"), np.zeros_like(points)
    assert np.array_equal(points + wall.projected(points, none), points)


def test_what_is_in_the_shape_already_stays_as_it_is():
    """Projection is idempotent: sliding along the shape is not changed by it."""
    points, move = round_points(), 0.1 * rng.normal(size=(300, 3))
    for wall in (fit_shape("plane", points * [1, 0, 1], "p"), fit_shape("cylinder", points, "c")):
        own = points * [1, 0, 1] if isinstance(wall, Plane) else points
        once = wall.projected(own, move)
        assert np.abs(once - move).max() > 0.01
        np.testing.assert_allclose(wall.projected(own, once), once, atol=1e-14)
        np.testing.assert_allclose(wall.distance(own + once), wall.distance(own), atol=1e-14)


def test_a_plane_keeps_what_nodes_do_in_it():
    """Only the part along the normal is dropped, whatever plane of three points it is."""
    wall = fit_shape("plane", np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]), "p")
    assert isinstance(wall, Plane)
    np.testing.assert_allclose(np.abs(wall.normal), 1.0 / np.sqrt(3.0), atol=1e-15)
    move = rng.normal(size=(9, 3))
    dropped = move - wall.projected(rng.random((9, 3)), move)
    np.testing.assert_allclose(np.cross(dropped, wall.normal), 0.0, atol=1e-15)
    np.testing.assert_allclose(dropped @ wall.normal, move @ wall.normal, atol=1e-15)


def test_too_few_nodes_and_unknown_shapes(block):
    with pytest.raises(InputError, match="slide = p:plane: 2 nodes do not determine a plane"):
        fit_shape("plane", np.eye(2, 3), "p")
    for made in (lambda: Sliding("x-", "sphere"), lambda: fit_shape("sphere", np.eye(3), "x-")):
        with pytest.raises(InputError, match="slide = x-:sphere: the shape must be plane, cylinder or surface"):
            made()
    with pytest.raises(InputError, match="slide = body:plane: the patch is no plane"):
        SlidingPatch.of(block, "body", "plane")
