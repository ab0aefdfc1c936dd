"""`sdm example --fighter`: the SDM without CAD, and settings for all its control surfaces."""

import lzma
import re
import shlex
import tomllib

import numpy as np
import pytest

from sdm_deflect import read
from sdm_deflect.cases.aircraft.pipeline import mesh_of_case
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.geometry import datum
from sdm_deflect.meshing.mesh.labelled import tets_of, triangles_of
from sdm_deflect.meshing.mesh.quality import mean_ratio
from tests import calls
from tests.kept_meshes import EXAMPLE

# Metres by which hinges in commands, written with five digits, may be beside those of the CAD.
ROUNDED = 1e-5


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder with the mesh and its settings."""
    folder = tmp_path_factory.mktemp("fighter")
    assert calls.sdm("example", folder, "--fighter") == 0
    return folder


def test_it_is_small_and_written_once(folder, sdm):
    assert EXAMPLE.stat().st_size <= 1_800_000
    assert (folder / "fighter.su2").read_bytes() == lzma.decompress(EXAMPLE.read_bytes())
    code, _, err = sdm("example", folder, "--fighter")
    assert code == 2
    assert "fighter.su2 is there already" in " ".join(err.split())
    (folder / "other").mkdir()
    (folder / "other" / "fighter.toml").touch()
    assert sdm("example", folder / "other", "--fighter")[0] == 2
    assert not (folder / "other" / "fighter.su2").exists()


def test_every_command_that_it_prints_passes(folder, tmp_path, sdm, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = sdm("example", "--fighter")
    assert code == 0
    commands = [shlex.split(line) for line in out.splitlines() if line.startswith("sdm deflect")]
    assert len(commands) == 5
    said = [sdm(*words, "--no-report", "--quiet") for _, *words in commands]
    for code, told, err in said:
        assert (code, "all validations passed" in told, "warning" in told) == (0, True, False), err
    for surface in ("aileron_left", "aileron_right", "tail_left", "tail_right", "rudder"):
        assert re.search(rf"^{surface} +\S+: moves by up to ", said[0][1], re.MULTILINE)


def axis(hinge):
    """A point and the direction of a hinge line."""
    first, second = np.array(hinge, dtype=np.float64)
    return first, (second - first) / np.linalg.norm(second - first)


def test_hinges_are_those_of_the_cad_and_as_long_as_the_span(folder, sdm):
    fighter, mesh = case_named("all").fighter, read(folder / "fighter.su2")
    surfaces = {one["patches"]: one for one in tomllib.loads((folder / "fighter.toml").read_text())["surface"]}
    assert set(surfaces) == {"aileron_left", "aileron_right", "tail_left", "tail_right", "rudder"}
    for name, one in surfaces.items():
        (point, direction), (own, along) = axis(datum.hinge_line(fighter, name)), axis(one["hinge"])
        assert along @ direction > 1.0 - 1e-9, name
        assert np.linalg.norm(np.cross(own - point, direction)) < ROUNDED, name
        nodes = mesh.points[mesh.on(name)] @ direction
        assert np.linalg.norm(np.subtract(*one["hinge"])) > 0.95 * np.ptp(nodes), name


@pytest.mark.nightly
def test_the_mesh_made_again_is_like_it(folder, tmp_path):
    kept = read(folder / "fighter.su2")
    made, origin = mesh_of_case(case_named("aileron"), Stopwatch(), cache=False)
    assert made.names == kept.names
    assert origin.boundary_to_cad_max < 1e-7
    assert len(made.points) == pytest.approx(len(kept.points), rel=0.1)
    for name in made.names:
        areas = []
        for mesh in (made, kept):
            a, b, c = (mesh.points[triangles_of(mesh, name)[:, k]] for k in range(3))
            areas.append(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        assert areas[0] == pytest.approx(areas[1], rel=1e-3), name
    assert min(mean_ratio(mesh.points, tets_of(mesh)).min() for mesh in (made, kept)) > 0.3
