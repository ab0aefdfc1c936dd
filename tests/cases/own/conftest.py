"""Meshes that the tests of this folder share."""

import sys
from pathlib import Path

import pytest

FORMATS = Path(__file__).parents[2] / "meshing" / "formats"
sys.path[:0] = [str(FORMATS), str(Path(__file__).parent)]

from blocks import annulus_with_fin, block_with_body  # noqa: E402
from wing import FLAP, wing  # noqa: E402


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
