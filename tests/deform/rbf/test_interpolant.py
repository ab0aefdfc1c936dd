"""What an interpolant must satisfy, for every kernel and solver."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RBFInterpolator

from sdm_deflect.deform.rbf.interpolant import Interpolant, SolveError, direct, fit
from sdm_deflect.deform.rbf.kernels import Cubic, Multiquadric, ThinPlateSpline, WendlandC2
from studies.loop import Gmres

KERNELS = [ThinPlateSpline(), Multiquadric(1.0), Multiquadric(1e4), WendlandC2(2.0), Cubic()]
SOLVERS = [direct, Gmres(1e-12)]
seeds = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@pytest.mark.parametrize("solve", SOLVERS, ids=["direct", "gmres"])
def test_interpolates_at_centers(kernel, solve):
    x = np.random.default_rng(0).uniform(size=(30, 3))
    f = np.sin(5 * x)
    np.testing.assert_allclose(fit(kernel, x, f, solve)(x), f, atol=1e-9)


@pytest.mark.parametrize("scale", [1e-3, 0.3, 50.0])
def test_agrees_with_scipy(scale):
    rng = np.random.default_rng(2)
    x, y = scale * rng.uniform(size=(300, 3)), scale * rng.uniform(-0.2, 1.2, size=(500, 3))
    f = scale * np.sin(4 * x / scale)
    theirs = RBFInterpolator(x, f, kernel="thin_plate_spline", degree=1)(y)
    np.testing.assert_allclose(fit(ThinPlateSpline(), x, f)(y), theirs, rtol=1e-9, atol=1e-9 * np.abs(theirs).max())


def test_cubic_agrees_with_scipy():
    rng = np.random.default_rng(4)
    x, y = rng.uniform(size=(200, 3)), rng.uniform(size=(200, 3))
    f = rng.normal(size=(200, 2))
    theirs = RBFInterpolator(x, f, kernel="cubic", degree=1)(y)
    np.testing.assert_allclose(fit(Cubic(), x, f)(y), theirs, rtol=1e-8, atol=1e-8 * np.abs(theirs).max())


def test_multiquadric_agrees_with_scipy():
    rng = np.random.default_rng(3)
    x, y = rng.uniform(size=(100, 3)), rng.uniform(size=(200, 3))
    f = rng.normal(size=(100, 2))
    theirs = RBFInterpolator(x, f, kernel="multiquadric", epsilon=7.0, degree=1)(y)
    np.testing.assert_allclose(fit(Multiquadric(7.0), x, f)(y), theirs, rtol=1e-9, atol=1e-9 * np.abs(f).max())


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@settings(deadline=None, max_examples=40)
@given(seed=seeds, scale=st.floats(1e-2, 1e2), shift=st.floats(-1e2, 1e2))
def test_reproduces_affine_fields(kernel, seed, scale, shift):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(3, 3)), rng.normal(size=3)
    x, y = (shift + scale * rng.uniform(size=(n, 3)) for n in (20, 50))
    got = fit(kernel, x, x @ a + b)(y)
    np.testing.assert_allclose(got, y @ a + b, rtol=1e-8, atol=1e-8 * (1 + scale + abs(shift)))


@settings(deadline=None, max_examples=20)
@given(seed=seeds)
def test_vector_fit_is_its_columns(seed):
    rng = np.random.default_rng(seed)
    x, f = rng.uniform(size=(25, 3)), rng.normal(size=(25, 3))
    whole = fit(ThinPlateSpline(), x, f)(x)
    parts = [fit(ThinPlateSpline(), x, f[:, [j]])(x) for j in range(3)]
    np.testing.assert_allclose(whole, np.hstack(parts), atol=1e-12)


def test_coefficients_are_in_metres_and_meet_the_side_conditions():
    rng = np.random.default_rng(4)
    x, f, y = 0.1 * rng.uniform(size=(40, 3)) + 3.0, rng.normal(size=(40, 3)), rng.uniform(size=3)
    s = fit(ThinPlateSpline(), x, f)
    r = np.linalg.norm(y - x, axis=1)
    by_hand = s.alpha.T @ [1.0, *y] + (r**2 * np.log(r)) @ s.beta
    np.testing.assert_allclose(s(y[None])[0], by_hand, rtol=1e-9)
    sums = np.column_stack([np.ones(40), x - 3.0]).T @ s.beta
    np.testing.assert_allclose(sums, 0.0, atol=1e-11 * np.abs(s.beta).sum())


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@pytest.mark.parametrize("axes", [2, 1], ids=["plane", "line"])
def test_flat_sets_of_centers_have_no_slope_out_of_them(kernel, axes):
    rng = np.random.default_rng(5)
    frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    x = rng.uniform(size=(20, axes)) @ frame[:axes] + 2.0
    s = fit(kernel, x, np.sin(x))
    np.testing.assert_allclose(s(x), np.sin(x), atol=1e-9)
    np.testing.assert_allclose(frame[axes:] @ s.alpha[1:], 0.0, atol=1e-9)


def test_one_center_is_a_constant():
    s = fit(ThinPlateSpline(), np.ones((1, 3)), np.array([[2.0, 3.0]]))
    np.testing.assert_allclose(s(np.zeros((4, 3))), np.tile([2.0, 3.0], (4, 1)))


def test_coinciding_centers_are_an_error():
    x = np.random.default_rng(6).uniform(size=(10, 3))
    x[3] = x[7]
    with pytest.raises(ValueError, match="1 centers coincide with another, such as row 7"):
        fit(ThinPlateSpline(), x, np.arange(10.0)[:, None])


def test_singular_systems_are_an_error():
    with pytest.raises(SolveError, match="closer"):
        direct(np.zeros((3, 3)), np.ones((3, 1)))


def test_bad_arrays_are_named():
    good = np.zeros((4, 3))
    with pytest.raises(ValueError, match="centers"):
        fit(ThinPlateSpline(), np.zeros((4, 2)), good)
    with pytest.raises(ValueError, match="values has a number that is not finite in row 2"):
        fit(ThinPlateSpline(), good, np.array([[0.0], [0.0], [np.nan], [0.0]]))
    with pytest.raises(ValueError, match=r"alpha \(3, 1\)"):
        Interpolant(ThinPlateSpline(), good, np.zeros((4, 1)), np.zeros((3, 1)))
