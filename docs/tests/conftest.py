"""The fixtures and layers of the tests of the product, and a deflected aileron that the examples read."""

import pytest

from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.output import write_interpolants
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.meshing.formats.vtu import write_vtu
from tests.conftest import *  # noqa: F403


@pytest.fixture(scope="session")
def finished(tmp_path_factory, aileron_mesh):
    """The aileron at -12 degrees, and a folder with those files of a run that the examples read."""
    case, (mesh, _), folder = case_named("aileron"), aileron_mesh, tmp_path_factory.mktemp("aileron")
    plan = plan_of(case, mesh)
    result = deflect(plan)
    write_interpolants(folder / "interpolant.npz", result.boxes)
    displacement = {"displacement": result.points - mesh.points}
    write_vtu(folder / "deflected.vtu", mesh.with_points(result.points), point_data=displacement)
    return mesh, result, folder
