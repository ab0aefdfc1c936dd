"""Kernels by their formulas, and the logarithm of the compiled loops."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numba import njit

from sdm_deflect.deform.rbf.kernels import (
    LOG_UNIT,
    Cubic,
    Multiquadric,
    ThinPlateSpline,
    WendlandC2,
    kernel_matrix,
    phi,
    scaled_log,
)

KERNELS = [ThinPlateSpline(), Multiquadric(0.7), Multiquadric(1e4), WendlandC2(0.8), WendlandC2(30.0), Cubic()]


def test_thin_plate_spline_is_r_squared_log_r():
    r = np.array([0.0, 1e-3, 0.5, 1.0, 7.0])
    expected = [0.0, *(r[1:] ** 2 * np.log(r[1:]))]
    np.testing.assert_allclose(ThinPlateSpline()(r**2), expected, rtol=1e-15, atol=1e-300)


def test_multiquadric_is_linear_in_r_for_a_large_parameter():
    r = np.array([0.01, 0.1, 1.0])
    np.testing.assert_allclose(Multiquadric(1e4)(r**2), 1e4 * r, rtol=1e-4)
    assert Multiquadric(1e4)(np.zeros(1)) == 1.0


@pytest.mark.parametrize("epsilon", [0.0, -1.0, np.inf, np.nan])
def test_multiquadric_rejects(epsilon):
    with pytest.raises(ValueError, match="epsilon"):
        Multiquadric(epsilon)


def test_wendland_ends_at_its_radius_as_smoothly_as_it_begins():
    """It is zero there with its first three derivatives, and so near to it as the fourth power of the distance."""
    kernel, gap = WendlandC2(0.3), np.array([1e-2, 1e-3])
    assert kernel(np.zeros(1)) == 1.0
    assert not kernel(np.array([0.3, 0.31, 5.0]) ** 2).any()
    np.testing.assert_allclose(kernel((0.3 - 0.3 * gap) ** 2) / gap**4, 5.0 - 4.0 * gap, rtol=1e-9)
    assert kernel(np.array([1e-4]) ** 2)[0] == pytest.approx(1.0 - 10.0 * (1e-4 / 0.3) ** 2, abs=1e-9)


@pytest.mark.parametrize("radius", [0.0, -1.0, np.inf, np.nan])
def test_wendland_rejects(radius):
    with pytest.raises(ValueError, match="radius"):
        WendlandC2(radius)


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@given(length=st.floats(1e-3, 1e3), rho=st.floats(1e-6, 10.0))
@example(length=1.000001, rho=1.0)
def test_rescaling_is_the_same_kernel(kernel, length, rho):
    """Near r = 1 a logarithm is as small as the rounding of r^2 makes it wrong."""
    other, factor, square = kernel.rescaled(length)
    rho2 = np.array([rho**2])
    direct = kernel(length**2 * rho2)
    rounding = 4e-16 * (length * rho) ** 2 if square else 0.0
    atol = 1e-12 * abs(square * rho**2) + rounding
    np.testing.assert_allclose(factor * other(rho2) + square * rho2, direct, rtol=1e-12, atol=atol)


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
def test_compiled_formula_is_the_kernel(kernel):
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(40, 3)), rng.normal(size=(33, 3))
    b[0] = a[0]  # r = 0
    r2 = np.sum((a[:, None] - b) ** 2, axis=2)
    np.testing.assert_allclose(kernel_matrix(kernel, a, b), kernel(r2), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
def test_conditionally_positive_definite_up_to_sign(kernel):
    x = np.random.default_rng(1).uniform(size=(40, 3))
    q, _ = np.linalg.qr(np.column_stack([np.ones(40), x]), mode="complete")
    null = q[:, 4:]
    assert np.linalg.eigvalsh(null.T @ (kernel.sign * kernel_matrix(kernel, x, x)) @ null).min() > 0.0


def test_phi_is_for_compiled_code():
    with pytest.raises(NotImplementedError, match="compiled"):
        phi(ThinPlateSpline().code(), 1.0)


@njit
def _logs(x, out):
    for i in range(len(x)):
        out[i] = LOG_UNIT * scaled_log(x[i])


def test_the_logarithm_agrees_with_the_library_over_the_whole_range():
    x = np.concatenate([np.geomspace(1e-300, 1e300, 200_001), np.linspace(0.5, 2.0, 100_000)])
    got = np.empty_like(x)
    _logs(x, got)
    exact = np.log(x)
    assert np.abs(got - exact).max() <= 2.3e-13  # 2 ulp at log = 690
    away = np.abs(exact) > 1e-3
    assert np.abs(got / np.where(away, exact, 1.0) - 1.0)[away].max() < 1e-15
    assert scaled_log(1.0) == 0.0
    assert np.isfinite(scaled_log(0.0))
