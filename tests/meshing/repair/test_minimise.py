"""The search for a minimum."""

import numpy as np
import pytest

from sdm_deflect.meshing.repair.region import _inverses, minimise

UNIT = np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 1.0]])


def test_a_quadratic_is_solved():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(30, 30))
    matrix = root @ root.T + np.eye(30)
    right = rng.normal(size=30)

    def function(x):
        return 0.5 * x.ravel() @ matrix @ x.ravel() - right @ x.ravel(), (matrix @ x.ravel() - right).reshape(-1, 3)

    blocks = np.array([matrix[3 * i : 3 * i + 3, 3 * i : 3 * i + 3][np.triu_indices(3)] for i in range(10)])
    found = minimise(function, np.zeros((10, 3)), blocks, 200, 1e-15)
    assert found.place.ravel() == pytest.approx(np.linalg.solve(matrix, right), abs=1e-6)
    assert found.steps < 100


def test_where_the_function_is_infinite_no_step_ends():
    """The logarithm's barrier is jumped over by the first trial."""

    def function(x):
        if x.min() <= 0.0:
            return np.inf, np.zeros_like(x)
        return float(np.sum(x - 0.01 * np.log(x))), 1.0 - 0.01 / x

    found = minimise(function, np.ones((1, 3)), UNIT, 100, 1e-14)
    assert found.place == pytest.approx(np.full((1, 3), 0.01), rel=1e-5)


def test_at_a_minimum_nothing_moves():
    found = minimise(lambda x: (float(np.sum(x**2)), 2.0 * x), np.zeros((1, 3)), UNIT, 10, 1e-9)
    assert found.steps == 0
    assert not found.place.any()


def test_a_node_without_any_curvature_is_as_stiff_as_the_stiffest():
    blocks = np.array([[2.0, 0.0, 0.0, 4.0, 0.0, 8.0], np.zeros(6)])
    assert np.allclose(_inverses(blocks), [np.diag([0.5, 0.25, 0.125]), np.eye(3) / 8.0])
