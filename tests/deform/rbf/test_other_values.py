"""The same centres for other values."""

import numpy as np

from sdm_deflect.deform.rbf.data_sites import DataSites
from sdm_deflect.deform.rbf.factor import CholeskyBasis
from sdm_deflect.deform.rbf.greedy import adapt
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.problem import Problem
from sdm_deflect.deform.rbf.rules import GreedyOptions

rng = np.random.default_rng(8)
POINTS = rng.random((400, 3))
ROWS = np.arange(60)
OPTIONS = GreedyOptions(n_add=5, tol_add=1e-3, tol_stop=1e-3)


def field(points, phase):
    return np.column_stack([np.sin(3.0 * points[:, 0] + phase), np.cos(2.0 * points[:, 1] * phase)])


def basis(phase):
    return CholeskyBasis.of(Problem.of(DataSites(POINTS, field(POINTS, phase), (0, 1)), ThinPlateSpline()), ROWS)


def test_other_values_give_the_interpolant_of_a_fresh_fit():
    fresh, again = basis(0.7).refined(), basis(0.2).with_values(field(POINTS, 0.7)).refined()
    np.testing.assert_allclose(again.beta, fresh.beta, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(again.alpha, fresh.alpha, rtol=1e-8, atol=1e-9)


def test_a_basis_with_other_values_is_extended_like_a_fresh_one():
    more = np.arange(60, 90)
    fresh = basis(0.7).extended(more).coefficients()
    again = basis(0.2).with_values(field(POINTS, 0.7)).extended(more).coefficients()
    np.testing.assert_allclose(again.beta, fresh.beta, rtol=1e-7, atol=1e-8)


def test_an_adaptation_keeps_its_last_basis_and_starts_again_from_it():
    sites = [DataSites(POINTS, field(POINTS, phase), (0, 1)) for phase in (0.2, 0.7)]
    first = adapt(sites[0], ThinPlateSpline(), ROWS, OPTIONS)
    assert np.array_equal(first.basis.chosen, first.chosen)

    def start(problem, rows):
        return first.basis.with_values(problem.values)

    second = adapt(sites[1], ThinPlateSpline(), first.chosen, OPTIONS, basis=start)
    assert second.max_error < OPTIONS.tol_stop
    assert np.array_equal(second.chosen[: len(first.chosen)], first.chosen)
    assert np.array_equal(second.basis.chosen, second.chosen)
