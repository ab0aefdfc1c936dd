"""Files: right units, closed, whole or not at all."""

import re

import cadquery as cq
import numpy as np
import pytest
import trimesh
from OCP.IFSelect import IFSelect_RetDone
from OCP.Interface import Interface_Static
from OCP.Quantity import Quantity_Color
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_LabelSequence
from OCP.TDocStd import TDocStd_Document
from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool
from scipy.spatial import KDTree


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
def test_binary_stl_is_watertight_and_oriented_outwards(request, tmp_path, name):
    model = request.getfixturevalue(name)
    model.write_binary_stl(tmp_path / "x.stl")
    mesh = trimesh.load(tmp_path / "x.stl")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(model.solid.Volume(), rel=1e-3)


@pytest.mark.parametrize("name", ["plain_model", "rigid_model", "block"])
def test_stl_has_a_named_solid_for_each_patch_and_is_watertight_together(request, tmp_path, name):
    model = request.getfixturevalue(name)
    model.write(tmp_path / "x.STL")
    text = (tmp_path / "x.STL").read_text()
    assert tuple(re.findall(r"^solid (.*)$", text, re.M)) == model.patches
    assert tuple(re.findall(r"^endsolid (.*)$", text, re.M)) == model.patches
    parts = trimesh.load_scene(tmp_path / "x.STL").geometry
    assert set(parts) == set(model.patches)
    for patch, part in parts.items():
        area = sum(face.area for face in model.faces_of(patch))
        assert part.area == pytest.approx(area, rel=5e-3)
        low, high = bounds(cq.Compound.makeCompound([face.shape for face in model.faces_of(patch)]))
        assert np.abs(part.bounds - [low, high]).max() < 1e-3
    union = trimesh.util.concatenate(list(parts.values()))
    union.merge_vertices()
    assert union.is_watertight
    assert union.volume == pytest.approx(model.solid.Volume(), rel=1e-3)


def bounds(shape):
    box = shape.BoundingBox()
    return (box.xmin, box.ymin, box.zmin), (box.xmax, box.ymax, box.zmax)


@pytest.mark.parametrize("name", ["plain_model", "rigid_model", "block"])
def test_names_and_colours_of_step_come_back(request, tmp_path, name):
    """Each named face lies where the model has a face of that patch, and patches differ in colour."""
    model = request.getfixturevalue(name)
    model.write(tmp_path / "x.step")
    reader, document = STEPCAFControl_Reader(), TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
    assert Interface_Static.SetIVal_s("read.stepcaf.subshapes.name", 1)
    assert reader.ReadFile(str(tmp_path / "x.step")) == IFSelect_RetDone
    assert reader.Transfer(document)
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colours = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    body, labels = TDF_LabelSequence(), TDF_LabelSequence()
    shapes.GetFreeShapes(body)
    shapes.GetSubShapes_s(body.Value(1), labels)
    found, seen = {}, {}
    for label in labels:
        text, colour, shape = TDataStd_Name(), Quantity_Color(), cq.Shape.cast(shapes.GetShape_s(label))
        if not isinstance(shape, cq.Face) or not label.IsAttribute(TDataStd_Name.GetID_s()):
            continue
        label.FindAttribute(TDataStd_Name.GetID_s(), text)
        patch = text.Get().ToExtString()
        assert colours.GetColor(shape.wrapped, XCAFDoc_ColorType.XCAFDoc_ColorSurf, colour)
        seen.setdefault(patch, set()).add((colour.Red(), colour.Green(), colour.Blue()))
        found.setdefault(patch, []).append(tuple(1e-3 * x for x in shape.Center().toTuple()))
    assert {patch: len(places) for patch, places in found.items()} == {
        patch: len(model.faces_of(patch)) for patch in model.patches
    }
    for patch, places in found.items():
        wanted = [face.shape.Center().toTuple() for face in model.faces_of(patch)]
        assert KDTree(wanted).query(places)[0].max() < 1e-6
    assert all(len(own) == 1 for own in seen.values())
    assert len(set().union(*seen.values())) == len(model.patches)


def test_other_suffixes_are_refused(tmp_path, block):
    with pytest.raises(ValueError, match=r"it must end in .step, .brep, .stl"):
        block.write(tmp_path / "x.iges")
