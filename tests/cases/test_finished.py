"""A finished folder is validated from its files alone, and a changed one is not believed."""

import shutil

import pytest

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.sdm.run_folder import read_run, validate_folder
from sdm_deflect.meshing.formats.vtu import read_vtu
from sdm_deflect.meshing.formats.vtu_write import write_vtu


@pytest.mark.mesher
def test_the_same_checks_pass_again(aileron_run):
    run, folder = aileron_run
    checks = validate_folder(folder)
    assert {c.name: c.passed for c in checks} == {c.name: True for c in run.checks} | {"same_deflection": True}


@pytest.mark.mesher
def test_a_changed_mesh_is_noticed(aileron_run, tmp_path):
    _, folder = aileron_run
    for name in ("case.toml", "undeflected.vtu"):
        shutil.copy(folder / name, tmp_path / name)
    shutil.copy(folder / "undeflected.vtu", tmp_path / "deflected.vtu")
    failed = {c.name for c in validate_folder(tmp_path) if not c.passed}
    assert {"surface_to_cad", "trailing_edge_angle"} <= failed
    mesh = read_vtu(folder / "deflected.vtu")
    points = mesh.points.copy()
    points[mesh.on("fin")[0]] += 1e-9
    write_vtu(tmp_path / "deflected.vtu", mesh.with_points(points))
    assert {"outside_moved", "fixed_surfaces_moved"} <= {c.name for c in validate_folder(tmp_path) if not c.passed}


@pytest.mark.mesher
def test_nodes_that_did_not_follow_are_noticed(aileron_run, tmp_path):
    run, folder = aileron_run
    for name in ("case.toml", "undeflected.vtu"):
        shutil.copy(folder / name, tmp_path / name)
    free = run.deflections[0].steps[0].state.free
    points = run.deflected.points.copy()
    points[free] = run.mesh.points[free]
    write_vtu(tmp_path / "deflected.vtu", run.deflected.with_points(points))
    assert "same_deflection" in {c.name for c in validate_folder(tmp_path) if not c.passed}


def test_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"it has no case\.toml"):
        read_run(tmp_path)
