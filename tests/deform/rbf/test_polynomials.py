"""What each kernel needs beside itself: the polynomials of `fitting.ORDERS`, and the condition of what is left."""

import numpy as np
import pytest

from sdm_deflect.base.arrays import farthest
from sdm_deflect.deform.rbf.data_sites import DataSites
from sdm_deflect.deform.rbf.factor import CholeskyBasis
from sdm_deflect.deform.rbf.fitting import KERNELS, ORDERS, Fitting
from sdm_deflect.deform.rbf.greedy import Stop, adapt
from sdm_deflect.deform.rbf.interpolant import UnitBox
from sdm_deflect.deform.rbf.kernels import kernel_matrix
from sdm_deflect.deform.rbf.kernels import kernel_of as of_radius
from sdm_deflect.deform.rbf.problem import Problem
from sdm_deflect.deform.rbf.rules import GreedyOptions
from studies.loop import DirectBasis

RADIUS = 0.5
POINTS = np.random.default_rng(7).uniform(-1.0, 1.0, size=(160, 3))
SITES = DataSites(POINTS, np.sin(3.0 * POINTS))
PAIRS = [(kernel, polynomial) for kernel in KERNELS for polynomial in ORDERS]
TOGETHER = [pair for pair in PAIRS if ORDERS[pair[1]] >= KERNELS[pair[0]].order]


def kernel_of(name):
    return of_radius(name, RADIUS)


def least(name, polynomial):
    """Least eigenvalue of a kernel's matrix on what is orthogonal to a polynomial."""
    kernel, q = kernel_of(name), UnitBox.around(POINTS, polynomial).polynomials(POINTS)
    null = np.linalg.qr(q, mode="complete")[0][:, q.shape[1] :]
    return np.linalg.eigvalsh(null.T @ (kernel.sign * kernel_matrix(kernel, POINTS, POINTS)) @ null).min()


@pytest.mark.parametrize(("name", "polynomial"), PAIRS)
def test_a_kernel_is_definite_with_the_polynomials_of_its_order_and_with_no_other(name, polynomial):
    assert (least(name, polynomial) > 0.0) == ((name, polynomial) in TOGETHER)


@pytest.mark.parametrize(("name", "polynomial"), PAIRS)
def test_settings_allow_exactly_these(name, polynomial):
    if (name, polynomial) in TOGETHER:
        assert Fitting(kernel=name, polynomial=polynomial).polynomial == polynomial
    else:
        with pytest.raises(
            ValueError, match=f"polynomial = {polynomial}: the .* of order .* needs polynomial = linear"
        ):
            Fitting(kernel=name, polynomial=polynomial)


@pytest.mark.parametrize(("name", "polynomial"), TOGETHER)
def test_a_grown_factor_gives_what_a_fresh_solve_gives(name, polynomial):
    problem = Problem.of(SITES, kernel_of(name), polynomial)
    grown = CholeskyBasis.of(problem, np.arange(20)).extended(np.arange(20, 90)).extended(np.arange(90, 160))
    one, other = (
        problem.interpolant(basis.chosen, basis.refined()) for basis in (grown, DirectBasis.of(problem, np.arange(160)))
    )
    x = np.random.default_rng(8).uniform(-1.2, 1.2, size=(50, 3))
    np.testing.assert_allclose(one(x), other(x), atol=1e-9)
    np.testing.assert_allclose(one(POINTS), SITES.values, atol=1e-10)


@pytest.mark.parametrize(("name", "polynomial"), TOGETHER)
def test_a_polynomial_is_reproduced_where_it_is_added(name, polynomial):
    """A constant shift of all sites is one of all points exactly if there is a constant; a slope, if it is linear."""
    for values, wanted in ((np.full((160, 1), 0.3), 1), (POINTS[:, :1], 2)):
        options = GreedyOptions(n_add=10, tol_add=1e-9, tol_stop=1e-9, polynomial=polynomial)
        found = adapt(DataSites(POINTS, values, (0,)), kernel_of(name), farthest(POINTS, 12), options)
        assert (len(found.chosen) == 12 and found.stop is Stop.CONVERGED) == (ORDERS[polynomial] >= wanted)


@pytest.mark.parametrize(("name", "polynomial"), TOGETHER)
def test_the_condition_is_that_of_the_reduced_kernel(name, polynomial):
    basis = CholeskyBasis.of(Problem.of(SITES, kernel_of(name), polynomial), np.arange(160))
    rows = basis.chosen[basis.beside]
    exact = np.linalg.cond(basis.kernel.matrix(rows, rows), 1)
    assert exact / 3.0 <= basis.condition() <= exact * (1.0 + 1e-6)
    assert basis.condition() == basis.condition()


def test_a_radius_belongs_to_kernels_that_have_one():
    for name, needs in KERNELS.items():
        if needs.radius:
            assert Fitting(kernel=name, kernel_radius=0.1).kernel_radius == 0.1
            assert kernel_of(name) != of_radius(name, 2.0 * RADIUS)
        else:
            with pytest.raises(
                ValueError, match=rf"kernel_radius = 0\.1: the {needs.name} has none; .* mq or wendland"
            ):
                Fitting(kernel=name, kernel_radius=0.1)
            assert kernel_of(name) == of_radius(name, 2.0 * RADIUS)
