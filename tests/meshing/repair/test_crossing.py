"""Edges on which two planes, or a plane and a cylinder, meet: nodes stay on both."""

import numpy as np
import pytest

from sdm_deflect.meshing.mesh.axis import Axis, Cylinder
from sdm_deflect.meshing.mesh.sliding import CylinderWall, Plane
from sdm_deflect.meshing.repair.elements import IntersectionCurve

NORMAL = np.array([0.4, 0.1, 0.9]) / np.linalg.norm([0.4, 0.1, 0.9])
LEANING = Plane(np.array([0.1, -0.2, 0.3]), NORMAL)
OTHER = Plane(np.array([0.1, 0.5, 0.0]), np.array([0.0, 1.0, 0.0]))
WALL = CylinderWall(Cylinder(Axis(np.array([0.0, 0.1, -0.2]), np.array([1.0, 0.1, 0.0])), 0.7))


def on_both(other, rng):
    """Points (20, 3) on the leaning plane and on another shape."""
    if isinstance(other, Plane):
        line = np.cross(LEANING.normal, other.normal)
        rows = np.array([LEANING.normal, other.normal, line])
        start = np.linalg.solve(rows, [LEANING.normal @ LEANING.point, other.normal @ other.point, 0.0])
        return start + np.outer(rng.uniform(-1, 1, 20), line)
    axis = other.cylinder.axis
    across = np.linalg.svd(axis.direction[None])[2][1:]
    turns = rng.uniform(0, 2 * np.pi, 20)
    out = axis.point + 0.7 * (np.outer(np.cos(turns), across[0]) + np.outer(np.sin(turns), across[1]))
    return out - np.outer(LEANING.distance(out) / (axis.direction @ LEANING.normal), axis.direction)


@pytest.fixture(params=[OTHER, WALL], ids=["line", "ellipse"])
def case(request):
    rng = np.random.default_rng(3)
    return IntersectionCurve.of(request.param, LEANING), on_both(request.param, rng), rng.normal(0, 0.1, (20, 3))


def test_nodes_stay_on_both_and_go_along_with_the_displacement(case):
    crossing, points, ways = case
    assert np.abs(crossing.distance(points)).max() < 1e-15
    moved = crossing.projected(points, ways)
    assert np.abs(crossing.distance(points + moved)).max() < 1e-15
    assert np.linalg.norm(moved, axis=1).max() > 0.05
    once = crossing.projected(points, moved)
    np.testing.assert_allclose(once, moved, atol=1e-15)


def test_nodes_off_both_keep_their_distances(case):
    crossing, points, ways = case
    points = points + np.random.default_rng(4).normal(0, 1e-3, points.shape)
    moved = points + crossing.projected(points, ways)
    for shape in (crossing.plane, crossing.other):
        np.testing.assert_allclose(shape.distance(moved), shape.distance(points), atol=1e-15)


def test_a_node_that_does_not_move_keeps_its_bits(case):
    crossing, points, _ = case
    assert not crossing.projected(points, np.zeros_like(points)).any()


def test_the_derivative_is_that_of_differences(case):
    crossing, points, ways = case
    rng, step = np.random.default_rng(5), 1e-6
    rate = rng.normal(size=points.shape)
    ends = [crossing.projected(points, ways + sign * step * rate) for sign in (1, -1)]
    found = crossing.rate(points, ways, rate)
    np.testing.assert_allclose(found, (ends[0] - ends[1]) / (2 * step), atol=1e-8)


def test_shapes_that_do_not_meet_clearly_are_no_crossing():
    tilted = Plane(LEANING.point, NORMAL + np.array([0.0, 0.02, 0.0]))
    assert IntersectionCurve.of(LEANING, tilted) is None
    assert IntersectionCurve.of(WALL, WALL) is None
    assert IntersectionCurve.of(LEANING, None) is None
