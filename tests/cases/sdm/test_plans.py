"""Plans of the aircraft's cases: every surface turns within its range as the deflection has it."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.deform.mesh_motion import MeshMotion
from sdm_deflect.deform.surface.motions import Powers, Turn
from sdm_deflect.deform.volume.deflection import deflect, deflect_in_steps

pytestmark = pytest.mark.mesher


@pytest.mark.parametrize("case", [case_named("rudder"), case_named("all")], ids=["rudder", "all"])
def test_a_run_is_an_end_of_its_plan(case, make_mesh):
    case = replace(case, repair="off")
    plan = plan_of(case, make_mesh(case)[0])
    found = deflect(plan)
    held = MeshMotion.of(plan, known=found).judged()
    assert [one.name for one in held.controls] == [one.surface for one in case.deflections]
    np.testing.assert_allclose(held.at(held.amounts), found.points, atol=1e-12)
    assert all(held.passed(i) == (one.low, one.high) for i, one in enumerate(held.controls))
    tails = [one.functions == Powers(6, 15.0) for one in held.controls]
    assert tails == [one.surface.startswith("tail") for one in case.deflections]
    assert all(isinstance(one.functions, Turn) for one, tail in zip(held.controls, tails, strict=True) if not tail)


def test_a_tail_is_met_between_the_angles_that_were_read(make_mesh):
    """On the same centres, to a tenth of the tolerance."""
    case = replace(case_named("tail"), range=(-15.0, 15.0))
    plan = plan_of(case, make_mesh(case)[0])
    held, (box,) = MeshMotion.of(plan), plan.boxes
    (step,) = held.snapshots[0].deflections[0].steps
    for angle in np.linspace(-14.0, 14.0, 15):
        expected = deflect_in_steps(box, (angle,), 1, earlier=step, keep_centers=True).points
        assert np.abs(held.at(angle) - expected).max() <= 0.1 * box.sites.tolerance
        assert not held.deflection(angle).inverted
        assert held.deflection(angle).boxes[0].site_error <= 1.1 * box.sites.tolerance
