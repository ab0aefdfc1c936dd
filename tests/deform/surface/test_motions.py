"""Motions of surfaces: how far they go, and the functions of their amount."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Moving, Powers, Rotation, Turn
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.surface.tables import Table

rng = np.random.default_rng(11)
HINGE = Rotation.about([0.7, 0.0, 0.0], [0.7, 1.0, 0.0])


@pytest.fixture(scope="module")
def flap(hybrid_wing, flap_names):
    return Surface.of(hybrid_wing.mesh, flap_names)


def test_a_positive_angle_is_right_handed_from_the_first_hinge_point_to_the_second():
    axis = Rotation.about([0, 0, 0], [0, 0, 2]).axis
    np.testing.assert_allclose(axis.rotated(np.array([[1.0, 0.0, 5.0]]), 90.0), [[0.0, 1.0, 5.0]], atol=1e-15)


def test_displacements_are_sums_of_the_functions_that_a_law_names(flap):
    """Their fields are read at as many amounts as there are functions, and serve at all others."""
    table = Table(rng.random((40, 3)), rng.random((40, 3)))
    for motion, amounts in ((HINGE, (-30.0, 20.0)), (Blended(HINGE), (-30.0, 20.0)), (table, (0.8,))):
        law = motion.law(flap)
        assert law.functions.count == len(amounts)
        matrix = np.array([law.functions.values(amount) for amount in amounts])
        fields = np.linalg.solve(matrix, np.array([law.displacement(amount).ravel() for amount in amounts]))
        for amount in (-47.0, 0.3, 11.0):
            expected = law.displacement(amount)
            found = (law.functions.values(amount) @ fields).reshape(-1, 3)
            np.testing.assert_allclose(found, expected, atol=1e-12 * max(1.0, abs(amount)))
        assert law.frozen_at(3.0).displacement(1.0).tolist() == law.displacement(1.0).tolist()


@pytest.mark.parametrize("functions", [Turn(), Turn(6), Powers(1), Powers(6, 15.0)])
def test_rates_of_functions_are_their_derivatives(functions):
    assert not functions.values(0.0).any()
    assert len(functions.values(1.0)) == functions.count
    for amount in (-12.0, 0.0, 7.5):
        h = 1e-3
        near, far = (functions.values(amount + k * h) - functions.values(amount - k * h) for k in (1, 2))
        np.testing.assert_allclose(functions.rates(amount), (8.0 * near - far) / (12.0 * h), atol=1e-11)


def test_every_node_of_a_rigid_surface_keeps_its_shape(flap):
    assert HINGE.law(flap).exact.all()
    assert Table(rng.random((5, 3)), rng.random((5, 3))).law(flap).exact.all()
    assert (HINGE.unit, Blended(HINGE).unit) == ("deg", "deg")


@pytest.mark.parametrize("angle", [91.0, -120.0, float("nan"), float("inf")])
def test_an_angle_out_of_range(angle):
    with pytest.raises(InputError, match=f"angle = {angle:g}"):
        Moving(("flap",), HINGE, angle)


def test_a_surface_has_a_name():
    with pytest.raises(InputError, match="no surface to move: name one"):
        Moving((), HINGE, 1.0)
