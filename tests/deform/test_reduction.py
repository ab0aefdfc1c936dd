import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from sdm_deflect.deform.rbf.points import farthest


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
