"""The aileron with gaps all around is rigidly rotated CAD, node by node, whatever a repair does around it."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import rigid_cad

from sdm_deflect.cases.aircraft.cad import deflected_cad, undeflected_cad
from sdm_deflect.cases.aircraft.job import axis_of
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.aircraft.run_folder import undeflected_models
from sdm_deflect.meshing.formats.vtu import read_vtu, write_vtu
from tests.cases.sdm.deflected_cad import rechecked

pytestmark = pytest.mark.mesher
CASE = case_named("aileron-free")


@pytest.fixture(scope="module")
def free_run(finish):
    """At -30 degrees, where the repair has work."""
    return finish(replace(CASE, angle=-30.0), "aileron-free")


def test_every_node_is_where_the_rotation_brings_it(free_run):
    run, _ = free_run
    nodes = run.mesh.patch("aileron_left").nodes
    turned = axis_of(CASE.fighter, "aileron_left").rotated(run.mesh.points[nodes], -30.0)
    assert run.deflection.moved_by_repair.any()
    assert np.linalg.norm(run.deflected.points[nodes] - turned, axis=1).max() < 1e-15
    others = [name for name in run.mesh.names if name != "aileron_left"]
    assert not np.isin(nodes, run.mesh.on(*others)).any()
    assert np.array_equal(run.deflected.points[run.mesh.on(*others)], run.mesh.points[run.mesh.on(*others)])


def test_every_distance_from_rigid_cad_is_judged_and_zero(free_run):
    run, _ = free_run
    checks = {check.name: check for check in run.checks}
    rigid = checks["surface_to_rigid_cad"]
    assert (rigid.judgement, rigid.limit, rigid.passed) == ("at most", 1e-12, True)
    assert rigid.value < 1e-14
    assert checks["rigid_cad_predicted"].figures.keys() == {"whole", "cad_to_surface", "node_by_node"}
    assert "hinge_offset" not in checks
    assert all(check.passed for check in run.checks)


@pytest.mark.parametrize("angle", [pytest.param(-12.0, marks=pytest.mark.nightly), 15.0])
def test_other_angles_pass_as_well(turned, angle):
    _, _, checks = turned(replace(CASE, angle=angle))
    assert {check.name for check in checks if not check.passed} == set()
    assert next(check.value for check in checks if check.name == "surface_to_rigid_cad") < 1e-14


def test_a_nanometre_is_seen_in_every_direction(free_run, tmp_path):
    """Along a face no distance from the CAD sees it; from node to node it is seen."""
    run, folder = free_run
    for name in ("case.toml", "metrics.json", "interpolant.npz", "convergence.csv", "undeflected.vtu"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    models = undeflected_models(run.case)
    models[0].write(tmp_path / "sdm.brep")
    mesh, nodes = read_vtu(folder / "deflected.vtu"), run.mesh.patch("aileron_left").nodes
    assert max(rigid_cad.distances(folder, "aileron_left", -30.0, tmp_path / "sdm.brep").values()) < rigid_cad.LIMIT
    for axis in range(3):
        points = mesh.points.copy()
        points[nodes[100], axis] += 1e-9
        write_vtu(tmp_path / "deflected.vtu", mesh.with_points(points))
        checks = rechecked(tmp_path, run.case, models)
        assert "surface_to_rigid_cad" in {one.name for one in checks if not one.passed}
        found = rigid_cad.distances(tmp_path, "aileron_left", -30.0, tmp_path / "sdm.brep")
        assert found["node by node"] == pytest.approx(1e-9, rel=1e-6)
        assert found["node by node"] > rigid_cad.LIMIT


def test_the_example_sees_a_hinge_ten_millimetres_off(free_run, tmp_path):
    """Though the run itself says that its hinge is there."""
    run, folder = free_run
    mesh, nodes = read_vtu(folder / "deflected.vtu"), run.mesh.patch("aileron_left").nodes
    axis, aft = axis_of(CASE.fighter, "aileron_left"), np.array([0.01, 0.0, 0.0])
    wrong = replace(axis, point=axis.point + aft)
    points = mesh.points.copy()
    points[nodes] = wrong.rotated(run.mesh.points[nodes], -30.0)
    write_vtu(tmp_path / "deflected.vtu", mesh.with_points(points))
    for name in ("undeflected.vtu", "case.toml"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    words = [sys.executable, rigid_cad.__file__, tmp_path, "aileron_left", "-30"]
    done = subprocess.run([*map(str, words)], capture_output=True, text=True)
    assert (done.returncode, "is above the limit of 1e-12 m" in done.stderr) == (1, True)


def test_the_turned_cad_has_the_faces_of_the_undeflected_one():
    before, after = undeflected_cad(CASE), deflected_cad(CASE)
    assert len(before.faces) == len(after.faces)
    assert before.patches == after.patches
