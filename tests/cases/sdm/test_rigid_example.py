"""The example that measures the distance from rigid CAD by other means agrees with the report."""

import json

import pytest
import rigid_cad

from sdm_deflect.cases.aircraft.cad import undeflected_cad

pytestmark = pytest.mark.mesher


@pytest.mark.parametrize(("name", "surface"), [("aileron_run", "aileron_left"), ("tail_run", "tail_left")])
def test_pyvista_measures_the_same_distance(request, tmp_path, name, surface):
    run, folder = request.getfixturevalue(name)
    undeflected_cad(run.case).write(tmp_path / "sdm.stl")
    checks = json.loads((folder / "metrics.json").read_text())["validation"]["checks"]
    figures = next(check["figures"] for check in checks if check["name"] == "rigid_cad_predicted")
    largest = max(one["largest"] for part, one in figures.items() if part != "cad_to_surface")
    found = rigid_cad.largest_distance(folder, surface, run.case.angle, run.case.fighter, tmp_path / "sdm.stl")
    assert found == pytest.approx(largest, rel=3e-3)
