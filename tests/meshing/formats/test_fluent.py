"""Fluent's meshes in HDF5: both layouts, only coordinates change, VTK's reader sees what we moved."""

import re
from dataclasses import replace

import h5py
import numpy as np
import pytest
import pyvista as pv

import sdm_deflect as sdm
from sdm_deflect.cases.inspection import inspect
from sdm_deflect.cases.mesh_files import Targets
from sdm_deflect.cases.report.folder import folder_of
from sdm_deflect.deform.errors import InputError
from sdm_deflect.deform.mesh import Mesh, Patch
from sdm_deflect.deform.quality import inverted_of
from sdm_deflect.meshing.formats.fluent import Fluent
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.polyhedra import faces_by_cell, standard_cells
from sdm_deflect.meshing.formats.registry import format_of, read
from sdm_deflect.meshing.formats.shapes import turned
from tests.deform.blocks import block_with_body
from tests.meshing.formats.alike import content, rows, tree
from tests.meshing.formats.examples import grid, hybrid, polyhedral
from tests.meshing.formats.fluent_files import LAYOUTS, plane_mesh, written
from tests.meshing.formats.test_hostile import complaint

PACKED = {"compression": "gzip", "chunks": True}
COORDS = "meshes/1/nodes/coords/1"
ZONES = "meshes/1/faces/zoneTopology"


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
    assert "patches (faces): floor 3, inlet 2, outlet 2, left wall 3, right wall 3, roof 5" in text


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


def attribute(name, value, node="meshes/1"):
    return lambda file: file[node].attrs.__setitem__(name, value)


def data(name, values):
    def change(file):
        attributes = dict(file[name].attrs)
        del file[name]
        file[name] = values
        file[name].attrs.update(attributes)

    return change


def at(name, place, value):
    def change(file):
        file[name][place] = value

    return change


def without(name):
    return lambda file: file.__delitem__(name)


def linked(name, link):
    def change(file):
        del file[name]
        file[name] = link

    return change


def outside(file):
    del file[COORDS]
    file.create_dataset(COORDS, (14, 3), "f8", external=[("values.raw", 0, 336)])
    file[COORDS].attrs.update({"minId": np.array([1]), "maxId": np.array([14])})


def virtual(file):
    del file[COORDS]
    layout = h5py.VirtualLayout((14, 3), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "coords", (14, 3))
    file.create_virtual_dataset(COORDS, layout)
    file[COORDS].attrs.update({"minId": np.array([1]), "maxId": np.array([14])})


def surface_alone(file):
    for name in ("c0", "c1"):
        file[f"meshes/1/faces/{name}/1"][...] = 0


NODES, C0 = "meshes/1/faces/nodes/1", "meshes/1/faces/c0/1"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (attribute("dimension", 4), "has 4 dimensions, expected 2 or 3"),
        (attribute("dimension", 2), r"coords/1 holds \(14, 3\) numbers, expected \(14, 2\)"),
        (attribute("nodeCount", 15), "coords ends at number 14, expected 15"),
        (attribute("nodeCount", 2**62), r"coords ends at number 14, expected \d+; the file is truncated"),
        (attribute("nodeCount", 0), "nodeCount is 0"),
        (attribute("nodeCount", "many"), "has no number nodeCount"),
        (attribute("faceCount", 2**62), "faces/nodes ends at number 25"),
        (attribute("cellCount", 8), "cellCount is 8, but faces are of 7 cells"),
        (attribute("maxId", 15, COORDS), "coords ends at number 15, expected 14"),
        (attribute("minId", 2, COORDS), "coords goes on with 2 to 14 at number 1"),
        (attribute("maxId", 24, NODES), "faces/nodes ends at number 24"),
        (attribute("maxId", 24, C0), r"faces/c0/1 holds 25 numbers, expected 24"),
        (attribute("maxId", 2**63 - 1, C0), "faces/c0 ends at number 9223372036854775807, expected 25"),
        (data(COORDS, np.zeros((14, 2))), r"coords/1 holds \(14, 2\) numbers, expected \(14, 3\)"),
        (data(COORDS, np.zeros((14, 3), "i4")), "coords/1 holds no real numbers"),
        (data(COORDS, np.zeros((14, 3), "c16")), "coords/1 holds no real numbers"),
        (data(COORDS, h5py.Empty("f8")), "coords/1 holds no real numbers"),
        (at(COORDS, (3, 1), np.nan), "1 points are not finite"),
        (at(f"{NODES}/nnodes", 0, 5), r"has \d+ nodes of 25 faces, expected 25 faces of three nodes or more"),
        (at(f"{NODES}/nnodes", 0, -3), "expected 25 faces of three nodes"),
        (at(f"{NODES}/nodes", 0, 0), "nodes"),
        (at(f"{NODES}/nodes", 0, 15), "nodes"),
        (at(f"{NODES}/nodes", -1, 4_000_000_000), r"faces name nodes that are not among the 14 \(1 to 14\)"),
        (at(C0, 0, 4_000_000_000), "cells that 25 faces cannot bound"),
        (at(C0, 0, 8), "fewer than four faces"),
        (at(f"{ZONES}/maxId", 1, 26), "zone floor has the faces 8 to 26, but there are 25"),
        (at(f"{ZONES}/minId", 1, 0), "zone floor has the faces 0 to"),
        (data(f"{ZONES}/name", np.array([b"one;two"])), "has 7 first faces and 2 names"),
        (data(f"{ZONES}/name", 5.0), "name holds no names"),
        (data(f"{ZONES}/zoneType", np.zeros(3, "i4")), "has 7 first faces"),
        (without(f"{ZONES}/name"), "faces/zoneTopology/name is missing"),
        (without("meshes/1/faces/c1"), "faces/c1 is missing"),
        (without(COORDS), "coords ends at number 0, expected 14"),
        (without("meshes/1/faces"), "meshes/1/faces is missing"),
        (without("meshes"), "meshes/1 is missing"),
        (linked(COORDS, h5py.ExternalLink("other.h5", "/x")), "coords/1 is a link"),
        (linked("meshes/1/faces/c1", h5py.SoftLink("/meshes/1/faces/c0")), "faces/c1 is a link"),
        (linked(f"{NODES}/nodes", h5py.SoftLink("/settings/Version")), "nodes/1/nodes is a link"),
        (outside, "holds data of other files"), (virtual, "holds data of other files"),
        (lambda file: file.create_group("meshes/1/faces/interface/5"), "mesh interfaces .* delete them in Fluent"),
        (surface_alone, "there are no volume cells"),
        (lambda file: file.create_group("meshes/1/faces/tree/1"), "hanging nodes; convert them"),
        (lambda file: file.create_group("meshes/1/cells/tree/1"), "hanging nodes; convert them"),
    ],
)  # fmt: skip
def test_damaged_files(change, said, tmp_path):
    path = written(hybrid(), tmp_path / "a.cas.h5")
    with h5py.File(path, "r+") as file:
        change(file)
    assert re.search(said, complaint(Fluent(), path))


def test_files_that_are_no_such_mesh(tmp_path):
    path = tmp_path / "a.msh.h5"
    path.write_bytes(b"(0 comment)")
    assert "this is no file in HDF5" in complaint(Fluent(), path)
    (tmp_path / "b.msh").write_bytes(b' \n(0 "GAMBIT to Fluent File")\n(2 3)\n')
    assert "is a mesh of Fluent, not of Gmsh; write it as .msh.h5 in Fluent" in complaint(
        format_of("b.msh"), tmp_path / "b.msh"
    )
    data = written(hybrid(), path, **PACKED).read_bytes()
    for length in (0, 8, 96, 600, len(data) // 2, len(data) - 100):
        path.write_bytes(data[:length])
        assert complaint(Fluent(), path)


def test_a_dataset_that_claims_too_much(tmp_path):
    path = written(hybrid(), tmp_path / "a.cas.h5")
    with h5py.File(path, "r+") as file:
        del file[COORDS]
        large = file.create_dataset(COORDS, (10**9, 3), "f8", chunks=(1000, 3), compression="gzip")
        large.attrs.update({"minId": np.array([1]), "maxId": np.array([10**9])})
        file["meshes/1"].attrs["nodeCount"] = np.array([10**9])
    assert "would take 2.4e+04 MB of memory" in complaint(Fluent(), path)


def test_coordinates_beyond_single_precision_and_of_another_number(tmp_path):
    path = written(hybrid(), tmp_path / "a.msh.h5", real="f4")
    with pytest.raises(MeshFileError, match="42 coordinates are beyond single precision"):
        Fluent().rewrite(path, np.full((14, 3), 1e39), tmp_path / "b.msh.h5")
    with pytest.raises(MeshFileError, match="the file has 14 points, but"):
        Fluent().rewrite(path, np.zeros((13, 3)), tmp_path / "b.msh.h5")
    with h5py.File(written(hybrid(), tmp_path / "c.msh.h5", "meshing"), "r+") as file:
        del file["meshes/1/nodes/coords/1"]
        file["meshes/1/nodes/coords/1"] = file["meshes/1/nodes/coords/2"]
    assert "goes on with 1 to 7 at number 8" in complaint(Fluent(), tmp_path / "c.msh.h5")
    assert not (tmp_path / "b.msh.h5").exists()


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


def test_plane_cells_of_five_sides_and_torn_ones(tmp_path):
    path = written(plane_mesh(), tmp_path / "a.cas.h5")
    with h5py.File(path, "r+") as file:
        nodes = file["meshes/1/faces/nodes/1/nodes"][()]
        file["meshes/1/faces/nodes/1/nodes"][-1] = nodes[0]
    assert "plane cells do not close" in complaint(Fluent(), path)
    with h5py.File(path, "r+") as file:
        file["meshes/1/faces/c0/1"][-1] = 10
    assert "1 plane cells have more than four sides" in complaint(Fluent(), path)


def test_a_list_of_interfaces_may_be_empty(tmp_path):
    path = written(hybrid(), tmp_path / "a.cas.h5")
    with h5py.File(path, "r+") as file:
        group = file.create_group("meshes/1/faces/interface")
        group.attrs["nZones"] = np.array([0], "u8")
        group["nciTopology"] = np.empty(0, "u8")
    assert len(read(path).patches) == 6
