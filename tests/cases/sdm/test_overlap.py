"""Hexahedra of several surfaces at once."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.aircraft.case import Confinement
from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.registry import case_named


@pytest.mark.mesher
def test_all_surfaces_at_once_pass(turned):
    case = replace(case_named("all"), repair="off")  # which may move nodes within the planes of the wing
    mesh, deflected, checks = turned(case)
    assert {c.name for c in checks if not c.passed} == set()
    names = {c.name for c in checks}
    assert {f"surface_to_cad:{d.surface}" for d in case.deflections} <= names
    moved = np.any(mesh.points != deflected.points, axis=1)
    assert not moved[mesh.on("wing_left", "wing_right", "fin", "fuselage")].any()


@pytest.mark.mesher
def test_overlapping_pair_is_named(make_mesh):
    case = replace(case_named("all"), confinement=Confinement(up=0.16, down=0.16))
    mesh, _ = make_mesh(case)
    pair = tuple(d for d in case.deflections if d.surface in ("tail_left", "rudder"))
    with pytest.raises(InputError, match=r"boxes of tail_left and rudder overlap by .*smaller \(confinement\.up, down"):
        plan_of(replace(case, deflections=pair), mesh)
