"""Folders that cannot be shown: one line, exit code 2."""

import shutil
import socket
from functools import partial

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.run_folder import FinishedCase
from sdm_deflect.cases.view.run import InteractiveRun
from sdm_deflect.cases.view.serve import bound
from sdm_deflect.deform.base.errors import InputError

pytestmark = pytest.mark.mesher


@pytest.fixture
def view(sdm):
    return partial(sdm, "view", "--no-open")


@pytest.fixture
def copy(aileron_folder, tmp_path):
    return shutil.copytree(aileron_folder, tmp_path / "run")


def cut(path):
    path.write_bytes(path.read_bytes()[:3000])


def not_finite(path):
    with np.load(path) as stored:
        arrays = dict(stored)
    arrays["centers_x"] = arrays["centers_x"] + np.nan
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("name", "spoil", "message"),
    [
        ("case.toml", lambda path: path.unlink(), "is not the output folder of a run"),
        ("case.toml", lambda path: path.write_text("name = ["), "case.toml"),
        ("undeflected.vtu", lambda path: path.unlink(), "undeflected.vtu: No such file"),
        ("undeflected.vtu", cut, "undeflected.vtu"),
        ("deflected.vtu", cut, "deflected.vtu"),
        ("interpolant.npz", lambda path: path.unlink(), "interpolant.npz: no archive of arrays: No such file"),
        ("interpolant.npz", cut, "no archive of arrays"),
        ("interpolant.npz", not_finite, "does not belong"),
    ],
)
def test_a_folder_that_is_no_whole_run_is_one_line_and_code_2(view, copy, name, spoil, message):
    spoil(copy / name)
    code, out, err = view(str(copy))
    assert (code, out.count("\n")) == (2, 1), "the address"
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "spoil", "message"),
    [
        ("settings.toml", lambda path: path.unlink(), "is not the output folder of a run"),
        ("settings.toml", lambda path: path.write_text("mesh = ["), "no whole folder of a run"),
        ("settings.toml", lambda path: path.write_text("tolerance = 1.0"), "names no mesh"),
        ("metrics.json", lambda path: path.unlink(), "no table of figures"),
        ("metrics.json", lambda path: path.write_text('{"mesh": {"points": 7}}'), "but 7 when it was deflected"),
        ("../wing.su2", lambda path: path.unlink(), "wing.su2"),
        ("deflected.vtu", cut, "deflected.vtu"),
        ("interpolant.npz", cut, "no archive of arrays"),
        ("interpolant.npz", not_finite, "does not belong"),
    ],
)
def test_a_folder_beside_a_mesh_that_is_not_whole_is_refused_as_well(view, wing_folder, tmp_path, name, spoil, message):
    home = shutil.copytree(wing_folder.parent, tmp_path / "home")
    spoil(home / wing_folder.name / name)
    code, out, err = view(str(home / wing_folder.name))
    assert (code, out.count("\n")) == (2, 1), "the address"
    assert message in err
    assert err.count("\n") == 1


def test_files_of_different_runs_are_refused(copy, stepped_folder):
    shutil.copy(copy / "undeflected.vtu", copy / "deflected.vtu")
    with pytest.raises(InputError, match=r"deflected\.vtu does not belong"):
        InteractiveRun.of(FinishedCase.of(copy))
    with np.load(copy / "interpolant.npz") as stored:
        arrays = {
            name: stored[name] + (0.001 if name.startswith("centers") else 0.0)
            for name in stored.files
            if name != "kernel"
        }
    np.savez(copy / "interpolant.npz", **arrays)
    with pytest.raises(InputError, match=r"interpolant\.npz does not belong"):
        InteractiveRun.of(FinishedCase.of(copy))


def test_a_port_in_use_is_one_line_and_code_2(view, aileron_folder):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        code, _, err = view(str(aileron_folder), "--port", str(port))
        assert code == 2
        assert f"--port {port} cannot be used" in err
    bound(port).close()
