import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from sdm_deflect.meshing.mesh.axis import Axis, Cylinder

vectors = st.tuples(*[st.floats(-10, 10)] * 3).map(np.array)
directions = vectors.filter(lambda v: np.linalg.norm(v) > 1e-3)
angles = st.floats(-180, 180)
CLOUD = np.random.default_rng(0).normal(size=(30, 3))


@settings(deadline=None)
@given(vectors, directions, angles)
def test_rotation_is_an_isometry_that_fixes_its_axis(point, direction, degrees):
    axis = Axis(point, direction)
    moved = axis.rotated(CLOUD, degrees)
    np.testing.assert_allclose(pdist(moved), pdist(CLOUD), rtol=1e-12)
    on_axis = point + np.outer(np.linspace(-2, 2, 5), direction)
    np.testing.assert_allclose(axis.rotated(on_axis, degrees), on_axis, atol=1e-12)
    np.testing.assert_allclose(axis.rotated(moved, -degrees), CLOUD, atol=1e-12)


@settings(deadline=None)
@given(directions, angles)
def test_matrix_is_scipys(direction, degrees):
    vector = np.radians(degrees) * direction / np.linalg.norm(direction)
    expected = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(Axis(np.zeros(3), direction).matrix(degrees), expected, atol=1e-14)


def test_positive_about_y_is_trailing_edge_down():
    hinge = Axis.through(np.array([0.6, 0.1, 0.0]), np.array([0.6, 0.3, 0.0]))
    assert hinge.displacement(np.array([[0.7, 0.2, 0.0]]), 12.0)[0, 2] == pytest.approx(-0.1 * np.sin(np.radians(12)))


def test_small_rotations_keep_their_digits():
    moved = Axis(np.zeros(3), np.array([0, 0, 1.0])).displacement(np.array([[1.0, 0, 0]]), np.degrees(1e-9))
    np.testing.assert_allclose(moved[0], [-0.5e-18, 1e-9, 0.0], rtol=1e-12)


def test_bad_axes_and_cylinders():
    with pytest.raises(ValueError, match="direction"):
        Axis(np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="radius"):
        Cylinder(Axis(np.zeros(3), np.ones(3)), -1.0)


def _cylinder(direction, point):
    return Cylinder(Axis(point, direction), 0.7)


@settings(deadline=None)
@given(directions, vectors)
def test_radial_projection_lands_on_the_nearest_point(direction, point):
    cylinder = _cylinder(direction, point)
    landed = cylinder.projected(CLOUD)
    np.testing.assert_allclose(cylinder.distance(landed), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(landed - CLOUD, axis=1), np.abs(cylinder.distance(CLOUD)), atol=1e-12)
    np.testing.assert_allclose((landed - CLOUD) @ cylinder.axis.direction, 0.0, atol=1e-12)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_projection_along_a_line_stays_on_it_and_takes_the_nearer_hit(seed):
    rng = np.random.default_rng(seed)
    cylinder = Cylinder(Axis(rng.normal(size=3), np.array([1.0, 0.2, -0.1])), 0.7)
    start = cylinder.axis.point + rng.normal(size=(20, 3))
    target = cylinder.projected(start + 0.01 * rng.normal(size=start.shape))
    directions = target - start
    landed = cylinder.projected_along(start, directions)
    np.testing.assert_allclose(cylinder.distance(landed), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.cross(landed - start, directions), 0.0, atol=1e-9)
    reach = np.linalg.norm(landed - start, axis=1)
    assert (reach <= np.linalg.norm(directions, axis=1) + 1e-9).all()


def test_points_on_the_cylinder_stay_and_one_direction_serves_all():
    cylinder = Cylinder(Axis(np.zeros(3), np.array([1.0, 0, 0])), 1.0)
    x = np.array([[0.3, 1.0, 0.0], [0.4, 0.0, -1.0], [0.0, 0.6, 0.8]])
    assert np.array_equal(cylinder.projected_along(x, np.array([0.0, 0.0, 1.0])), x)
    moved = cylinder.projected_along(np.array([[0.0, 2.0, 0.0]]), np.array([1.0, -1.0, 0.0]))
    np.testing.assert_allclose(moved, [[1.0, 1.0, 0.0]], atol=1e-15)


def test_lines_that_miss_are_named():
    cylinder = Cylinder(Axis(np.zeros(3), np.array([1.0, 0, 0])), 1.0)
    for direction in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]):
        with pytest.raises(ValueError, match=r"1 of . lines miss the cylinder"):
            cylinder.projected_along(np.array([[0.0, 2.0, 0.0]]), np.array(direction))
    with pytest.raises(ValueError, match="1 points lie on the axis"):
        cylinder.projected(np.array([[0.5, 0.0, 0.0], [0.5, 0.1, 0.0]]))
