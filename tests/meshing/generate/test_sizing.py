"""The size field, and the octrees that carry it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdm_deflect.meshing.generate.sizing import (
    CLEARANCE,
    COARSENESS,
    LEVEL_RATIO,
    background,
    leaves,
    seeds,
    size_field,
)
from sdm_deflect.meshing.mesh.quality import signed_volumes

SEEDS = st.integers(0, 1000)


def brute_force(
    points: np.ndarray, sources: np.ndarray, lengths: np.ndarray, growth: float, largest: float
) -> np.ndarray:
    distance = np.linalg.norm(points[:, None] - sources, axis=2)
    return np.minimum((lengths + growth * distance).min(axis=1), largest)


@given(SEEDS, st.floats(0.05, 1.0))
def test_the_field_is_the_graded_minimum_up_to_rounding_down(seed: int, growth: float) -> None:
    random = np.random.default_rng(seed)
    sources, lengths = random.random((40, 3)), 0.02 + 0.2 * random.random(40)
    points = 3.0 * random.random((50, 3)) - 1.0
    values = size_field(sources, lengths, growth, 0.5)(points)
    exact = brute_force(points, sources, lengths, growth, 0.5)
    assert (values <= exact * (1.0 + 1e-9)).all()
    assert (values >= exact / LEVEL_RATIO * (1.0 - 1e-9)).all()


@given(SEEDS)
def test_the_field_never_grows_faster_than_asked(seed: int) -> None:
    random = np.random.default_rng(seed)
    field = size_field(random.random((20, 3)), 0.05 + random.random(20), 0.3, 2.0)
    a, b = random.random((2, 100, 3))
    assert (np.abs(field(a) - field(b)) <= 0.3 * np.linalg.norm(a - b, axis=1) + 1e-12).all()


def test_the_smallest_length_is_that_of_the_finest_source() -> None:
    field = size_field(np.eye(3), np.array([0.3, 0.1, 0.2]), 0.3, 5.0)
    assert field.smallest == pytest.approx(0.1)
    assert field(np.eye(3)[1:2]) == pytest.approx(0.1)
    assert field(np.array([[1e3, 0.0, 0.0]])) == pytest.approx(5.0)


LOW, HIGH = np.array([-1.0, -1.0, -1.0]), np.array([3.0, 1.0, 1.0])
FIELD = size_field(np.zeros((1, 3)), np.array([0.1]), 0.4, 1.0)


def test_leaves_tile_the_box_and_are_not_to_be_split() -> None:
    corners, edges = leaves(LOW, HIGH, lambda centres, edge: edge > FIELD(centres))
    assert np.isclose((edges**3).sum(), 16.0)
    assert (edges <= FIELD(corners + 0.5 * edges[:, None])).all()
    assert edges.min() < 0.13
    assert edges.max() > 0.4


def test_the_background_covers_the_box_and_carries_the_field() -> None:
    points, tets, lengths = background(FIELD, LOW, HIGH)
    volumes = signed_volumes(points, tets)
    assert (volumes > 0.0).all()
    assert np.isclose(volumes.sum(), 16.0, rtol=0.02)
    assert np.array_equal(lengths, FIELD(points))
    longest = np.linalg.norm(points[tets[:, 0]] - points[tets[:, 1]], axis=1)
    assert (longest < 4.0 * COARSENESS * lengths[tets[:, 0]]).all()


def test_seeds_are_spaced_like_the_field_and_keep_their_distance() -> None:
    surface = 0.05 * np.random.default_rng(0).standard_normal((100, 3))
    cloud = seeds(FIELD, LOW, HIGH, surface)
    again = seeds(FIELD, LOW, HIGH, surface)
    assert np.array_equal(cloud, again)
    away = np.linalg.norm(cloud[:, None] - surface, axis=2).min(axis=1)
    assert (away > CLEARANCE * FIELD(cloud) - 1e-12).all()
    assert ((cloud > LOW) & (cloud < HIGH)).all()
    apart = np.linalg.norm(cloud[:, None] - cloud, axis=2) + np.diag(np.full(len(cloud), np.inf))
    ratio = apart.min(axis=1) / FIELD(cloud)
    assert ratio.min() > 0.3
    assert ratio.max() < 2.5
