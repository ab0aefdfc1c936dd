"""What an adaptation must satisfy, for every kernel, basis and number of columns."""

import numpy as np
import pytest

from sdm_deflect.base.arrays import farthest
from sdm_deflect.deform.rbf.data_sites import DataSites
from sdm_deflect.deform.rbf.factor import CholeskyBasis
from sdm_deflect.deform.rbf.greedy import Stop, adapt
from sdm_deflect.deform.rbf.interpolant import SolveError, fit
from sdm_deflect.deform.rbf.kernels import Multiquadric, ThinPlateSpline
from sdm_deflect.deform.rbf.rules import GreedyOptions, Separated, Worst
from studies.loop import DirectBasis

KERNELS = [ThinPlateSpline(), Multiquadric(50.0)]


def _sites(n=600, columns=3):
    x = 0.2 * np.random.default_rng(1).uniform(size=(n, 3)) + [0.7, -0.1, 0.0]
    return DataSites(x, 0.01 * np.sin(20 * x[:, :columns]), tuple(range(columns)))


def _options(**changes):
    return GreedyOptions(**{"n_add": 5, "tol_add": 2e-4, "tol_stop": 2e-4, "max_centers": 600} | changes)


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@pytest.mark.parametrize("columns", [1, 3])
@pytest.mark.parametrize(("rule", "n_add"), [(Worst(), 1), (Worst(), 7), (Separated(), 1)], ids=repr)
def test_the_grown_factor_chooses_what_solving_afresh_chooses(kernel, columns, rule, n_add):
    sites = _sites(columns=columns)
    initial = farthest(sites.points, 10)
    grown, resolved = (
        adapt(sites, kernel, initial, _options(n_add=n_add), rule=rule, basis=basis)
        for basis in (CholeskyBasis.of, DirectBasis.of)
    )
    assert grown.stop is Stop.CONVERGED
    assert np.array_equal(grown.chosen, resolved.chosen)
    assert grown.max_error == pytest.approx(resolved.max_error, rel=1e-6)
    np.testing.assert_allclose(
        [s.max_residual for s in grown.history], [s.max_residual for s in resolved.history], rtol=1e-6
    )


@pytest.mark.parametrize("columns", [1, 3])
def test_looking_ahead_changes_nothing_but_the_time(monkeypatch, columns):
    monkeypatch.setattr("sdm_deflect.deform.rbf.rules.WORTH_GUESSING", 0)
    sites = _sites(columns=columns)
    initial = farthest(sites.points, 10)
    plain, ahead, far = (adapt(sites, KERNELS[0], initial, _options(), rule=Worst(n)) for n in (1, 8, 20))
    assert np.array_equal(plain.chosen, ahead.chosen)
    assert np.array_equal(plain.chosen, far.chosen)
    np.testing.assert_allclose(
        [s.max_residual for s in plain.history], [s.max_residual for s in ahead.history], rtol=1e-9
    )
    np.testing.assert_allclose(plain.interpolant.beta, ahead.interpolant.beta, rtol=1e-6, atol=1e-9)


def test_separated_blocks_need_fewer_iterations_and_no_more_centers():
    x = 0.2 * np.random.default_rng(3).uniform(size=(6_000, 3))
    sites = DataSites(x, 0.01 * np.sin(30 * x[:, :1]) * np.cos(20 * x[:, 1:2]), (0,))
    initial = farthest(x, 20)
    worst, separated = (adapt(sites, KERNELS[0], initial, _options(n_add=12), rule=r) for r in (Worst(), Separated()))
    assert separated.max_error < 2e-4
    assert len(separated.history) < 0.5 * len(worst.history)
    assert len(separated.chosen) < 1.05 * len(worst.chosen)


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@pytest.mark.parametrize("basis", [CholeskyBasis.of, DirectBasis.of], ids=["grown", "resolved"])
def test_the_result_is_the_interpolant_on_its_centers(kernel, basis):
    sites = _sites()
    a = adapt(sites, kernel, farthest(sites.points, 8), _options(), basis=basis)
    plain = fit(kernel, sites.points[a.chosen], sites.values[a.chosen])
    y = 0.2 * np.random.default_rng(2).uniform(size=(50, 3)) + [0.7, -0.1, 0.0]
    np.testing.assert_allclose(a.interpolant(y), plain(y), atol=1e-10)
    assert np.array_equal(a.interpolant.centers, sites.points[a.chosen])
    assert a.max_error == np.abs(a.interpolant(sites.points) - sites.values).max()
    assert a.max_error < 2e-4
    assert len(set(a.chosen.tolist())) == len(a.chosen)


def test_initial_centers_come_first_and_history_counts_up():
    sites = _sites()
    initial = farthest(sites.points, 8)
    a = adapt(sites, KERNELS[0], initial, _options(), rule=Worst())
    assert np.array_equal(a.chosen[:8], initial)
    assert [s.iteration for s in a.history] == list(range(len(a.history)))
    added = np.diff([s.n_centers for s in a.history])
    assert (added <= 5).all()
    assert (added > 0).all()
    assert a.history[0].n_centers == 8
    assert a.history[-1].n_centers == len(a.chosen)
    assert (np.diff([s.seconds for s in a.history]) >= 0.0).all()


@pytest.mark.parametrize("rule", [Worst(), Separated()], ids=repr)
def test_mv_of_a_motion_along_one_axis_is_squv(rule):
    sites = _sites()
    initial = farthest(sites.points, 8)
    one = adapt(sites.column(1), KERNELS[0], initial, _options(), rule=rule)
    along = DataSites(sites.points, sites.values * [0.0, 1.0, 0.0])
    all_three = adapt(along, KERNELS[0], initial, _options(), rule=rule)
    assert (one.components, all_three.components) == ((1,), (0, 1, 2))
    assert np.array_equal(one.chosen, all_three.chosen)
    np.testing.assert_allclose(all_three.interpolant.beta[:, [1]], one.interpolant.beta, rtol=1e-9)
    assert not all_three.interpolant.beta[:, [0, 2]].any()


def test_mv_chooses_by_the_norm_over_the_columns():
    """Columns that are parts of one motion in another frame are off by as much together."""
    sites = _sites()
    initial = farthest(sites.points, 8)
    values = sites.values[:, [1]] * [[0.6, 0.0, 0.8]]
    one, parts = (
        adapt(DataSites(sites.points, of, tuple(range(of.shape[1]))), KERNELS[0], initial, options, rule=Worst())
        for of, options in ((sites.values[:, [1]], _options()), (values, _options(tol_add=1e-9, max_iterations=20)))
    )
    shared = min(len(one.chosen), len(parts.chosen))
    assert shared > 50
    assert np.array_equal(one.chosen[:shared], parts.chosen[:shared])


def test_affine_values_need_no_more_than_the_initial_centers():
    x = _sites().points
    sites = DataSites(x, x @ np.arange(9.0).reshape(3, 3) + 1.0)
    a = adapt(sites, KERNELS[0], farthest(x, 5), _options(tol_add=1e-10, tol_stop=1e-10))
    assert a.stop is Stop.CONVERGED
    assert len(a.chosen) == 5


def test_success_is_what_the_interpolant_in_metres_achieves():
    x = _sites().points + 1e9  # coordinates that resolve no more than a tenth of a micrometre
    sites = DataSites(x, 0.01 * np.sin(20 * (x - 1e9)))
    a = adapt(sites, KERNELS[0], farthest(x, 10), _options(tol_add=1e-10, tol_stop=1e-10))
    assert a.history[-1].max_residual < 1e-10 <= a.max_error
    assert a.stop is Stop.ROUNDING


@pytest.mark.parametrize("rule", [Worst(), Separated()], ids=repr)
def test_same_bits_for_any_number_of_threads(monkeypatch, rule):
    monkeypatch.setattr("sdm_deflect.base.threads.SERIAL_PAIRS", 100)
    sites = _sites()
    initial = farthest(sites.points, 10)
    results = []
    for threads in (1, 2, 3):
        monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", threads)
        results.append(adapt(sites, KERNELS[0], initial, _options(), rule=rule))
    for other in results[1:]:
        assert np.array_equal(results[0].chosen, other.chosen)
        assert np.array_equal(results[0].interpolant.beta, other.interpolant.beta)
        assert np.array_equal(results[0].interpolant.alpha, other.interpolant.alpha)
        assert results[0].max_error == other.max_error


@pytest.mark.parametrize(
    ("changes", "stop"),
    [
        ({"max_centers": 23}, Stop.MAX_CENTERS),
        ({"max_centers": 10}, Stop.MAX_CENTERS),
        ({"max_iterations": 3}, Stop.MAX_ITERATIONS),
        ({"max_iterations": 0}, Stop.MAX_ITERATIONS),
        ({"tol_add": 1.0}, Stop.EXHAUSTED),
        ({"tol_stop": 1.0, "tol_add": 1.0}, Stop.CONVERGED),
    ],
)
def test_every_stop_is_a_result_with_a_reason(changes, stop):
    sites = _sites()
    a = adapt(sites, KERNELS[0], farthest(sites.points, 10), _options(**changes))
    assert a.stop is stop
    assert a.stop.value
    assert len(a.chosen) <= changes.get("max_centers", 600)
    assert len(a.history) <= 1 + changes.get("max_iterations", 10_000)


@pytest.mark.parametrize(
    ("initial", "match"),
    [([0, 1, 2], "at least 4"), ([0, 0, 1, 2, 3], "distinct"), ([], "distinct"), ([0, 1, 2, 600], "rows")],
)
def test_initial_centers_are_checked(initial, match):
    with pytest.raises(ValueError, match=match):
        adapt(_sites(), KERNELS[0], np.array(initial, dtype=np.intp), _options())
    with pytest.raises(ValueError, match="max_centers"):
        adapt(_sites(), KERNELS[0], np.arange(30), _options(max_centers=20))


def test_sites_closer_than_the_coordinates_resolve_are_an_error():
    x = np.vstack([_sites().points, _sites().points[:1] + 2e-16])
    sites = DataSites(x, np.append(np.zeros(600), 1.0)[:, None], (0,))
    with pytest.raises(SolveError, match="closer together"):
        adapt(sites, KERNELS[0], np.arange(8), _options())
