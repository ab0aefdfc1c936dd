"""The automatic box."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.box.automatic import Automatic, BoxScene, Given, frame
from sdm_deflect.meshing.mesh.axis import Axis

rng = np.random.default_rng(2)
FLAP = rng.uniform([0, 0, -0.05], [1, 3, 0.05], (200, 3))
NONE = np.empty((0, 3))


def turned(points, seed):
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return points @ (q * np.linalg.det(q)).T


def scene(seed=0, obstacles=NONE, angle=20.0):
    axis = Axis.through(turned(np.zeros((1, 3)), seed)[0], turned(np.array([[0.0, 3.0, 0.0]]), seed)[0])
    points = turned(FLAP, seed)
    moves = axis.displacement(points, angle)
    largest = float(np.linalg.norm(moves, axis=1).max())
    return BoxScene(points, points + moves, largest, axis, turned(obstacles, seed))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(-60.0, 60.0))
def test_the_box_holds_the_motion_with_its_margin_and_turns_with_the_mesh(seed, angle):
    made = scene(seed, angle=angle)
    chosen = Automatic(0.4).choose(made).hexahedron
    assert chosen.contains(np.vstack([made.moving, made.track]), -0.4 + 1e-9).all()
    straight = Automatic(0.4).choose(scene(0, angle=angle)).hexahedron
    sizes = [np.linalg.norm(box.corners[[1, 2, 4]] - box.corners[0], axis=1) for box in (chosen, straight)]
    np.testing.assert_allclose(*sizes, rtol=1e-6)


def test_axes_are_hinge_and_away_from_it():
    origin, axes = frame(scene(0))
    np.testing.assert_allclose(origin, 0.0)
    np.testing.assert_allclose(axes[0], turned(np.array([[0.0, 1.0, 0.0]]), 0)[0], atol=1e-12)
    assert ((scene(0).moving - origin) @ axes[1]).mean() > 0.3
    assert np.linalg.det(axes) == pytest.approx(1.0)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000))
def test_faces_give_way_to_obstacles(seed):
    places = np.random.default_rng(seed).uniform([-1.5, -1.5, -1.5], [3, 5, 1.5], (60, 3))
    core = ((places > [-0.3, -0.3, -0.6]) & (places < [1.3, 3.3, 0.6])).all(axis=1)
    made = scene(seed, places[~core])
    chosen = Automatic(1.0).choose(made)
    assert chosen.hexahedron.contains(np.vstack([made.moving, made.track]), 1e-9).all()
    assert not chosen.hexahedron.contains(made.obstacles).any()


def test_the_margin_is_at_least_three_times_the_motion():
    for angle, margin in ((80.0, 3.0 * scene(0, angle=80.0).largest), (5.0, np.hypot(*FLAP[:, ::2].T).max())):
        assert f"margin {margin:.4g}" in Automatic().choose(scene(0, angle=angle)).why


def test_given_boxes():
    two = Given.at(np.array([[1, 1, 1], [0, 0, 0.0]]))
    assert two.hexahedron.corners.min() == 0.0
    assert two.choose(scene()).hexahedron is two.hexahedron
    assert two.choose(scene()).why == "corners as given"
    eight = Given.at(two.hexahedron.corners)
    assert np.array_equal(eight.hexahedron.corners, two.hexahedron.corners)
    for corners, words in (([[0, 0, 0]], "8 points"), ([[0, 0, 0], [1, 1]], "the box: "), ("auto", "the box: ")):
        with pytest.raises(InputError, match=words):
            Given.at(corners)


def test_open_faces_are_faces():
    unit = Given.at(np.array([[0, 0, 0], [1, 1, 1.0]])).hexahedron
    assert Given(unit, frozenset({"y-"})).choose(scene()).open_faces == {"y-"}
    with pytest.raises(InputError, match=r"open_faces: 'left' is no face of the box; the faces are x-, x\+"):
        Given(unit, frozenset({"left"}))


@pytest.mark.parametrize("margin", [-1.0, np.nan, np.inf, 1e308])
def test_a_margin_is_a_length(margin):
    with pytest.raises(InputError, match=re.escape(f"margin = {margin} must be a length below 1e+40")):
        Automatic(margin)


def test_without_a_hinge_the_box_follows_the_extents():
    made = scene()._replace(hinge=None)
    chosen = Automatic(0.4).choose(made).hexahedron
    assert chosen.contains(np.vstack([made.moving, made.track]), -0.4 + 1e-9).all()
    _, axes = frame(made)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
