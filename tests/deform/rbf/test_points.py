"""Coincident points, and subsets that are nearly equidistant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from sdm_deflect.base import arrays as points
from sdm_deflect.base.arrays import farthest, first_coincident

GRID = np.stack(np.meshgrid(*[np.arange(4.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(2, 40))
def test_no_point_is_farther_than_the_chosen_are_apart(seed, n):
    x = np.random.default_rng(seed).uniform(size=(200, 3))
    chosen = farthest(x, n)
    assert len(set(chosen.tolist())) == n
    between = cdist(x[chosen], x[chosen]) + 9.0 * np.eye(n)
    assert cdist(x, x[chosen]).min(axis=1).max() <= between.min() + 1e-12


def test_asks_for_no_more_than_there_is():
    x = np.vstack([np.zeros((3, 3)), np.ones((3, 3))])
    assert sorted(farthest(x, 5).tolist()) == [0, 3]
    assert len(farthest(np.eye(3), 9)) == 3
    with pytest.raises(ValueError, match="n = 0"):
        farthest(x, 0)


@settings(deadline=None)
@given(st.lists(st.integers(0, 63), min_size=1, max_size=120))
def test_coincident_points_are_found_exactly(rows):
    got = first_coincident(GRID[rows])
    assert got.tolist() == [rows.index(r) for r in rows]


def test_coincidence_within_a_tolerance():
    x = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 1e-10, 0], [0, 0, -1e-10], [1e-8, 0, 0]])
    assert first_coincident(x, 1e-9).tolist() == [0, 1, 1, 0, 4]
    assert first_coincident(x).tolist() == [0, 1, 2, 3, 4]
    assert first_coincident(np.empty((0, 3))).tolist() == []


@pytest.mark.parametrize("few", [0, 100])
def test_blocks_choose_the_same_points(few, monkeypatch):
    """Random ones, a lattice of equal distances, a plane, a line, one place; each some times over."""
    random = np.random.default_rng(2)
    clouds = [random.random((1500, 3)), 0.1 * GRID + 1e3, random.random((900, 3)) * [1, 1, 0], np.zeros((200, 3)),
              random.random((700, 3)) * [0, 1, 0]]  # fmt: skip
    for cloud in (np.repeat(own, times, axis=0) for own in clouds for times in (1, 3)):
        for n in (1, 7, 250):
            expected = farthest(cloud, n)
            with monkeypatch.context() as patch:
                patch.setattr(points, "FEW", few)
                np.testing.assert_array_equal(farthest(cloud, n), expected)
