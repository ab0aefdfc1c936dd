"""CAD models that the tests of this folder share: each is built once."""

import numpy as np
import pytest

from sdm_deflect.geometry.aircraft import background, build, chimera_block
from sdm_deflect.geometry.confinement import BlockParameters
from sdm_deflect.geometry.deflected import CadTurn
from sdm_deflect.geometry.parameters import Aileron, Fighter

PAPER_GAP = 0.014 * 0.3048
ALL = {"aileron_left": -12.0, "aileron_right": 12.0, "tail_left": 12.0, "tail_right": -12.0, "rudder": 15.0}


@pytest.fixture(scope="session")
def fighter():
    return Fighter()


@pytest.fixture(scope="session")
def gapped():
    return Fighter(aileron=Aileron(gap=PAPER_GAP))


@pytest.fixture(scope="session")
def plain_model(fighter):
    return build(fighter)


@pytest.fixture(scope="session")
def gapped_model(gapped):
    return build(gapped)


@pytest.fixture(scope="session")
def rigid_model(fighter):
    return build(fighter, {name: CadTurn(angle) for name, angle in ALL.items()})


@pytest.fixture(scope="session")
def blended_model(gapped):
    moved = {name: CadTurn(angle, "blended") for name, angle in ALL.items() if "tail" not in name}
    return build(gapped, moved)


@pytest.fixture(scope="session")
def background_model(gapped):
    return background(gapped)


@pytest.fixture(scope="session")
def block(gapped):
    return chimera_block(gapped, BlockParameters())


@pytest.fixture
def rng():
    return np.random.default_rng(0)
