import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_triangular

from sdm_deflect.deform.rbf.factor import Factor, NotPositiveDefiniteError


def _matrix(n, seed=0):
    a = np.random.default_rng(seed).normal(size=(n, n + 5))
    return a @ a.T / n + np.eye(n)


def _grown(matrix, sizes):
    factor = Factor()
    for m in sizes:
        n = len(factor)
        above = factor.forward(matrix[:n, n : n + m])
        factor, _ = factor.extended(above, matrix[n : n + m, n : n + m])
    return factor


@settings(deadline=None, max_examples=20)
@given(st.lists(st.integers(1, 300), min_size=1, max_size=6))
def test_solves_are_those_of_the_cholesky_factor(sizes):
    n = sum(sizes)
    matrix = _matrix(n)
    factor = _grown(matrix, sizes)
    assert len(factor) == n
    lower = np.linalg.cholesky(matrix)
    right = np.random.default_rng(1).normal(size=(n, 3))
    np.testing.assert_allclose(factor.forward(right), solve_triangular(lower, right, lower=True), atol=1e-10)
    np.testing.assert_allclose(factor.backward(right), solve_triangular(lower.T, right), atol=1e-10)
    solution = factor.backward(factor.forward(right))
    np.testing.assert_allclose(matrix @ solution, right, atol=1e-9)


def test_one_may_go_back_and_extend_otherwise():
    matrix = _matrix(400)
    start = _grown(matrix[:250, :250], [100, 150])
    other = np.r_[0:250, 300:400]
    for rows in (np.arange(350), other):
        part = matrix[np.ix_(rows, rows)]
        above = start.forward(part[:250, 250:])
        factor, inverse = start.extended(above, part[250:, 250:])
        right = np.ones((350, 1))
        np.testing.assert_allclose(part @ factor.backward(factor.forward(right)), right, atol=1e-10)
        np.testing.assert_allclose(np.tril(inverse, -1), 0.0)
    assert len(start) == 250


def test_dependent_rows_are_an_error():
    matrix = np.ones((3, 3)) + np.diag([1.0, 1.0, 0.0])
    matrix[2] = matrix[:, 2] = matrix[0]
    matrix[2, 2] = matrix[0, 0] - 1e-9
    factor = _grown(matrix[:2, :2], [2])
    with pytest.raises(NotPositiveDefiniteError, match="row 2"):
        factor.extended(factor.forward(matrix[:2, 2:]), matrix[2:, 2:])
