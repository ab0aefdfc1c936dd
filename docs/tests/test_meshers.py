"""The guide's ways from our CAD to a mesh of Gmsh and of snappyHexMesh: patches bear the names of the CAD."""

import numpy as np
import pytest
import sdm_gmsh
import sdm_snappy

from sdm_deflect.geometry.aircraft import build
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.formats.registry import read
from sdm_deflect.meshing.mesh.edges import area_vectors, polygons_of
from tests.cases import foam


@pytest.fixture(scope="module")
def model():
    return build(Fighter())


def areas(mesh):
    """Area of each patch."""
    faces = {patch.name: polygons_of(patch.faces) for patch in mesh.patches}
    return {name: np.linalg.norm(area_vectors(mesh.points, own), axis=1).sum() for name, own in faces.items()}


@pytest.mark.nightly
def test_gmsh_meshes_the_step(model, tmp_path):
    model.write(tmp_path / "sdm.step")
    sdm_gmsh.build(tmp_path / "sdm.step", tmp_path / "sdm.su2", 0.03)
    mesh = read(tmp_path / "sdm.su2")
    found = areas(mesh)
    assert set(found) == {*model.patches, "far_field"}
    for patch in model.patches:
        assert found[patch] == pytest.approx(sum(face.area for face in model.faces_of(patch)), rel=0.15)
        wanted = np.vstack([face.tessellation(1e-3)[0] for face in model.faces_of(patch)])
        points = mesh.points[mesh.on(patch)]
        assert np.abs(np.array([points.min(0) - wanted.min(0), points.max(0) - wanted.max(0)])).max() < 0.01


@pytest.mark.nightly
def test_snappy_meshes_the_stl(model, tmp_path):
    model.write(tmp_path / "sdm.stl")
    case = tmp_path / "case"
    assert sdm_snappy.write_case(tmp_path / "sdm.stl", case) == model.patches
    for program in ("blockMesh", "surfaceFeatureExtract", "snappyHexMesh"):
        foam.run(program, case, *(["-overwrite"] if program == "snappyHexMesh" else []))
    assert "Mesh OK" in foam.run("checkMesh", case)
    found = areas(read(case))
    assert set(found) == {*model.patches, "far_field"}
    for patch in ("fuselage", "wing_left", "wing_right", "canopy"):
        assert found[patch] == pytest.approx(sum(face.area for face in model.faces_of(patch)), rel=0.15)
