"""Meshes that the tests of this folder share."""

import pytest

from tests.cases.own.blocks import annulus_with_fin, block_with_body
from tests.meshing.formats.wing import FLAP, wing


@pytest.fixture(scope="session")
def flap_names():
    return FLAP


@pytest.fixture(scope="session")
def hybrid_wing():
    """Half wing with a flap in the middle of its trailing edge, no gap."""
    return wing(cells=4)


@pytest.fixture(scope="session")
def inboard_wing():
    """The same with a flap that ends at the symmetry plane."""
    return wing(flap=(0.0, 0.5), cells=4)


@pytest.fixture(scope="session")
def block():
    return block_with_body()


@pytest.fixture(scope="session")
def block_on_cylinder():
    return annulus_with_fin()
