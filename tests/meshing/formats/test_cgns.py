"""CGNS files: a round trip loses nothing, a rewritten file differs in coordinates alone."""

import h5py
import numpy as np
import pytest

from sdm_deflect.meshing.formats.cgns import Cgns
from sdm_deflect.meshing.formats.cgns_hdf5 import create
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.faces import face_keys, node_keys
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.meshing.formats.alike import content, groups, replace_data, rows, tree, zone_of
from tests.meshing.formats.examples import hybrid, polyhedral

COORDINATES = ("CoordinateX", "CoordinateY", "CoordinateZ")


@pytest.fixture
def path(tmp_path):
    Cgns().write(hybrid(), tmp_path / "mesh.cgns")
    return tmp_path / "mesh.cgns"


@pytest.mark.parametrize("zones", [1, 2, 3])
def test_round_trip_loses_nothing(zones, tmp_path):
    mesh = hybrid(zones)
    assert Cgns().write(mesh, tmp_path / "mesh.cgns") == ()
    again = Cgns().read(tmp_path / "mesh.cgns")
    np.testing.assert_array_equal(again.points, mesh.points)
    expected = content(mesh)
    if zones == 1:
        expected["zones"] = [("Zone", 0, 14)]
    assert content(again) == expected
    assert [block.shape for block in again.cells] == [block.shape for block in mesh.cells]


@pytest.mark.parametrize("zones", [1, 2])
def test_rewriting_changes_coordinates_and_nothing_else(zones, tmp_path):
    mesh = hybrid(zones)
    source, out = tmp_path / "mesh.cgns", tmp_path / "moved.cgns"
    Cgns().write(mesh, source)
    with h5py.File(source, "r+") as file:  # what we do not read is kept
        zone = zone_of(file, mesh.zones[-1].name or "Zone")
        solution = create(zone, "Solution", "FlowSolution_t")
        create(solution, "Pressure", "DataArray_t", np.linspace(0.0, 1.0, 14))
        file.create_group("not CGNS")
    before, moved = tree(source), mesh.points.copy()
    moved[3:5] *= 2.0
    Cgns().rewrite(source, moved, out)
    assert tree(source) == before
    after = tree(out)
    assert list(after) == list(before)
    changed = {name for name in before if after[name] != before[name]}
    assert {name.rsplit("/")[-2] for name in changed} == set(COORDINATES)
    assert len(changed) == 3
    np.testing.assert_array_equal(Cgns().read(out).points, moved)


def test_single_precision_stays_single_and_points_that_did_not_move_keep_their_bits(path, tmp_path):
    with h5py.File(path, "r+") as file:
        for axis in COORDINATES:
            node = zone_of(file)["GridCoordinates"][axis]
            replace_data(node, node[" data"][()].astype(">f4"))
    points = Cgns().read(path).points.copy()
    points[2] += 1.0 / 3.0
    Cgns().rewrite(path, points, tmp_path / "moved.cgns")
    again = Cgns().read(tmp_path / "moved.cgns").points
    np.testing.assert_array_equal(np.delete(again, 2, axis=0), np.delete(points, 2, axis=0))
    np.testing.assert_array_equal(again[2], points[2].astype(np.float32))
    with h5py.File(tmp_path / "moved.cgns") as file:
        assert zone_of(file)["GridCoordinates/CoordinateX/ data"].dtype == np.dtype(">f4")


def test_patches_of_equal_names_in_two_zones_are_told_apart(tmp_path):
    mesh = hybrid(2)
    names = {"floor": "block 1/floor", "floor 2": "block 2/floor"}
    named = [Patch(names.get(patch.name, patch.name), patch.faces) for patch in mesh.patches]
    mesh = Mesh(mesh.points, mesh.cells, tuple(named), mesh.zones)
    assert Cgns().write(mesh, tmp_path / "mesh.cgns") == ()
    assert content(Cgns().read(tmp_path / "mesh.cgns")) == content(mesh)


def test_names_that_nodes_cannot_have_are_changed_and_said(tmp_path):
    mesh = hybrid()
    names = ["a/b", "a\0b", "x" * 33, "x" * 34, "Zone", "ü" * 17]
    patches = tuple(Patch(name, patch.faces) for name, patch in zip(names, mesh.patches, strict=True))
    lost = Cgns().write(Mesh(mesh.points, mesh.cells, patches), tmp_path / "mesh.cgns")
    again = [patch.name for patch in Cgns().read(tmp_path / "mesh.cgns").patches]
    assert again == ["a_b", "a_b 2", "x" * 32, "x" * 30 + " 2", "Zone 2", "ü" * 16]
    assert lost == tuple(f"patch {old} is named {new}" for old, new in zip(names, again, strict=True) if old != new)


def test_an_empty_patch_is_left_out_and_said(tmp_path):
    mesh = hybrid()
    lost = Cgns().write(Mesh(mesh.points, mesh.cells, (Patch("nothing", ()),)), tmp_path / "mesh.cgns")
    assert lost == ("patch nothing has no faces and is left out",)
    assert Cgns().read(tmp_path / "mesh.cgns").patches == ()


def test_families_say_what_a_patch_is(path):
    with h5py.File(path) as file:
        kinds = {name: node["FamilyBC/ data"][()].tobytes() for name, node in groups(file["Base"], "Family_t")}
    assert kinds == {
        "floor": b"BCWall", "inlet": b"BCInflow", "outlet": b"BCOutflow", "left wall": b"BCWall",
        "right wall": b"BCWall", "roof": b"BCWall",
    }  # fmt: skip


@pytest.mark.parametrize("place", ["PointList", "ElementRange", "ElementList", "CellCenter", "Vertex"])
def test_boundary_conditions_are_read_wherever_they_are_given(place, path):
    expected = content(Cgns().read(path))["patches"]
    with h5py.File(path, "r+") as file:
        zone = zone_of(file)
        for name, condition in groups(zone["ZoneBC"], "BC_t"):
            first, last = condition["PointRange/ data"][()].ravel()
            if place == "CellCenter":
                replace_data(condition["GridLocation"], np.frombuffer(b"CellCenter", dtype=np.int8))
                continue
            del condition["PointRange"], condition["GridLocation"]
            if place == "Vertex":
                nodes = np.unique([n for row in expected[name] for n in row]) + 1
                create(condition, "PointList", "IndexArray_t", nodes[:, None])
            elif place == "ElementRange":
                create(condition, place, "IndexRange_t", np.array([[first], [last]]))
            else:
                create(condition, place, "IndexArray_t", np.arange(first, last + 1)[:, None])
                if place == "PointList":
                    create(condition, "GridLocation", "GridLocation_t", "FaceCenter")
    found = content(Cgns().read(path))["patches"]
    assert {name: sorted(faces) for name, faces in found.items()} == {n: sorted(f) for n, f in expected.items()}


def test_a_condition_of_its_own_kind_keeps_its_name_and_families_gather(path):
    with h5py.File(path, "r+") as file:
        conditions = zone_of(file)["ZoneBC"]
        for name in ("left wall", "right wall"):
            replace_data(conditions[name]["FamilyName"], np.frombuffer(b"walls", dtype=np.int8))
        replace_data(conditions["roof"]["FamilyName"], np.frombuffer(b"walls", dtype=np.int8))
        replace_data(conditions["roof"], np.frombuffer(b"BCWallViscous", dtype=np.int8))
        create(file["Base"]["inlet"], "anything", "FamilyName_t", "physical group")
    mesh = Cgns().read(path)
    assert [patch.name for patch in mesh.patches] == ["floor", "physical group", "outlet", "walls", "roof"]
    assert len(mesh.patch("walls")) == 6


def test_sections_without_a_condition_are_patches_of_their_own_names(path):
    expected = content(Cgns().read(path))["patches"]
    with h5py.File(path, "r+") as file:
        del zone_of(file)["ZoneBC"]["outlet"]
        del zone_of(file)["ZoneBC"]["roof"]
    found = content(Cgns().read(path))["patches"]
    assert found["outlet"] == expected["outlet"]
    assert sorted(found["roof"] + found["roof triangle"]) == sorted(expected["roof"])


def test_conditions_on_cells_and_edges_are_no_patches(path):
    expected = content(Cgns().read(path))
    with h5py.File(path, "r+") as file:
        for name, where in (("cells", "CellCenter"), ("edges", "EdgeCenter")):
            condition = create(zone_of(file)["ZoneBC"], name, "BC_t", "BCGeneral")
            create(condition, "PointRange", "IndexRange_t", np.array([[1], [7]]))
            create(condition, "GridLocation", "GridLocation_t", where)
        section = create(zone_of(file), "edges", "Elements_t", np.array([3, 0]))
        create(section, "ElementRange", "IndexRange_t", np.array([26, 26]))
        create(section, "ElementConnectivity", "DataArray_t", np.array([1, 2]))
    assert content(Cgns().read(path)) == expected


@pytest.mark.parametrize("offsets", [True, False])
def test_mixed_sections_of_new_and_old_files_are_read(offsets, path):
    expected = content(Cgns().read(path))
    with h5py.File(path, "r+") as file:
        zone = zone_of(file)
        sections = sorted(groups(zone, "Elements_t"), key=lambda item: item[1]["ElementRange/ data"][0])
        stored, last = [[3, 1, 2]], 1
        for name, section in sections:
            kind, nodes = section[" data"][0], section["ElementConnectivity/ data"][()]
            size = len(nodes) // np.ptp(section["ElementRange/ data"][()] + [0, 1])
            stored += [[kind, *row] for row in nodes.reshape(-1, size).tolist()]
            del zone[name]
        for condition in zone["ZoneBC"].values():
            if isinstance(condition, h5py.Group):
                condition["PointRange/ data"][...] += 1  # an edge comes first
        last = len(stored)
        mixed = create(zone, "all", "Elements_t", np.array([20, 0]))
        create(mixed, "ElementRange", "IndexRange_t", np.array([1, last]))
        create(mixed, "ElementConnectivity", "DataArray_t", np.concatenate(stored))
        if offsets:
            ends = np.cumsum([0, *map(len, stored)])
            create(mixed, "ElementStartOffset", "DataArray_t", ends)
    found = content(Cgns().read(path))
    assert found["cells"] == expected["cells"]
    assert {n: sorted(f) for n, f in found["patches"].items()} == {n: sorted(f) for n, f in expected["patches"].items()}


def same_polyhedra(mesh: Mesh, other: Mesh) -> bool:
    (a,), (b,) = mesh.cells, other.cells
    return all(np.array_equal(x, y) for x, y in zip(pieces(a), pieces(b), strict=True))


def pieces(cells):
    return cells.faces.nodes, cells.faces.offsets, cells.owner, cells.neighbour


@pytest.mark.parametrize("version", ["as written", "without offsets", "by face", "first face turned"])
def test_polyhedra_make_the_round_trip(version, tmp_path):
    mesh, path = polyhedral(hybrid()), tmp_path / "mesh.cgns"
    assert Cgns().write(mesh, path) == ()
    with h5py.File(path, "r+") as file:
        zone = zone_of(file)
        if version == "without offsets":
            for name in ("faces", "cells"):
                offsets = zone[name]["ElementStartOffset/ data"][()]
                stored = np.split(zone[name]["ElementConnectivity/ data"][()], offsets[1:-1])
                replace_data(zone[name]["ElementConnectivity"], np.concatenate([[len(r), *r] for r in stored]))
                del zone[name]["ElementStartOffset"]
        elif version == "by face":
            (cells,) = mesh.cells
            right = np.zeros(len(cells.owner), dtype=np.int32)
            right[: len(cells.neighbour)] = cells.neighbour + 100
            create(
                zone["faces"], "ParentElements", "DataArray_t", np.stack([cells.owner.astype(np.int32) + 100, right])
            )
            del zone["cells"]
        elif version == "first face turned":
            nodes = zone["faces"]["ElementConnectivity/ data"]
            nodes[:4] = nodes[:4][::-1]
            signed = zone["cells"]["ElementConnectivity/ data"]
            values = signed[()]
            signed[...] = np.where(np.abs(values) == 1, -values, values)
    again = Cgns().read(path)
    if version == "first face turned":  # its owner is then the other cell
        keys = node_keys(14)
        assert np.array_equal(face_keys(again.cells[0].faces, keys), face_keys(mesh.cells[0].faces, keys))
        assert (again.cells[0].owner[0], again.cells[0].neighbour[0]) == (
            mesh.cells[0].neighbour[0], mesh.cells[0].owner[0],
        )  # fmt: skip
    else:
        assert same_polyhedra(again, mesh)
    for patch in mesh.patches:
        own = [frozenset(row) for faces in again.patch(patch.name).faces for row in rows(faces)]
        assert sorted(map(sorted, own)) == sorted(sorted(row) for faces in patch.faces for row in rows(faces))


def test_large_counts_take_eight_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr("sdm_deflect.meshing.formats.cgns_write.FITS", 10)
    Cgns().write(hybrid(), tmp_path / "mesh.cgns")
    with h5py.File(tmp_path / "mesh.cgns") as file:
        assert zone_of(file)["floor/ElementConnectivity/ data"].dtype == np.int64
    assert content(Cgns().read(tmp_path / "mesh.cgns"))["cells"] == content(hybrid())["cells"]


def test_shapes_beside_polyhedra_are_refused(tmp_path):
    mesh = polyhedral(hybrid())
    both = Mesh(mesh.points, (*mesh.cells, Cells("tetra", np.array([[0, 1, 2, 4]]))), ())
    with pytest.raises(RuntimeError, match="either one block of polyhedra or cells of simple shapes"):
        Cgns().write(both, tmp_path / "mesh.cgns")


def test_attributes_have_the_lengths_that_the_library_expects(path):
    with h5py.File(path) as file:
        for key, size in (("name", 33), ("label", 33), ("type", 3)):
            kind = file["Base"].attrs.get_id(key).get_type()
            assert (kind.get_size(), kind.get_strpad()) == (size, h5py.h5t.STR_NULLTERM)


@pytest.mark.parametrize(
    "how", [{"chunks": (5,)}, {"chunks": (14,), "compression": "gzip", "shuffle": True}, "compact"]
)
def test_packed_coordinates_stay_packed(how, path, tmp_path):
    with h5py.File(path, "r+") as file:
        for axis in COORDINATES:
            node = zone_of(file)["GridCoordinates"][axis]
            values = node[" data"][()]
            del node[" data"]
            if how == "compact":
                layout = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
                layout.set_layout(h5py.h5d.COMPACT)
                space = h5py.h5s.create_simple(values.shape)
                h5py.h5d.create(node.id, b" data", h5py.h5t.IEEE_F64LE, space, layout).write(space, space, values)
            else:
                node.create_dataset(" data", data=values, **how)
    points = Cgns().read(path).points * np.pi
    Cgns().rewrite(path, points, tmp_path / "moved.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "moved.cgns").points, points)
    with h5py.File(tmp_path / "moved.cgns") as file, h5py.File(path) as before:
        for one, other in zip(
            *(zone_of(of)["GridCoordinates/CoordinateX"].values() for of in (file, before)), strict=True
        ):
            assert (one.chunks, one.compression) == (other.chunks, other.compression)
