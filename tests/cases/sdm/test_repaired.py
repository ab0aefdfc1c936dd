"""A repaired run tells of its repair, and whoever changes what it tells is noticed."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.aircraft.run_folder import undeflected_models
from sdm_deflect.meshing.formats.vtu import read_vtu, vtu_arrays, write_vtu
from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.quality import mean_ratio
from tests.cases.sdm.deflected_cad import rechecked

pytestmark = pytest.mark.mesher


@pytest.fixture(scope="module")
def finished(finish):
    """A tail whose worst cells are repaired, and its folder."""
    return finish(replace(case_named("tail"), angle=24.0, repair="auto"), "tail+24")


@pytest.fixture(scope="module")
def failing(finished):
    """Validate a folder; return the names of the checks that fail."""
    case = finished[0].case
    models = undeflected_models(case)

    def call(folder):
        checks = rechecked(folder, case, models)
        return {check.name for check in checks if not check.passed}

    return call


def changed(folder, change):
    """Change the points and the repair of deflected.vtu: `change(points, repair, free)` writes into them."""
    before, after = (read_vtu(folder / f"{name}.vtu") for name in ("undeflected", "deflected"))
    repair, points = vtu_arrays(folder / "deflected.vtu")["repair"].copy(), after.points.copy()
    inner = np.setdiff1d(np.flatnonzero(repair.any(axis=1)), before.on(*before.names))
    change(points, repair, inner)
    arrays = {"displacement": points - before.points, "repair": repair}
    moved = after.with_points(points)
    write_vtu(folder / "deflected.vtu", moved, arrays, {"quality": mean_ratio(points, tets_of(moved))})


def test_a_repaired_run_tells_of_it_and_passes_again(finished, failing):
    run, folder = finished
    figures = json.loads((folder / "metrics.json").read_text())
    repair, repaired = vtu_arrays(folder / "deflected.vtu")["repair"], run.deflection.boxes[0].repaired
    assert figures["repair"]["moved"] == len(repaired.moved) == np.count_nonzero(repair.any(axis=1))
    before = figures["repair"]["quality"]["tetra"]["min"]
    assert before < figures["quality_inside"]["after"]["tetra"]["min"] == run.deflection.boxes[0].quality[0].min
    assert run.passed
    assert failing(folder) == set()


def elsewhere(points, repair, inner):
    outer = np.flatnonzero(~repair.any(axis=1))[0]
    points[outer] += 1e-6
    repair[outer] += 1e-6


def test_a_repair_beyond_its_nodes_is_noticed(finished, failing, tmp_path):
    folder = shutil.copytree(finished[1], tmp_path / "run")
    changed(folder, elsewhere)
    assert "repair_elsewhere" in failing(folder)


def test_a_repair_that_is_no_vectors_is_refused(finished, failing, tmp_path):
    folder = shutil.copytree(finished[1], tmp_path / "run")
    changed(folder, lambda points, repair, inner: repair.__setitem__(0, np.nan))
    with pytest.raises(InputError, match="array repair is not"):
        failing(folder)
