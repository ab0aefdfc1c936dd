"""Files: right units, closed, whole or not at all."""

import cadquery as cq
import pytest
import trimesh


def test_step_declares_its_unit_so_that_lengths_survive(tmp_path, plain_model):
    path = tmp_path / "x.step"
    plain_model.write(path)
    read = cq.importers.importStep(str(path)).val()
    tip = max(vertex.X for vertex in read.Vertices())
    assert tip == pytest.approx(1000 * plain_model.vertices[:, 0].max(), rel=1e-9)
    assert read.Volume() == pytest.approx(1e9 * plain_model.solid.Volume(), rel=1e-6)
    assert "SI_UNIT(.MILLI.,.METRE.)" in path.read_text()


def test_brep_keeps_the_solid_in_metres_and_the_faces_in_order(tmp_path, plain_model):
    plain_model.write(tmp_path / "x.brep")
    read = cq.Shape.importBrep(str(tmp_path / "x.brep"))
    assert read.isValid()
    assert read.Volume() == pytest.approx(plain_model.solid.Volume(), rel=1e-9)
    plain_model.write_faces(tmp_path / "faces.brep")
    faces = cq.Shape.importBrep(str(tmp_path / "faces.brep")).Faces()
    wanted = plain_model.faces + plain_model.sheets
    assert len(faces) == len(wanted)
    for found, face in zip(faces, wanted, strict=True):
        assert found.Center().toTuple() == pytest.approx(face.shape.Center().toTuple(), abs=1e-12)


@pytest.mark.parametrize("name", ["plain_model", "rigid_model", "block"])
def test_stl_is_watertight_and_oriented_outwards(request, tmp_path, name):
    model = request.getfixturevalue(name)
    model.write(tmp_path / "x.STL")
    mesh = trimesh.load(tmp_path / "x.STL")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(model.solid.Volume(), rel=1e-3)


def test_other_suffixes_are_refused(tmp_path, block):
    with pytest.raises(ValueError, match=r"it must end in .step, .brep, .stl"):
        block.write(tmp_path / "x.iges")
