"""Other spans, sweeps, gaps and angles build, mesh and validate by the same road."""

from dataclasses import replace

import pytest

from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.geometry.parameters import Aileron, Fighter, Fin, Tail, Wing

pytestmark = [pytest.mark.mesher, pytest.mark.nightly]

AIRCRAFT = {
    "longer wing": ("all", 9.0, Fighter(wing=Wing(half_span=0.34))),
    "tail with dihedral": ("tail", -10.0, Fighter(tail=Tail(half_span=0.19, le_sweep=32.0, anhedral=-4.0))),
    "lower fin, short aileron": ("all", 8.0, Fighter(fin=Fin(z_tip=0.205), aileron=Aileron(y_outboard=0.24))),
}
BLOCKS = {
    "wide gap": (-25.0, Fighter(aileron=Aileron(gap=0.008))),
    "narrow gap": (15.0, Fighter(aileron=Aileron(gap=0.003))),
    "thick wing": (-18.0, Fighter(wing=Wing(thickness_ratio=0.055), aileron=Aileron(gap=0.00427))),
}


@pytest.mark.parametrize("name", AIRCRAFT)
def test_aircraft(name, turned):
    case, angle, fighter = AIRCRAFT[name]
    _, _, checks = turned(replace(case_named(case), fighter=fighter, angle=angle))
    assert {c.name: (c.value, c.where) for c in checks if not c.passed} == {}


@pytest.mark.parametrize("name", BLOCKS)
def test_block(name, turned):
    angle, fighter = BLOCKS[name]
    _, _, checks = turned(replace(case_named("aileron-chimera"), fighter=fighter, angle=angle))
    assert {c.name: (c.value, c.where) for c in checks if not c.passed} == {}
