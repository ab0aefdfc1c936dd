"""Zones of CGNS files that fit: their points at one place are one, and what does not fit is said."""

import h5py
import numpy as np
import pytest

from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.meshing.formats.cgns import Cgns
from sdm_deflect.meshing.formats.cgns_hdf5 import create
from sdm_deflect.meshing.formats.cgns_nodes import AXES
from tests.meshing.formats.alike import content, replace_data
from tests.meshing.formats.blocks import Block, stored, two_blocks, write_blocks
from tests.meshing.formats.examples import grid, hybrid
from tests.meshing.formats.wing import boundary_faces


@pytest.mark.parametrize("orders", [((0, 1, 2), (0, 1, 2)), ((2, 0, 1), (-1, 2, 1)), ((1, -1, 2), (-3, -2, -1))])
def test_sides_without_condition_are_patches_and_interfaces_are_not(orders, tmp_path):
    blocks = [block.transposed(*order) for block, order in zip(two_blocks(), orders, strict=True)]
    write_blocks(tmp_path / "two.cgns", blocks)
    mesh = Cgns().read(tmp_path / "two.cgns")
    assert len(mesh.points) == 7 * 3 * 5
    assert sum(len(patch) for patch in mesh.patches) == len(boundary_faces(mesh.cells)["quad"])
    assert all(name.split("/")[-1] in {f"{a}{end}" for a in "ijk" for end in ("min", "max")} for name in mesh.names)
    assert len(mesh.zones) == 1


def test_interfaces_may_be_parts_of_sides_and_be_told_by_one_zone(tmp_path):
    """Copies of a point differ in their last digits: they are found by the interfaces alone."""
    left, right = two_blocks()
    noise = 1e-9 * np.sin(np.arange(right.points.size)).reshape(right.points.shape)
    near = Block("near", (right.points + noise)[:, :2], right.places[:, :2])
    far = Block("far", right.points[:, 1:], right.places[:, 1:])
    write_blocks(tmp_path / "three.cgns", [left, near, far], connect=False)
    with h5py.File(tmp_path / "three.cgns", "r+") as file:
        for zone, donor, own, other, turn in (
            ("left", "near", [(4, 1, 1), (4, 2, 5)], [(1, 1, 1), (1, 2, 5)], (1, 2, 3)),
            ("left", "/Base#1/far", [(4, 3, 1), (4, 2, 5)], [(1, 2, 1), (1, 1, 5)], (1, 2, 3)),
            ("far", "near", [(4, 1, 5), (1, 1, 1)], [(4, 2, 5), (1, 2, 1)], (1, 2, 3)),
        ):
            node = file["Base#1"][zone]
            group = node.get("ZoneGridConnectivity") or create(node, "ZoneGridConnectivity", "ZoneGridConnectivity_t")
            meets = create(group, f"to {donor[-4:].strip('/')}", "GridConnectivity1to1_t", donor)
            for name, values in (("PointRange", own), ("PointRangeDonor", other)):
                create(meets, name, "IndexRange_t", np.array(values, dtype=np.int32))
            create(meets, "Transform", '"int[IndexDimension]"', np.array(turn, dtype=np.int32))
    mesh = Cgns().read(tmp_path / "three.cgns")
    assert len(mesh.points) == 7 * 3 * 5
    assert sum(len(patch) for patch in mesh.patches) == len(boundary_faces(mesh.cells)["quad"])
    (zone,) = mesh.zones
    assert zone.blocks == ("left", "near", "far")


@pytest.mark.parametrize("connect", [True, False])
def test_blocks_that_do_not_meet_stay_apart(connect, tmp_path):
    """An interface between sides that lie elsewhere is periodic."""
    write_blocks(tmp_path / "two.cgns", two_blocks(gap=0.5), connect=connect)
    mesh = Cgns().read(tmp_path / "two.cgns")
    assert [(zone.name, zone.blocks) for zone in mesh.zones] == [("left", ()), ("right", ())]
    assert {"left/imax", "right/imin"} <= set(mesh.names)
    moved = mesh.points * 1.5
    Cgns().rewrite(tmp_path / "two.cgns", moved, tmp_path / "moved.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "moved.cgns").points, moved)


def test_sides_at_the_same_place_are_one_without_an_interface(tmp_path):
    write_blocks(tmp_path / "told.cgns", two_blocks())
    write_blocks(tmp_path / "two.cgns", two_blocks(), connect=False)
    told, found = (Cgns().read(tmp_path / f"{name}.cgns") for name in ("told", "two"))
    np.testing.assert_array_equal(found.points, told.points)
    assert content(found) == content(told)


def test_periodic_interfaces_are_patches_however_near(tmp_path):
    write_blocks(tmp_path / "near.cgns", two_blocks(gap=1e-7))
    assert len(Cgns().read(tmp_path / "near.cgns").zones) == 1
    with h5py.File(tmp_path / "near.cgns", "r+") as file:
        for zone in (file["Base#1/left"], file["Base#1/right"]):
            for node in zone["ZoneGridConnectivity"].values():
                if "Transform" in node:
                    create(create(node, "Property", "GridConnectivityProperty_t"), "Periodic", "Periodic_t")
    mesh = Cgns().read(tmp_path / "near.cgns")
    assert len(mesh.zones) == 2
    assert {"left/imax", "right/imin"} <= set(mesh.names)


def test_a_block_round_an_axis_has_prisms_there(tmp_path):
    """A pipe round the y-axis, whose first points outwards are one for all angles."""
    angle, radius, y = np.linspace(0.0, 2.0 * np.pi, 9), np.linspace(0.0, 1.0, 4), np.linspace(0.0, 1.0, 3)
    a, b, c = np.meshgrid(angle, y, radius, indexing="ij")
    points = np.stack([c * np.cos(a), b, c * np.sin(a)], axis=-1)
    points[-1] = points[0]
    axis = ("axis", None, "BCDegenerateLine", (1, 1, 1), (9, 3, 1), None)
    wall = ("wall", None, "BCWall", (1, 1, 4), (9, 3, 4), None)
    write_blocks(tmp_path / "pipe.cgns", [Block("pipe", points, np.arange(a.size).reshape(a.shape), [axis, wall])])
    mesh = Cgns().read(tmp_path / "pipe.cgns")
    assert {block.shape: len(block) for block in mesh.cells} == {"hexahedron": 8 * 2 * 2, "wedge": 8 * 2}
    assert len(mesh.points) == 3 * (1 + 8 * 3)
    assert sorted(mesh.names) == ["jmax", "jmin", "wall"]
    assert {faces.shape: len(faces) for faces in mesh.patch("jmin").faces} == {"quad": 16, "triangle": 8}
    assert sum(len(patch) for patch in mesh.patches) == sum(map(len, boundary_faces(mesh.cells).values()))
    volumes = grid(mesh).compute_cell_sizes()["Volume"]
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(4.0 * np.sin(np.pi / 4.0))
    moved = mesh.points * [1.0, 2.0, 3.0]
    Cgns().rewrite(tmp_path / "pipe.cgns", moved, tmp_path / "moved.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "moved.cgns").points, moved)


def test_a_block_that_meets_itself_is_closed(tmp_path):
    """An O-grid of one block: its first and last points round the body are the same."""
    angle, radius, y = np.linspace(0.0, 2.0 * np.pi, 13), np.linspace(1.0, 3.0, 4), np.linspace(0.0, 1.0, 3)
    a, b, c = np.meshgrid(angle, y, radius, indexing="ij")
    points = np.stack([c * np.cos(a), b, c * np.sin(a)], axis=-1)
    points[-1] = points[0]
    places = np.arange(a.size).reshape(a.shape)
    places[-1] = places[0]
    write_blocks(tmp_path / "ring.cgns", [Block("ring", points, places)])
    mesh = Cgns().read(tmp_path / "ring.cgns")
    assert len(mesh.points) == 12 * 3 * 4
    assert sorted(mesh.names) == ["jmax", "jmin", "kmax", "kmin"]
    assert grid(mesh).compute_cell_sizes()["Volume"].min() > 0.0


def test_copies_of_a_point_keep_their_bits_until_they_move(tmp_path):
    """In single precision beside double, copies differ in the last digits: those that move become one."""
    write_blocks(tmp_path / "two.cgns", two_blocks())
    with h5py.File(tmp_path / "two.cgns", "r+") as file:
        for axis in AXES:
            node = file["Base#1/right/GridCoordinates"][axis]
            replace_data(node, node[" data"][()].astype(np.float32))
    mesh = Cgns().read(tmp_path / "two.cgns")
    assert len(mesh.points) == 7 * 3 * 5
    moved = mesh.points.copy()
    shared = np.flatnonzero(np.abs(mesh.points[:, 0] - 3.0) < 0.5)
    moved[shared[0]] += 0.1
    Cgns().rewrite(tmp_path / "two.cgns", moved, tmp_path / "moved.cgns")
    before, after = stored(tmp_path / "two.cgns"), stored(tmp_path / "moved.cgns")
    changed = {name: np.flatnonzero((after[name] != before[name]).any(axis=1)) for name in before}
    assert [len(rows) for rows in changed.values()] == [1, 1]
    (left,), (right,) = (after[name][rows] for name, rows in changed.items())
    np.testing.assert_array_equal(left.astype(np.float32), right)


@pytest.mark.parametrize("how", ["points", "disorder", "cells", "faces", "abutting", "apart", "overset", "by cells"])
def test_a_block_meets_an_unstructured_zone(how, tmp_path):
    """The hexahedron of the hybrid mesh is made longer by a block on its inlet.

    The other zone's points may be listed in disorder, or in their place cells; zones that only touch may do so in all
    points, or not (`apart`); in the hybrid files of Pointwise they name the cells on either side (`by cells`).
    """
    mesh = hybrid()
    Cgns().write(mesh, tmp_path / "mesh.cgns")
    inlet = np.array([[0, 4], [3, 7]])  # along y, along z
    own = np.stack([mesh.points[inlet] - [x, 0.0, 0.0] for x in (2.0, 1.0, 0.0)])
    own[2, 1, 1] += [0.0, 0.0, 0.1 if how == "apart" else 0.0]
    write_blocks(tmp_path / "block.cgns", [Block("block", own, np.arange(12).reshape(3, 2, 2))])
    with h5py.File(tmp_path / "mesh.cgns", "r+") as file, h5py.File(tmp_path / "block.cgns") as other:
        other.copy("Base#1/block", file["Base"])
        donors = {"disorder": [8, 1, 5, 4], "cells": [99]}.get(how, [1, 4, 5, 8])
        connect(file["Base/block"], "Zone", how, np.array([[3, j, k] for k in (1, 2) for j in (1, 2)]), donors)
        first = int(file["Base/Zone/inlet/ElementRange/ data"][0])
        faces = how == "faces"
        connect(file["Base/Zone"], "block", how, np.array([[first]] if faces else [[1], [4], [5], [8]]), [1])
    both = Cgns().read(tmp_path / "mesh.cgns")
    if how == "overset":
        assert [zone.name for zone in both.zones] == ["block", "Zone"] or [zone.name for zone in both.zones] == [
            "Zone",
            "block",
        ]
        return
    (zone,) = both.zones
    assert sorted(zone.blocks) == ["Zone", "block"]
    assert both.notes == ()
    assert len(both.points) == 14 + (12 if how == "apart" else 8)
    faces = sorted(map(sorted, (row for shape in boundary_faces(both.cells).values() for row in shape.tolist())))
    held = sorted(sorted(row.tolist()) for patch in both.patches for block in patch.faces for row in block.nodes)
    if how == "apart":  # the two faces that touch are on no patch
        assert len(held) == len(faces) - 2
    else:
        assert held == faces
    Cgns().rewrite(tmp_path / "mesh.cgns", both.points * 2.0, tmp_path / "moved.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "moved.cgns").points, both.points * 2.0)


def connect(zone, donor, how, own, partners):
    group = create(zone, "ZoneGridConnectivity", "ZoneGridConnectivity_t")
    node = create(group, "meets", "GridConnectivity_t", donor)
    kind = {"overset": "Overset"}.get(how, "Abutting" if how in ("abutting", "apart", "by cells") else "Abutting1to1")
    create(node, "GridConnectivityType", "GridConnectivityType_t", kind)
    block = own.shape[1] == 3
    if how == "by cells":
        create(node, "GridLocation", "GridLocation_t", "CellCenter")
        if block:
            create(node, "PointRange", "IndexRange_t", np.array([[2, 1, 1], [2, 1, 1]], dtype=np.int32))
            create(node, "PointListDonor", "IndexArray_t", np.array([[1]], dtype=np.int32))
        else:
            create(node, "PointList", "IndexArray_t", np.array([[1]], dtype=np.int32))
            create(node, "PointRangeDonor", "UserDefinedData_t")
        return
    if how == "faces" and block:
        own = np.array([[3, 1, 1]])
    create(node, "PointList", "IndexArray_t", own.astype(np.int32))
    if how == "faces":
        create(node, "GridLocation", "GridLocation_t", "IFaceCenter" if block else "FaceCenter")
    elif block:
        create(node, "PointListDonor", "IndexArray_t", np.array(partners, dtype=np.int32)[:, None])


DAMAGE = {
    "size": (lambda z: replace_data(z, np.array([4, 3, 5], dtype=np.int32)), "its size [4, 3, 5] does not fit 3 axes"),
    "flat": (lambda z: replace_data(z, np.array([[4, 3, 1], [3, 2, 0], [0, 0, 0]])), "4 x 3 x 1 points hold no cells"),
    "larger": (lambda z: replace_data(z, np.array([[4, 3, 6], [3, 2, 5], [0, 0, 0]])), "CoordinateX holds (5, 3, 4)"),
    "huge": (lambda z: replace_data(z, np.full((3, 3), 2**40)), "CoordinateX holds (5, 3, 4)"),
    "rind": (
        lambda z: create(z["GridCoordinates"], "Rind", "Rind_t", np.array([1, 1, 0, 0, 0, 0])), "have rind planes",
    ),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_named(damage, tmp_path):
    left, right = two_blocks()
    left.conditions.append(("a", "wall", "BCWall", (1, 1, 1), (1, 3, 5), None))
    write_blocks(tmp_path / "two.cgns", [left, right])
    change, message = DAMAGE[damage]
    with h5py.File(tmp_path / "two.cgns", "r+") as file:
        change(file["Base#1/left"])
    with pytest.raises(MeshFileError) as caught:
        Cgns().read(tmp_path / "two.cgns")
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"{tmp_path / 'two.cgns'}: zone left: ")


FAULTS = {
    "condition": (
        lambda z: replace_data(z["ZoneBC/a/PointRange"], np.array([[4, 1, 1], [4, 3, 9]])),
        "boundary condition a: it is on the points (4, 1, 1) to (4, 3, 9) of a block of 4 x 3 x 5",
    ),
    "short condition": (
        lambda z: replace_data(z["ZoneBC/a/PointRange"], np.array([4, 1])), "has 2 numbers, expected 6",
    ),
    "volume": (
        lambda z: replace_data(z["ZoneBC/a/PointRange"], np.array([[1, 1, 1], [4, 3, 5]])), "is no face of the block",
    ),
    "nowhere": (lambda z: z["ZoneBC/a"].__delitem__("PointRange"), "boundary condition a: it does not say where it is"),
    "donor": (
        lambda z: replace_data(z["ZoneGridConnectivity/SF0"], np.frombuffer(b"none", np.int8)),
        "interface SF0: it leads to the zone 'none', which the file does not have",
    ),
    "transform": (
        lambda z: replace_data(z["ZoneGridConnectivity/SF0/Transform"], np.array([1, 1, 3])),
        "does not name every axis",
    ),
    "donor's range": (
        lambda z: replace_data(z["ZoneGridConnectivity/SF0/PointRangeDonor"], np.array([[1, 3, 1], [1, 3, 5]])),
        "it lies on points beyond the 4 x 3 x 5 of the other block",
    ),
    "interface": (
        lambda z: replace_data(z["ZoneGridConnectivity/SF0/PointRange"], np.array([[1, 1, 1], [4, 3, 5]])),
        "interface SF0: its range is no face",
    ),
    "interface nowhere": (
        lambda z: z["ZoneGridConnectivity/SF0"].__delitem__("PointRange"), "interface SF0: it does not say where it is",
    ),
    "empty interface": (
        lambda z: replace_data(z["ZoneGridConnectivity/SF0/PointRange"], np.array([[4, 1, 0], [4, 3, -1]])),
        "interface SF0: its range (4, 1, 0) to (4, 3, -1) holds nothing",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_one_condition_or_interface_is_a_note(fault, tmp_path):
    left, right = two_blocks()
    left.conditions.append(("a", None, "BCWall", (1, 1, 1), (1, 3, 5), None))
    write_blocks(tmp_path / "two.cgns", [left, right])
    before = Cgns().read(tmp_path / "two.cgns")
    change, message = FAULTS[fault]
    with h5py.File(tmp_path / "two.cgns", "r+") as file:
        change(file["Base#1/left"])
    mesh = Cgns().read(tmp_path / "two.cgns")
    (note,) = mesh.notes
    assert message in note
    assert sum(map(len, mesh.patches)) == sum(map(len, before.patches))
    np.testing.assert_array_equal(mesh.points, before.points)
    if "boundary condition" in note:
        assert note.startswith("patch left/a is absent: zone left: boundary condition a: ")
        assert "a" not in mesh.names
        with pytest.raises(InputError, match="fixed 'a' cannot be taken: patch left/a is absent"):
            mesh.expand(["a"], "fixed")
    else:
        assert note.startswith("zone left: interface SF0: ")
        assert mesh.names == before.names


def test_a_family_that_lacks_faces_in_one_zone_is_absent_in_all(tmp_path):
    left, right = two_blocks()
    for block, end in ((left, 3), (right, 9)):
        block.conditions.append(("a", "wall", "BCWall", (1, 1, 1), (4, end, 1), None))
    left.conditions.append(("e", "wall", "BCWall", (1, 3, 0), (4, 3, -1), None))
    right.conditions.append(("b", "wall", "BCWall", (1, 1, 5), (4, 3, 5), None))
    write_blocks(tmp_path / "two.cgns", [left, right])
    mesh = Cgns().read(tmp_path / "two.cgns")
    assert len(mesh.patch("part of wall")) == 12
    assert "wall" not in mesh.names
    assert [note.partition(": ")[0] for note in mesh.notes] == ["patch wall is absent", "zone left"]
    assert "(1, 1, 1) to (4, 9, 1)" in mesh.notes[0]
    assert mesh.notes[1].endswith("boundary condition e: its range (1, 3, 0) to (4, 3, -1) holds nothing")
    with pytest.raises(InputError, match=r"the surface 'wall' cannot be taken"):
        mesh.expand(["wall"], "the surface")
