"""Patches that slide on planes and cylinders."""

import numpy as np
import pytest
from sdm_deflect.cases.own import deflect

from sdm_deflect.cases.errors import InputError
from sdm_deflect.deform.volume.sliding import Plane, Round, fitted

rng = np.random.default_rng(5)


def turned(points, seed=3):
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return points @ q.T


def round_points(count=300, radius=0.7, arc=1.0):
    phi, z = rng.uniform(0.0, arc, count), rng.uniform(-2.0, 2.0, count)
    return np.column_stack([radius * np.cos(phi), radius * np.sin(phi), z])


def test_a_plane_along_the_axes_is_found_exactly():
    points = np.column_stack([rng.random(50), np.full(50, 0.3), rng.random(50)])
    wall = fitted("plane", points, "sym")
    assert np.array_equal(np.abs(wall.normal), [0.0, 1.0, 0.0])
    assert np.array_equal(wall.kept(points, rng.random((50, 3)))[:, 1], np.zeros(50))


def test_an_oblique_plane_keeps_nodes_to_rounding():
    points = turned(np.column_stack([rng.random((50, 2)), np.full(50, 0.4)]))
    wall = fitted("plane", points, "sym")
    moved = points + wall.kept(points, rng.random((50, 3)))
    assert np.abs(wall.distance(moved)).max() < 1e-15


@pytest.mark.parametrize("arc", [0.4, 2.0, 6.2])
def test_a_cylinder_is_found_in_any_direction(arc):
    points = turned(round_points(arc=arc)) + np.array([3.0, -1.0, 2.0])
    wall = fitted("cylinder", points, "tube")
    assert isinstance(wall, Round)
    assert wall.cylinder.radius == pytest.approx(0.7, rel=1e-6)
    move = 0.05 * rng.normal(size=points.shape)
    assert np.abs(wall.distance(points + wall.kept(points, move))).max() < 1e-9


@pytest.mark.parametrize("shape", ["plane", "cylinder"])
def test_a_patch_of_another_shape_is_refused_with_its_residual(shape):
    x, y = rng.random((2, 100))
    with pytest.raises(InputError, match=f"--slide hill:{shape}: the patch is no {shape}; of 100 nodes one lies"):
        fitted(shape, np.column_stack([x, y, x**2 - 0.7 * y**3]), "hill")


@pytest.mark.parametrize("shape", ["plane", "cylinder"])
def test_rates_are_derivatives_of_what_is_kept(shape):
    points = turned(round_points() if shape == "cylinder" else rng.random((20, 3)) * [1, 1, 0])
    wall = fitted(shape, points, "wall")
    move, speed, h = 0.1 * rng.normal(size=points.shape), rng.normal(size=points.shape), 1e-6
    difference = (wall.kept(points, move + h * speed) - wall.kept(points, move - h * speed)) / (2.0 * h)
    np.testing.assert_allclose(wall.rate(points, move, speed), difference, atol=1e-8)


def test_nodes_around_a_fin_slide_on_their_cylinder(block_on_cylinder):
    mesh = block_on_cylinder
    result = deflect(mesh, ("body",), [[0, 0, 0], [0, 0, 1]], 5.0, slide={"round": "cylinder"}, fixed=("rest",))
    on = mesh.on("round")
    np.testing.assert_allclose(np.linalg.norm(result.points[on, :2], axis=1), 1.0, atol=1e-12)
    free = np.setdiff1d(on, mesh.on("body", "rest"))
    assert np.any(result.points[free] != mesh.points[free])
    assert result.report.passed


def test_a_node_that_would_leave_the_plane_is_counted(inboard_wing):
    w = inboard_wing
    with pytest.raises(InputError, match=r"\d+ nodes shared by the moving surface and symmetry would leave its shape"):
        deflect(w.mesh, ("wing_*", "flap_*"), [[0.7, 0, 0], [0.6, 1, 0]], 10.0, slide={"symmetry": "plane"})


def test_plane_of_a_patch_keeps_what_it_was():
    assert isinstance(fitted("plane", rng.random((9, 3)) * [1, 0, 1], "p"), Plane)
