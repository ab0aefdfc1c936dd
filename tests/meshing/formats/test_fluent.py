"""Fluent's meshes in HDF5: both layouts, only coordinates change, VTK's reader sees what we moved."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

import sdm_deflect as sdm
from sdm_deflect.meshing.formats.fluent import Fluent
from sdm_deflect.meshing.formats.polyhedra import faces_by_cell, standard_cells
from sdm_deflect.meshing.formats.registry import read
from sdm_deflect.meshing.formats.shapes import turn_faces
from sdm_deflect.meshing.mesh.cells import Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import inverted_of
from tests.extras import Library, loaded
from tests.meshing.formats.alike import rows, tree
from tests.meshing.formats.examples import grid, hybrid, polyhedral
from tests.meshing.formats.fluent_files import LAYOUTS, PACKED, ZONES, plane_mesh, written

pv = Library("pyvista")


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
        backward = turn_faces(usual.cells[0].faces, np.zeros(len(usual.cells[0].faces), dtype=bool))
        nodes[...] = backward.nodes + 1
    other = read(path)
    assert [rows(p.faces[0]) for p in other.patches] == [rows(p.faces[0]) for p in usual.patches]
    assert not inverted_of(other.points, other.cells[0]).any()


def cells_of(path):
    """What VTK's reader of Fluent's files sees."""
    library = loaded("vtkmodules.vtkIOFLUENTCFF")
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
