"""Pictures: composed from plain arrays, drawn by another process whose failure is a message."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from sdm_deflect.cases.report.pictures import write_png
from studies.colours import BLUE, ORANGE, patch_colour
from studies.pictures import walls
from studies.rendering import (
    MARGIN,
    Layer,
    Picture,
    View,
    dots,
    figure_of,
    framed,
    legible,
    plain,
    rendered,
    round_length,
)
from tests.pictures import pixels, shades, share

TRIANGLE = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
FACING = View((plain(TRIANGLE, np.array([[0, 1, 2]]), (255, 0, 0), ambient=1.0),), np.array([0.0, 0.3, 0.3]),
              (1.0, 0.0, 0.0), 2.0, (80, 60))  # fmt: skip


def two_tets():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=float)
    return points, np.array([[0, 1, 2, 3], [1, 2, 3, 4]])


def test_wrong_layers_are_named():
    with pytest.raises(ValueError, match=r"cells \(1, 0\) must be"):
        plain(TRIANGLE, np.empty((1, 0), dtype=int), (0, 0, 0))
    with pytest.raises(ValueError, match=r"rgb \(2, 3\) must be \(1, 3\) or"):
        Layer(TRIANGLE, np.array([[0, 1, 2]]), np.zeros((2, 3), dtype=int))


def test_framed_views_hold_their_points_and_no_more():
    corners = np.random.default_rng(5).normal(size=(20, 3)) * [3.0, 1.0, 0.5]
    view = framed((), corners, (0.3, -1.0, 0.7), (400, 300))
    eye = np.array(view.towards) / np.linalg.norm(view.towards)
    right = np.cross([0.0, 0.0, 1.0], eye)
    up = np.cross(eye, right / np.linalg.norm(right))
    across = [np.ptp(corners @ axis) for axis in (right / np.linalg.norm(right), up)]
    assert view.height == pytest.approx(MARGIN * max(across[1], across[0] * 0.75))
    off = (corners - view.focus) @ up
    assert off.max() == pytest.approx(-off.min())


def test_edges_that_would_blacken_the_picture_are_left_out():
    meshed = plain(TRIANGLE, np.array([[0, 1, 2]]), (255, 0, 0), edge=(0, 0, 0))
    near, far = (View((meshed,), np.zeros(3), (1.0, 0.0, 0.0), height) for height in (2.0, 2000.0))
    assert legible(near).layers[0].edge == (0, 0, 0)
    assert legible(far).layers[0].edge is None


@pytest.mark.mesher
def test_sides_have_one_colour_and_all_components_have_one(aileron_mesh):
    assert patch_colour("tail_left") == patch_colour("tail_right") != patch_colour("wing_left")
    assert patch_colour("fuselage_panel_left") == patch_colour("fuselage_rear") == patch_colour("fuselage")
    for name in walls(aileron_mesh[0]):
        assert max(patch_colour(name)) <= 255


def test_a_triangle_is_drawn_where_it_is():
    (image,) = rendered((FACING,))
    assert image.shape == (60, 80, 3)
    np.testing.assert_array_equal(image[30, 40], [255, 0, 0])
    np.testing.assert_array_equal(image[2, 2], [255, 255, 255])


def test_what_is_nearer_hides_what_is_behind_it():
    """Wherever the order of the layers: a face behind, a line between, and a dot before."""
    behind = 0.5 * TRIANGLE + np.array([-1.0, 0.1, 0.1])
    face = plain(TRIANGLE, np.array([[0, 1, 2]]), (255, 0, 0), ambient=1.0)
    line = plain(behind, np.array([[1, 2]]), BLUE, width=2.0)
    other = plain(behind, np.array([[0, 1, 2]]), (0, 255, 0), ambient=1.0)
    dot = dots(np.array([[2.0, 0.3, 0.3]]), ORANGE, 6.0)
    for layers in permutations((face, line, other)):
        np.testing.assert_array_equal(rendered((replace(FACING, layers=layers),)), rendered((FACING,)))
    (image,) = rendered((replace(FACING, layers=(dot, face)),))
    np.testing.assert_array_equal(image[30, 40], ORANGE)


def test_png_is_written_small(tmp_path):
    figure = figure_of(Picture((FACING, FACING), ("left", "right"), "two triangles", scale="quality"))
    write_png(figure, tmp_path / "two.png")
    image = pixels(tmp_path / "two.png")
    left, right = (share(half, (255, 0, 0)) for half in np.array_split(image, 2, axis=1))
    assert left == pytest.approx(right, rel=0.01)
    assert 0.02 < left < 0.2
    assert shades(image) > 256  # the scale of the quality
    assert (tmp_path / "two.png").stat().st_size < 50_000
    assert len(figure.axes) == 3


def test_a_scale_has_a_round_length():
    assert [round_length(most) for most in (0.9, 1.0, 4.99, 7e-4, 2100.0)] == [0.5, 1.0, 2.0, 5e-4, 2000.0]
