"""The example that measures the distance from rigid CAD by other means agrees with the report."""

import json

import pytest
import rigid_cad

from sdm_deflect.cases.aircraft.cad import undeflected_cad
from sdm_deflect.geometry.datum import hinge_line
from sdm_deflect.geometry.parameters import Fighter

pytestmark = pytest.mark.mesher
PIVOT = hinge_line(Fighter(), "tail_left")


@pytest.mark.parametrize(
    ("name", "surface", "angle", "hinge"),
    [("aileron_run", "aileron_left", -12.0, None), ("tail_run", "tail_left", 12.0, PIVOT)],
)
def test_other_means_measure_the_same_distance(request, tmp_path, name, surface, angle, hinge):
    run, folder = request.getfixturevalue(name)
    undeflected_cad(run.case).write(tmp_path / "sdm.brep")
    checks = json.loads((folder / "metrics.json").read_text())["validation"]["checks"]
    figures = next(check["figures"] for check in checks if check["name"] == "rigid_cad_predicted")
    largest = max(one["largest"] for part, one in figures.items() if part != "cad_to_surface")
    found = rigid_cad.distances(folder, surface, angle, tmp_path / "sdm.brep", hinge)
    assert found["nodes to CAD"] == pytest.approx(largest, rel=1e-6)  # a curved edge
    assert found["CAD to mesh"] == pytest.approx(figures["cad_to_surface"]["largest"], rel=0.1)  # at other points
    assert found["node by node"] >= largest
