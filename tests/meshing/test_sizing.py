import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdm_deflect.meshing.sizing import LEVEL_RATIO, size_field

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
