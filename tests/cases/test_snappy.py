"""A mesh of polyhedra with layers, made by snappyHexMesh around half the aircraft, as its users bring it."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest

from sdm_deflect.cases.api import deflect
from sdm_deflect.cases.run.inspection import file_figures
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.geometry.datum import hinge_line
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.mesh.polyhedra import pyramids_of
from tests.cases import foam, snappy
from tests.cases.snappy import SURFACE

pytestmark = pytest.mark.nightly

ANGLE = -12.0


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A case folder whose mesh is that of snappyHexMesh."""
    folder = tmp_path_factory.mktemp("snappy") / "sdm"
    snappy.make(folder)
    return folder


def number(name, text):
    return float(re.search(rf"{name}\s*[:=]\s*([\d.e+-]+\d)", text)[1])


def wrong_faces(folder):
    """Faces that checkMesh found to be turned the wrong way."""
    text = (folder / "constant/polyMesh/sets/wrongOrientedFaces").read_text()
    count, listed = re.search(r"\n(\d+)\n\(([\d\s]+)\)", text).groups()
    faces = np.array(listed.split(), dtype=int)
    assert len(faces) == int(count)
    return faces


def test_layers_and_polyhedra_are_read_with_the_verdict_of_checkmesh(case):
    text, mesh = foam.run("checkMesh", case), OpenFoam().read(case)
    assert "Mesh OK." in text
    assert number("polyhedra", text) > 5000
    assert number("prisms", text) > 500
    found = file_figures(case)
    assert found["cells"] == number("cells", text) > 20_000
    assert found["quality"][0]["inverted"] == 0
    faces, theirs = found["face_quality"], foam.metrics(text)
    assert faces["non_orthogonality_max"] == pytest.approx(theirs["non-orthogonality"], rel=1e-9)
    assert faces["non_orthogonality_mean"] == pytest.approx(theirs["mean non-orthogonality"], rel=1e-9)
    assert faces["skewness_max"] == pytest.approx(theirs["skewness"], rel=1e-9)
    volume = pyramids_of(mesh.points, mesh.cells[0]).volume
    assert volume.min() == pytest.approx(number("Min volume", text), rel=1e-6)
    assert volume.sum() == pytest.approx(number("Total volume", text), rel=1e-10)


def test_the_cells_found_inverted_are_those_of_the_faces_that_checkmesh_finds_wrong(case, tmp_path):
    mesh = OpenFoam().read(case)
    inner = np.setdiff1d(np.arange(len(mesh.points)), mesh.on(*mesh.names))
    some = np.random.default_rng(5).choice(inner, 200, replace=False)
    points = mesh.points.copy()
    points[some] += 2e-3 * np.random.default_rng(6).normal(size=(200, 3))
    OpenFoam().rewrite(case, points, tmp_path / "bent")
    text = foam.run("checkMesh", tmp_path / "bent")
    cells = mesh.cells[0]
    wrong = wrong_faces(tmp_path / "bent")
    pyramids = pyramids_of(points, cells)
    inverted = np.flatnonzero(pyramids.inverted)
    assert number("Number of negative volume cells", text) == np.count_nonzero(pyramids.volume <= 0.0) > 10
    assert pyramids.volume.min() == pytest.approx(number("Minimum negative volume", text), rel=1e-6)
    assert len(wrong) > len(inverted) > 50
    inside = wrong[wrong < len(cells.neighbour)]
    sides = np.concatenate([cells.owner[wrong], cells.neighbour[inside]])
    assert set(inverted) <= set(sides)
    at_face = np.isin(cells.owner[wrong], inverted)
    at_face[wrong < len(cells.neighbour)] |= np.isin(cells.neighbour[inside], inverted)
    assert at_face.all()
    assert sum(of["inverted"] for of in file_figures(tmp_path / "bent")["quality"]) == len(inverted)


def test_the_aileron_deflects_and_checkmesh_finds_no_fault(case):
    """The command is run inside the case folder, and does what the function does."""
    mesh, hinge = OpenFoam().read(case), hinge_line(Fighter(), SURFACE)
    fixed = [name for name in mesh.names if name not in (SURFACE, "far_field")]
    result = deflect(mesh, [SURFACE], hinge, ANGLE, motion=Blended(Rotation.about(*hinge)), fixed=fixed)
    assert result.passed, result.checks
    layer = next(check for check in result.checks if check.name == "layer_height")
    assert 0.0 < layer.value < 0.05
    assert int(layer.where.split()[0]) > 1000
    moved = np.linalg.norm(result.points - mesh.points, axis=1)[mesh.on(SURFACE)]
    assert moved.max() > 3e-3
    ends = [",".join(map(repr, map(float, end))) for end in hinge]
    words = ["--surface", SURFACE, "--hinge", *ends, "--angle", str(ANGLE), "--motion", "blended"]
    words += ["--fixed", ",".join(fixed), "--quiet"]
    done = subprocess.run(
        [sys.executable, "-m", "sdm_deflect", "deflect", ".", *words],
        cwd=case,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    out = case.with_name("sdm-deflected")
    written = OpenFoam().read(out)
    np.testing.assert_allclose(written.points, result.points, rtol=0.0, atol=1e-10)
    assert "Mesh OK." in foam.run("checkMesh", out)


def test_beyond_the_angle_at_which_cells_invert_they_are_mended(case, tmp_path):
    """Without repair a step of 28 degrees inverts cells."""
    mesh, hinge = OpenFoam().read(case), hinge_line(Fighter(), SURFACE)
    fixed = [name for name in mesh.names if name not in (SURFACE, "far_field")]
    texts = {}
    for mode in ("off", "auto"):
        options = {"motion": "blended", "fixed": fixed, "repair": mode, "max_steps": 1}
        result = deflect(mesh, [SURFACE], hinge, -28.0, **options)
        OpenFoam().rewrite(case, result.points, tmp_path / mode)
        texts[mode] = foam.run("checkMesh", tmp_path / mode)
    assert result.passed, result.checks
    assert "Failed" in texts["off"]
    assert "Mesh OK." in texts["auto"]
    bare, mended = (foam.metrics(texts[mode])["non-orthogonality"] for mode in ("off", "auto"))
    assert mended < bare
