"""Fluent's meshes in HDF5: both layouts, only coordinates change, VTK's reader sees what we moved."""

import re
from dataclasses import replace

import h5py
import numpy as np
import pytest
import pyvista as pv

import sdm_deflect as sdm
from sdm_deflect.cases.report.folder import folder_of
from sdm_deflect.cases.run.inspection import inspect
from sdm_deflect.cases.run.mesh_files import Targets
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.cells import Patch
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.quality import inverted_of
from sdm_deflect.meshing.formats.fluent import Fluent
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.polyhedra import faces_by_cell, standard_cells
from sdm_deflect.meshing.formats.registry import format_of, read
from sdm_deflect.meshing.formats.shapes import turned
from tests.deform.blocks import block_with_body
from tests.meshing.formats.alike import content, rows, tree
from tests.meshing.formats.examples import grid, hybrid, polyhedral
from tests.meshing.formats.fluent_files import LAYOUTS, PACKED, ZONES, plane_mesh, written


def sets(mesh: Mesh) -> dict[str, set]:
    return {p.name: {frozenset(row) for faces in p.faces for row in rows(faces)} for p in mesh.patches}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("stored", [{}, PACKED], ids=["plain", "packed"])
def test_a_mesh_is_read_from_either_layout(layout, stored, tmp_path):
    mesh = read(written(hybrid(), tmp_path / "wing.v2.msh.h5", layout, **stored))
    np.testing.assert_array_equal(mesh.points, hybrid().points)
    assert sets(mesh) == sets(hybrid())
    assert not inverted_of(mesh.points, mesh.cells[0]).any()
    usual = replace(mesh, cells=standard_cells(mesh))
    nodes = {(block.shape, frozenset(row)) for block in usual.cells for row in block.nodes.tolist()}
    assert nodes == {(block.shape, frozenset(row)) for block in hybrid().cells for row in block.nodes.tolist()}
    assert grid(usual).compute_cell_sizes()["Volume"].sum() == pytest.approx(
        grid(hybrid()).compute_cell_sizes()["Volume"].sum()
    )
    assert mesh.name == "wing.v2.msh.h5"


def test_what_a_file_holds_is_told(tmp_path):
    text = inspect(written(hybrid(), tmp_path / "a.msh.h5", "meshing"))
    assert "14 points, 7 cells" in text
    assert "7 polyhedra, 0 inverted" in text
    counts = re.findall(r"^  (\D+ \d+), \(.*\) to \(.*\)$", text, re.MULTILINE)
    assert counts == ["floor 3", "inlet 2", "outlet 2", "left wall 3", "right wall 3", "roof 5"]


def test_cells_keep_their_order(tmp_path):
    mesh = read(written(hybrid(), tmp_path / "a.cas.h5"))
    faces, cell = faces_by_cell(mesh.cells[0])
    found = [set() for _ in range(7)]
    for row, own in zip(rows(faces), cell.tolist(), strict=True):
        found[own] |= set(row)
    assert found == [set(row) for block in hybrid().cells for row in block.nodes.tolist()]


def test_patches_face_outwards_whichever_cell_normals_point_to(tmp_path):
    usual = read(written(hybrid(), tmp_path / "a.cas.h5"))
    path = written(hybrid(), tmp_path / "b.cas.h5")
    with h5py.File(path, "r+") as file:
        nodes = file["meshes/1/faces/nodes/1/nodes"]
        backward = turned(usual.cells[0].faces, np.zeros(len(usual.cells[0].faces), dtype=bool))
        nodes[...] = backward.nodes + 1
    other = read(path)
    assert [rows(p.faces[0]) for p in other.patches] == [rows(p.faces[0]) for p in usual.patches]
    assert not inverted_of(other.points, other.cells[0]).any()


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("real", ["<f8", ">f8", "<f4"])
@pytest.mark.parametrize("stored", [{}, PACKED], ids=["plain", "packed"])
def test_nothing_but_coordinates_changes(layout, real, stored, tmp_path):
    source, out = (tmp_path / name for name in ("a.msh.h5", "b.msh.h5"))
    written(hybrid(), source, layout, real, **stored)
    points = read(source).points
    moved = points.copy()
    moved[3] += 0.1
    Fluent().rewrite(source, moved, out)
    np.testing.assert_array_equal(read(out).points, moved.astype(real))
    before, after = tree(source), tree(out)
    names = {name for name in before if "nodes/coords/" in name}
    assert {name for name in before if before[name] != after[name]} <= names
    assert [before[name][0] for name in names] == [after[name][0] for name in names]
    assert list(before) == list(after)
    if not stored:
        old, new = (np.frombuffer(path.read_bytes(), np.uint8) for path in (source, out))
        assert 0 < np.count_nonzero(old != new) <= 3 * np.dtype(real).itemsize
    Fluent().rewrite(source, points, tmp_path / "same.msh.h5")
    assert (tmp_path / "same.msh.h5").read_bytes() == source.read_bytes()


def cells_of(path) -> pv.UnstructuredGrid:
    """What VTK's reader of Fluent's files sees."""
    library = pytest.importorskip("vtkmodules.vtkIOFLUENTCFF")
    from vtkmodules.vtkCommonCore import vtkObject

    vtkObject.GlobalWarningDisplayOff()  # there is no file with results beside it
    reader = library.vtkFLUENTCFFReader()
    reader.SetFileName(str(path))
    reader.Update()
    vtkObject.GlobalWarningDisplayOn()
    return pv.wrap(reader.GetOutput())[0]


@pytest.mark.parametrize("stored", [{}, PACKED], ids=["plain", "packed"])
@pytest.mark.parametrize("mesh", [hybrid(), polyhedral(hybrid())], ids=["shapes", "polyhedra"])
def test_vtk_sees_the_mesh_before_and_after(mesh, stored, tmp_path):
    source, out = (tmp_path / name for name in ("a.cas.h5", "b.cas.h5"))
    written(mesh, source, **stored)
    moved = mesh.points * [1.0, 2.0, 1.0]
    Fluent().rewrite(source, moved, out)
    before, after = cells_of(source), cells_of(out)
    np.testing.assert_array_equal(before.points, mesh.points.astype("f4"))  # all that VTK keeps
    np.testing.assert_array_equal(after.points, moved.astype("f4"))
    np.testing.assert_array_equal(after.celltypes, before.celltypes)
    np.testing.assert_array_equal(after.cells, before.cells)
    volumes = [abs(cells.compute_cell_sizes()["Volume"]) for cells in (before, after)]
    np.testing.assert_allclose(volumes[1], 2.0 * volumes[0], rtol=0.02)  # VTK cuts warped faces as they come
    own = abs(grid(hybrid()).compute_cell_sizes()["Volume"])
    np.testing.assert_allclose(volumes[0], own, rtol=0.05)


def test_a_deflection_is_that_of_the_same_cells_in_openfoam(tmp_path):
    mesh = block_with_body(6)
    source = written(mesh, tmp_path / "mesh.cas.h5", **PACKED)
    OpenFoam().write(mesh, tmp_path / "case")
    moved = []
    for path, out in ((source, "moved.cas.h5"), (tmp_path / "case", "moved")):
        result = sdm.deflect(path, "body", hinge=[(0, -1, 0), (0, 1, 0)], angle=5.0, fixed="*[+-]")
        result.save(tmp_path / out)
        moved.append(read(tmp_path / out).points)
    assert np.abs(moved[0] - mesh.points).max() > 0.01
    np.testing.assert_allclose(*moved, rtol=0.0, atol=1e-9)


def test_two_sided_walls_shadows_and_interfaces_are_patches(tmp_path):
    path = written(hybrid(), tmp_path / "a.cas.h5")
    with h5py.File(path, "r+") as file:
        zones = file[ZONES]
        zones["zoneType"][...] = [3, 8, 12, 24, 7, 2, 3]  # wall, shadow, periodic, interface, symmetry, interior, wall
    names = read(path).names
    assert names == ("interior-fluid", "floor", "inlet", "outlet", "left wall", "roof")
    assert len(read(path).patch("interior-fluid")) == 7


def test_zones_of_a_geometry_and_empty_ones_are_left_out(tmp_path):
    path = written(hybrid(), tmp_path / "a.msh.h5", "meshing")
    with h5py.File(path, "r+") as file:
        mesh, zones = file["meshes/1"], file[ZONES]
        count = int(mesh.attrs["faceCount"][0])
        mesh.attrs["faceCount"] = np.array([count + 1], "u8")
        for name, values in (("nodes/8/nnodes", [3]), ("nodes/8/nodes", [1, 2, 3]), ("c0/8", [0]), ("c1/8", [0])):
            mesh[f"faces/{name}"] = np.array(values, "i4")
        for name in ("nodes/8", "c0/8", "c1/8"):
            mesh[f"faces/{name}"].attrs["minId"] = mesh[f"faces/{name}"].attrs["maxId"] = np.array([count + 1], "u8")
        more = {"minId": [count + 1, 1], "maxId": [count + 1, 0], "zoneType": [3, 3], "id": [9, 8]}
        for name, values in more.items():
            old = zones[name][()]
            del zones[name]
            zones[name] = np.concatenate([old, values]).astype(old.dtype)
        names = zones["name"][0]
        del zones["name"]
        zones["name"] = np.array([names + b";cad;empty"])
    assert sets(read(path)) == sets(hybrid())


def test_zones_of_one_name_are_one_patch_and_one_without_has_its_number(tmp_path):
    path = written(hybrid(), tmp_path / "a.cas.h5")
    with h5py.File(path, "r+") as file:
        del file[ZONES]["name"]
        file[ZONES]["name"] = np.array([b"interior;wing;wing;;left;right;roof\0\0"])
    assert {p.name: len(p) for p in read(path).patches} == {
        "wing": 5, "zone-14": 2, "left": 3, "right": 3, "roof": 5,
    }  # fmt: skip


def test_names_of_files(tmp_path):
    one = Targets.of(tmp_path / "wing.v2.MSH.h5", None, (3.0,))
    assert one.mesh(3.0).name == "wing.v2-deflected.MSH.h5"
    several = Targets.of(tmp_path / "wing.cas.h5", None, (3.0, -12.5), True, True)
    assert [several.mesh(angle).name for angle in several.angles] == [
        "wing-deflected_+3.cas.h5", "wing-deflected_-12.5.cas.h5",
    ]  # fmt: skip
    assert folder_of(several.mesh(3.0)).name == "wing-deflected_+3-report"
    assert several.sensitivity(3.0)[0].name == "wing-deflected_+3-sensitivity.npz"
    with pytest.raises(MeshFileError, match=r"export it from the mesher"):
        format_of("wing.dat.h5")


def test_a_mesh_from_elsewhere_is_refused_before_anything_is_computed(tmp_path):
    with pytest.raises(MeshFileError, match=r"b\.msh\.h5: only a mesh of this format can be written in it"):
        Targets.of(tmp_path / "a.su2", tmp_path / "b.msh.h5", (3.0,))
    with pytest.raises(MeshFileError, match=r"b\.cas\.h5: only a mesh of this format"):
        Fluent().write(hybrid(), tmp_path / "b.cas.h5")
    assert Targets.of(tmp_path / "a.msh.h5", tmp_path / "b.MSH.h5", (3.0,)).out.name == "b.MSH.h5"
    with pytest.raises(InputError, match=r"b\.cas\.h5: is to be a copy of a file \.msh\.h5 and must have that suffix"):
        Targets.of(tmp_path / "a.msh.h5", tmp_path / "b.cas.h5", (3.0,))
    assert list(tmp_path.iterdir()) == []


def test_other_formats_take_the_mesh(tmp_path):
    source = written(hybrid(), tmp_path / "a.msh.h5", "meshing")
    format_of("b.vtu").write(read(source), tmp_path / "b.vtu")
    assert sets(read(tmp_path / "b.vtu")) == sets(hybrid())
    format_of("b.su2").write(read(source), tmp_path / "b.su2")
    assert sorted(content(read(tmp_path / "b.su2"))["cells"]) == ["hexahedron", "pyramid", "tetra", "wedge"]


def test_an_inner_patch_does_not_hide_the_others(tmp_path):
    mesh = hybrid()
    named = (Patch("all", tuple(faces for patch in mesh.patches for faces in patch.faces)),)
    assert len(read(written(replace(mesh, patches=named), tmp_path / "a.cas.h5")).patch("all")) == 18


@pytest.mark.parametrize("layout", LAYOUTS)
def test_plane_meshes(layout, tmp_path):
    source, out = tmp_path / "a.msh.h5", tmp_path / "b.msh.h5"
    mesh = read(written(plane_mesh(), source, layout))
    assert mesh.plane
    np.testing.assert_array_equal(mesh.points, plane_mesh().points)
    assert sets(mesh) == sets(plane_mesh())
    assert {b.shape: len(b) for b in mesh.cells} == {"triangle": 10, "quad": 19}
    wanted = {b.shape: [set(row) for row in b.nodes.tolist()] for b in plane_mesh().cells}
    assert {b.shape: [set(row) for row in b.nodes.tolist()] for b in mesh.cells} == wanted
    left = {pair for b in mesh.cells for row in b.nodes.tolist() for pair in zip(row, row[1:] + row[:1], strict=True)}
    assert {row for patch in mesh.patches for row in rows(patch.faces[0])} <= left
    result = sdm.deflect(source, "body", hinge=[(0, 0)], angle=8.0, fixed="far_field")
    result.save(out)
    moved = read(out)
    assert np.abs(moved.points - mesh.points)[mesh.on("body")].max() > 0.01
    assert not any(inverted_of(moved.points, block).any() for block in moved.cells)
    before, after = tree(source), tree(out)
    assert {name for name in before if before[name] != after[name]} <= {n for n in before if "nodes/coords/" in n}


def test_vtk_sees_a_plane_mesh(tmp_path):
    seen = cells_of(written(plane_mesh(), tmp_path / "a.cas.h5"))
    assert np.unique(seen.celltypes, return_counts=True)[1].tolist() == [10, 19]
    areas = seen.compute_cell_sizes()["Area"]
    assert areas.sum() == pytest.approx(4.0 - 0.16, rel=0.02)
