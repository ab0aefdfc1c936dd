"""Case 5.2: nodes slide in the Chimera face, both blocks find donors, pinning is worse."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.job import BLOCK, block_stations
from sdm_deflect.cases.aircraft.overset import has_donor, orphans
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.aircraft.run_folder import undeflected_models
from sdm_deflect.geometry.parameters import Aileron, Fighter
from sdm_deflect.meshing.formats.vtu import write_vtu
from sdm_deflect.meshing.mesh.labelled import tets_of
from tests.cases.sdm.deflected_cad import rechecked
from tests.labelled import changed

pytestmark = pytest.mark.mesher


def test_every_check_passes(chimera_run):
    run, _ = chimera_run
    assert {c.name for c in run.checks if not c.passed} == set()
    assert {"chimera_face_in_plane", "orphans"} <= {c.name for c in run.checks}


def test_nodes_slide_in_the_chimera_face(chimera_run):
    run, _ = chimera_run
    station = block_stations(run.case, "aileron_left")[0]
    nodes = run.mesh.on(BLOCK)
    face = nodes[np.abs(run.mesh.points[nodes, 1] - station) < 1e-9]
    moved = run.deflected.points[face] - run.mesh.points[face]
    assert len(face) > 100
    assert np.array_equal(run.deflected.points[face, 1], run.mesh.points[face, 1])
    assert np.abs(moved[:, 2]).max() > 1e-3
    outer = np.setdiff1d(nodes, face)
    assert np.array_equal(run.deflected.points[outer], run.mesh.points[outer])


def test_y_has_most_sites_and_fewest_centres(chimera_run):
    _, folder = chimera_run
    metrics = json.loads((folder / "metrics.json").read_text())
    sites, fits = metrics["sites"]["hexahedron"], metrics["adaptation"]
    assert sites["y"] > sites["x"] == sites["z"]
    assert fits["y"]["centers"] < min(fits["x"]["centers"], fits["z"]["centers"])


def test_sliding_is_better_than_pinning(chimera_run):
    _, folder = chimera_run
    inside = json.loads((folder / "metrics.json").read_text())["deflections"]["aileron_left"]["quality_inside"]
    after, pinned = (inside[name]["tetra"] for name in ("after", "after_pinned"))
    assert after["inverted"] == 0
    assert after["min"] >= 0.2
    assert after["min"] > pinned["min"]
    assert after["below_0_4"] < pinned["below_0_4"]


def test_a_hole_larger_than_the_block_leaves_orphans(chimera_run):
    run, _ = chimera_run
    low, high = run.mesh.points.min(axis=0) - 0.02, run.mesh.points.max(axis=0) + 0.02
    assert orphans(run.deflected, run.background, low, high).value > 0


def test_donors_are_found_inside_and_nowhere_else(chimera_run):
    run, _ = chimera_run
    centroids = run.mesh.points[tets_of(run.mesh)].mean(axis=1)[::50]
    assert has_donor(centroids, run.mesh).all()
    assert not has_donor(centroids + np.array([10.0, 0.0, 0.0]), run.mesh).any()


@pytest.mark.nightly
def test_an_aileron_with_two_gaps_slides_on_both_faces(turned):
    fighter = Fighter(aileron=Aileron(gap=0.00427, y_outboard=0.235))
    case = replace(case_named("aileron-chimera"), fighter=fighter, angle=-20.0)
    mesh, deflected, checks = turned(case)
    assert {c.name for c in checks if not c.passed} == set()
    stations = block_stations(case, "aileron_left")
    assert len(stations) == 2
    for station in stations:
        face = mesh.on(BLOCK)[np.abs(mesh.points[mesh.on(BLOCK), 1] - station) < 1e-9]
        assert np.array_equal(deflected.points[face, 1], mesh.points[face, 1])
        assert np.abs(deflected.points[face, 2] - mesh.points[face, 2]).max() > 5e-4


@pytest.mark.nightly
def test_the_background_of_a_finished_run_is_judged_as_well(chimera_run, tmp_path):
    run, folder = chimera_run
    models = undeflected_models(run.case)

    def judge(folder):
        return {check.name: check.passed for check in rechecked(folder, run.case, models)}

    assert all(judge(folder).values())
    copy, mesh = shutil.copytree(folder, tmp_path / "run"), run.background
    write_vtu(copy / "background.vtu", changed(mesh, tets=tets_of(mesh)[5:]))
    assert not judge(copy)["background_mesh"]
    points = mesh.points.copy()
    points[mesh.on("fin")[0]] += 1e-3
    write_vtu(copy / "background.vtu", mesh.with_points(points))
    assert not judge(copy)["background_mesh"]
