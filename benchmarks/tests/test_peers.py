import shutil

import numpy as np
import pytest

from benchmarks.evaluation import OURS, interpolant, task
from benchmarks.lapack import best_solve
from benchmarks.memory import main
from benchmarks.peers import MAIN_PEERS, PEERS, UnavailableError, available
from benchmarks.roofline import multiply_adds
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline


def test_peers_compute_the_same_sum():
    sum_ = task(400, 90)
    expected = interpolant(sum_)(sum_.points)
    actions, missing = available(sum_, PEERS)
    assert set(actions) | set(missing) == set(PEERS)
    assert OURS not in PEERS
    assert set(MAIN_PEERS) < set(PEERS)
    for name in {"C, one direction", "NumPy in blocks", "KeOps"} & set(actions):
        got = np.asarray(actions[name]()).reshape(400, -1)
        np.testing.assert_allclose(got, expected[:, : got.shape[1]], rtol=1e-9, atol=1e-9)


def test_the_c_peer_leaves_the_floating_point_mode_alone():
    available(task(40, 10), PEERS)
    assert float(np.float64(5e-324)) > 0.0
    assert np.multiply(np.float64(2.3e-308), 0.5) > 0.0


def test_peers_that_fit_interpolate_the_same_values():
    sum_ = task(400, 90)
    actions, _ = available(sum_, PEERS)
    expected = fit(ThinPlateSpline(), sum_.centers, sum_.beta)(sum_.points)
    np.testing.assert_allclose(actions["SciPy RBFInterpolator"](), expected, atol=1e-8 * np.abs(expected).max())


def test_the_best_solve_solves():
    a = np.random.default_rng(1).normal(size=(60, 60))
    a = a + a.T
    np.testing.assert_allclose(a @ best_solve(60).solve(a, np.ones((60, 2))), 1.0, atol=1e-9)


def test_memory_is_measured_with_the_time():
    found = main(60_000, 50)
    assert 0.0 < found["seconds"] < 60.0
    assert found["above"] < found["peak"]


def test_multiplications_are_counted_or_the_compiler_is_missing():
    if shutil.which("gcc"):
        assert multiply_adds() > 1e9
    else:
        with pytest.raises(UnavailableError, match="no gcc"):
            multiply_adds()
