import numpy as np
import pytest

from sdm_deflect.deform.rbf.kernels import Cubic, Multiquadric, ThinPlateSpline, WendlandC2, kernel_matrix, kernel_sum

KERNELS = [ThinPlateSpline(), Multiquadric(30.0), WendlandC2(2.0), Cubic()]


def _problem(n, c, k, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 3)), rng.normal(size=(c, 3)), rng.normal(size=(c, k)), rng.normal(size=(4, k))


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@pytest.mark.parametrize(("c", "k"), [(1, 1), (31, 1), (32, 2), (33, 3), (100, 4), (257, 5), (40, 9), (8_200, 2)])
def test_sum_is_the_matrix_product(kernel, c, k):
    points, centers, beta, alpha = _problem(70, c, k)
    expected = kernel_matrix(kernel, points, centers) @ beta + alpha[0] + points @ alpha[1:]
    got = kernel_sum(kernel, points, centers, beta, alpha)
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
def test_same_bits_for_any_number_of_threads_and_any_company(kernel):
    points, centers, beta, alpha = _problem(5_001, 331, 3)
    one = kernel_sum(kernel, points, centers, beta, alpha, threads=1)
    for threads in (2, 3):
        assert np.array_equal(one, kernel_sum(kernel, points, centers, beta, alpha, threads=threads))
    alone = np.vstack([kernel_sum(kernel, points[[i]], centers, beta, alpha) for i in range(0, 5_001, 500)])
    assert np.array_equal(alone, one[::500])
    for j in range(3):
        column = kernel_sum(kernel, points, centers, beta[:, [j]], alpha[:, [j]])
        np.testing.assert_allclose(column[:, 0], one[:, j], rtol=1e-12, atol=1e-10)


def test_accepts_any_memory_layout_and_writes_into_nothing():
    points, centers, beta, alpha = _problem(50, 20, 3)
    given = [points, centers, beta, alpha]
    expected = kernel_sum(KERNELS[0], *given)
    kept = [a.copy() for a in given]
    fortran = [np.asfortranarray(a) for a in given]
    assert np.array_equal(kernel_sum(KERNELS[0], *fortran), expected)
    assert all(np.array_equal(a, b) for a, b in zip(given, kept, strict=True))


def test_arrays_that_are_not_points_are_named():
    points, centers, beta, alpha = _problem(5, 20, 1)
    with pytest.raises(ValueError, match=r"points \(5, 2\)"):
        kernel_sum(KERNELS[0], points[:, :2], centers, beta, alpha)
    with pytest.raises(ValueError, match=r"b \(20,\)"):
        kernel_matrix(KERNELS[0], points, centers[:, 0])
