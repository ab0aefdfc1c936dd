import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from sdm_deflect.deform.rbf.rules import TIE, GreedyOptions, Separated, Worst


def _options(**changes):
    return GreedyOptions(**{"n_add": 3, "tol_add": 0.6, "tol_stop": 0.6, "max_centers": 600} | changes)


NONE = np.empty(0, dtype=np.intp)


def test_worst_sites_first_and_ties_to_the_lower_row():
    residual = np.array([0.5, 3.0, 2.0, 3.0 + 1e-12, 0.9, 7.0])
    points = np.zeros((6, 3))
    assert Worst().choose(points, residual, np.array([5]), _options()).tolist() == [1, 3, 2]
    assert Worst().choose(points, residual, np.array([1, 2, 3, 5]), _options()).tolist() == [4]
    assert Worst().choose(points, residual, np.array([5]), _options(max_centers=3)).tolist() == [1, 3]
    assert not len(Worst().choose(points, residual, np.array([5]), _options(max_centers=1)))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 2.0))
def test_separated_sites_keep_their_distance(seed, spacing):
    rng = np.random.default_rng(seed)
    points, residual = rng.uniform(size=(300, 3)), rng.uniform(size=300)
    chosen = np.arange(15)
    block = Separated(share=0.3, spacing=spacing, growth=100.0).choose(points, residual, chosen, _options(tol_add=0.1))
    assert not set(block.tolist()) & set(chosen.tolist())
    assert (residual[block] > 0.3 * residual.max()).all()
    assert (np.diff(residual[block]) <= TIE * _options().tol_stop).all()  # nearly equal ones go by row
    gap = cdist(points, points[chosen]).min(axis=1)
    apart = cdist(points[block], points[block]) + 9.0 * np.eye(len(block))
    assert (apart >= spacing * np.maximum(gap[block][:, None], gap[block]) - 1e-12).all()
    # Whoever was left out is near one that was taken.
    left = np.setdiff1d(np.flatnonzero(residual > 0.3 * residual.max()), np.append(block, chosen))
    near = cdist(points[left], points[block]) < spacing * np.maximum(gap[left][:, None], gap[block])
    assert near.any(axis=1).all()


def test_separated_blocks_are_limited():
    points, residual = np.random.default_rng(0).uniform(size=(300, 3)), np.ones(300)
    rule = Separated(spacing=0.0, growth=0.5)
    assert len(rule.choose(points, residual, np.arange(40), _options())) == 20
    assert len(rule.choose(points, residual, np.arange(4), _options())) == 3  # n_add at least
    assert len(rule.choose(points, residual, np.arange(40), _options(max_centers=45))) == 5
    assert not len(rule.choose(points, residual, np.arange(40), _options(max_centers=40)))
    assert not len(rule.choose(points, residual, np.arange(40), _options(tol_add=2.0)))


@pytest.mark.parametrize(
    ("name", "value"),
    [("n_add", 0), ("max_centers", 0), ("max_iterations", -1), ("tol_add", 0.0), ("tol_stop", np.nan)],
)
def test_options_are_checked(name, value):
    with pytest.raises(ValueError, match=name):
        _options(**{name: value})


def test_rules_are_checked():
    with pytest.raises(ValueError, match="look_ahead"):
        Worst(0)
    for bad in ({"share": 1.0}, {"spacing": -1.0}, {"growth": np.nan}):
        with pytest.raises(ValueError, match=next(iter(bad))):
            Separated(**bad)
