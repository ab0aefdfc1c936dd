"""Meshes that the tests of this folder share."""

import airfoils
import pytest


@pytest.fixture(scope="session")
def plane_foil(tmp_path_factory):
    """A NACA 0012 with a flap, in a plane."""
    folder = tmp_path_factory.mktemp("airfoils")
    airfoils.build(folder, 0.04)
    return folder / "naca0012.su2"
