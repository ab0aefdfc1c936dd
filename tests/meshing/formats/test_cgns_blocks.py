"""Structured zones of CGNS files: read in the order of the file, put together where they fit, and deflected as one."""

import shutil
import subprocess
from contextlib import suppress

import h5py
import numpy as np
import pytest
import pyvista as pv
from vtkmodules.vtkIOCGNSReader import vtkCGNSReader

import sdm_deflect
from sdm_deflect.cases.inspection import inspect, inspected
from sdm_deflect.meshing.formats import adf
from sdm_deflect.meshing.formats.cgns import Cgns
from sdm_deflect.meshing.formats.cgns_nodes import create
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.su2 import Su2
from tests.meshing.formats.adf_files import in_adf
from tests.meshing.formats.alike import content, replace_data
from tests.meshing.formats.blocks import FLAP, HINGE, Block, cube, two_blocks, wing_blocks, write_blocks
from tests.meshing.formats.examples import grid, hybrid, polyhedral
from tests.meshing.formats.wing import boundary_faces

needs_tools = pytest.mark.skipif(shutil.which("cgnscheck") is None, reason="Debian's package cgns-convert is not here")
AXES = ("CoordinateX", "CoordinateY", "CoordinateZ")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("wing") / "wing.cgns"
    write_blocks(path, wing_blocks(6))
    return path


def converted(option, source, out):
    subprocess.run(["cgnsconvert", option, source, out], capture_output=True, check=True)
    return out


def stored(path):
    """Coordinates (K, 3) of each zone, in the file's order."""
    with h5py.File(path) as file:
        zones = [node for node in file["Base#1"].values() if "GridCoordinates" in node]
        return {
            zone.name: np.stack([zone["GridCoordinates"][axis][" data"][()].ravel() for axis in AXES], axis=1)
            for zone in zones
        }


def complaints(path):
    done = subprocess.run(["cgnscheck", "-v", path], capture_output=True, text=True, check=True)
    assert "checking complete" in done.stdout
    known = ("WARNING:dataclass not given", "WARNING:use [IJK]FaceCenter with Structured grids")
    lines = [line for line in done.stdout.splitlines() if line.startswith(("ERROR", "WARNING"))]
    return [line for line in lines if line not in known]


def deflected(source, out=None):
    hinge = [[HINGE, FLAP[0], 0.0], [HINGE, FLAP[1], 0.0]]
    slide = {"root": "plane", "end": "plane"}
    result = sdm_deflect.deflect(source, "flap", hinge, -20.0, motion="blended", fixed="wing", slide=slide)
    if out:
        result.save(out)
    return result


@needs_tools
@pytest.mark.parametrize("kind", ["HDF5", "ADF"])
def test_a_flap_in_blocks_turns_and_the_blocks_still_fit(kind, made, tmp_path):
    source, out = made, tmp_path / "turned.cgns"
    assert complaints(made) == []
    if kind == "ADF":
        source = converted("-a", made, tmp_path / "adf.cgns")
    result = deflected(source, out)
    assert result.passed
    assert {check.name: check.value for check in result.checks}["inverted_cells"] == 0
    assert (
        sum(q["inverted"] for q in sdm_deflect.quality(out)["quality"]) == 0
        if hasattr(sdm_deflect, "quality")
        else True
    )
    assert complaints(out) == []
    differing = subprocess.run(
        ["cgnsdiff", "-d", "-f", source, out], capture_output=True, text=True, check=False
    ).stdout
    assert differing
    assert all("GridCoordinates/Coordinate" in line and "data values differ" in line for line in differing.splitlines())
    plain = out if kind == "HDF5" else converted("-h", out, tmp_path / "plain.cgns")
    before, after = (np.concatenate(list(stored(path).values())) for path in (made, plain))
    assert np.abs(after - before).max() > 0.05
    _, place = np.unique(before, axis=0, return_inverse=True)
    _, first = np.unique(place, return_index=True)
    assert len(first) < len(before)
    np.testing.assert_array_equal(after, after[first][place.ravel()])


def test_the_deflection_is_that_of_the_same_mesh_in_su2(made, tmp_path):
    mesh = Cgns().read(made)
    assert Su2().write(mesh, tmp_path / "wing.su2") == ()
    same = Su2().read(tmp_path / "wing.su2")
    np.testing.assert_array_equal(same.points, mesh.points)
    assert content(same)["cells"] == content(mesh)["cells"]
    np.testing.assert_array_equal(deflected(made).points, deflected(tmp_path / "wing.su2").points)


def test_blocks_become_one_mesh_in_the_order_of_the_file(made):
    mesh, blocks = Cgns().read(made), wing_blocks(6)
    own = np.concatenate(list(stored(made).values()))
    _, first = np.unique(own, axis=0, return_index=True)
    np.testing.assert_array_equal(mesh.points, own[np.sort(first)])
    (zone,) = mesh.zones
    assert (zone.name, zone.blocks) == ("upper-0", tuple(block.name for block in blocks))
    (cells,) = mesh.cells
    assert cells.shape == "hexahedron"
    assert len(cells) == sum(np.prod(np.array(block.places.shape) - 1) for block in blocks)
    centres = [middle(block.points.astype(float)) for block in blocks]
    np.testing.assert_allclose(mesh.points[cells.nodes].mean(axis=1), np.concatenate(centres), atol=1e-12)
    assert grid(mesh).compute_cell_sizes()["Volume"].min() > 0.0


def test_zones_that_fit_are_listed_and_each_may_be_named(made):
    assert "9 zones of the file fit together: upper-0, upper-1, upper-2, lower-0" in inspect(made)
    assert inspected(made)["blocks"] == {"upper-0": [block.name for block in wing_blocks(6)]}
    settings = {"motion": "blended", "fixed": "wing", "slide": {"root": "plane", "end": "plane"}}
    hinge = [[HINGE, FLAP[0], 0.0], [HINGE, FLAP[1], 0.0]]
    assert sdm_deflect.deflect(made, "flap", hinge, 1.0, zones=["lower-2"], **settings).passed
    with pytest.raises(sdm_deflect.InputError, match="'lower' is no zone; the zones are upper-0, upper-1"):
        sdm_deflect.deflect(made, "flap", hinge, 1.0, zones=["lower"], **settings)


def middle(points):
    """Centres of the cells, the first axis fastest."""
    for axis in range(3):
        points = (
            np.take(points, range(1, points.shape[axis]), axis) + np.take(points, range(points.shape[axis] - 1), axis)
        ) / 2
    return points.reshape(-1, 3, order="F") if points.ndim == 2 else points.transpose(2, 1, 0, 3).reshape(-1, 3)


def test_patches_are_families_and_cover_the_boundary_outwards(made):
    mesh = Cgns().read(made)
    assert set(mesh.names) == {"wing", "flap", "far", "root", "end"}
    faces = np.concatenate([faces.nodes for patch in mesh.patches for faces in patch.faces])
    outside = boundary_faces(mesh.cells)["quad"]
    assert sorted(map(sorted, faces.tolist())) == sorted(map(sorted, outside.tolist()))
    a, b, c, d = mesh.points[faces].transpose(1, 0, 2)
    np.testing.assert_allclose(np.cross(c - a, d - b).sum(axis=0), 0.0, atol=1e-12)
    far = mesh.patch("far").faces[0].nodes
    a, b, c, d = mesh.points[far].transpose(1, 0, 2)
    assert np.all(np.einsum("ij,ij->i", np.cross(c - a, d - b), (a + c) / 2 - [0.5, 0.0, 0.0]) > 0.0)
    flap = mesh.points[mesh.on("flap")]
    np.testing.assert_allclose([flap[:, 0].min(), *np.sort(flap[:, 1])[[0, -1]]], [HINGE, *FLAP])


def test_vtk_reads_the_same_points(made):
    reader = vtkCGNSReader()
    reader.SetFileName(str(made))
    reader.UpdateInformation()
    reader.EnableAllBases()
    reader.Update()
    read = pv.wrap(reader.GetOutput())["Base#1"]
    own = stored(made)
    for i, points in enumerate(own.values()):
        np.testing.assert_array_equal(read[i].points, points)


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


@pytest.mark.parametrize(("at_one_point", "shape"), [((4, 5, 6, 7), "pyramid"), ((2, 3), "hexahedron")])
def test_a_collapsed_cell_is_what_it_is(at_one_point, shape, tmp_path):
    order = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    points = np.array(order, dtype=float)
    points[list(at_one_point)] = points[list(at_one_point)].mean(axis=0)
    own = np.empty((2, 2, 2, 3))
    for corner, place in zip(order, points, strict=True):
        own[corner] = place
    write_blocks(tmp_path / "one.cgns", [Block("one", own, np.arange(8).reshape(2, 2, 2))])
    mesh = Cgns().read(tmp_path / "one.cgns")
    assert [block.shape for block in mesh.cells] == [shape]
    assert grid(mesh).compute_cell_sizes()["Volume"][0] > 0.0


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


def with_condition(path, *data, where=None, block=None):
    """Faces of the patch that one condition on a block of 4 x 3 x 5 points is."""
    write_blocks(path, [block or cube()])
    with h5py.File(path, "r+") as file:
        node = create(file["Base#1/block/ZoneBC"], "one", "BC_t", "BCWall")
        create(node, *data)
        if where:
            create(node, "GridLocation", "GridLocation_t", where)
    mesh = Cgns().read(path)
    return mesh, [faces.nodes for faces in mesh.patch("one").faces] if "one" in mesh.names else []


RANGES = {
    "points": ("PointRange", [(4, 1, 1), (4, 3, 5)], None),
    "points backward": ("PointRange", [(4, 3, 1), (4, 1, 5)], "Vertex"),
    "faces along i": ("PointRange", [(4, 1, 1), (4, 2, 4)], "IFaceCenter"),
    "faces": ("PointRange", [(4, 1, 1), (4, 2, 4)], "FaceCenter"),
    "faces told by points": ("PointRange", [(4, 1, 1), (4, 3, 5)], "FaceCenter"),
    "cells": ("PointRange", [(3, 1, 1), (3, 2, 4)], "CellCenter"),
    "list of points": ("PointList", [(4, j, k) for k in range(1, 6) for j in range(1, 4)], None),
    "list of faces": ("PointList", [(4, j, k) for k in range(1, 5) for j in range(1, 3)], "IFaceCenter"),
    "list of unnamed faces": ("PointList", [(4, j, k) for k in range(1, 5) for j in range(1, 3)], "FaceCenter"),
}


@pytest.mark.parametrize("given", RANGES)
def test_conditions_are_read_however_they_are_given(given, tmp_path):
    place, indices, where = RANGES[given]
    label = "IndexRange_t" if place == "PointRange" else "IndexArray_t"
    mesh, faces = with_condition(tmp_path / "a.cgns", place, label, np.array(indices, dtype=np.int32), where=where)
    (own,) = faces
    assert len(own) == 2 * 4
    assert mesh.points[own][..., 0].min() > 2.9
    assert "imax" not in mesh.names
    normals = np.cross(mesh.points[own[:, 2]] - mesh.points[own[:, 0]], mesh.points[own[:, 3]] - mesh.points[own[:, 1]])
    assert normals[:, 0].min() > 0.0


def test_a_part_of_a_side_leaves_the_rest_and_lines_are_no_faces(tmp_path):
    part = np.array([(4, 1, 2), (4, 2, 4)], dtype=np.int32)
    mesh, (own,) = with_condition(tmp_path / "a.cgns", "PointRange", "IndexRange_t", part)
    assert (len(own), len(mesh.patch("imax"))) == (2, 6)
    line = np.array([(4, 1, 2), (4, 1, 4)], dtype=np.int32)
    assert with_condition(tmp_path / "b.cgns", "PointRange", "IndexRange_t", line)[1] == []


def test_a_face_within_a_block_is_no_side(tmp_path):
    sheet = np.array([(2, 1, 1), (2, 3, 5)], dtype=np.int32)
    mesh, (own,) = with_condition(tmp_path / "a.cgns", "PointRange", "IndexRange_t", sheet)
    assert len(own) == 8
    assert len(mesh.patch("imin")) == len(mesh.patch("imax")) == 8


@pytest.mark.parametrize("how", ["points", "faces", "abutting", "overset"])
def test_a_block_meets_an_unstructured_zone(how, tmp_path):
    """The hexahedron of the hybrid mesh is made longer by a block on its inlet."""
    mesh = hybrid()
    Cgns().write(mesh, tmp_path / "mesh.cgns")
    inlet = np.array([[0, 4], [3, 7]])  # along y, along z
    own = np.stack([mesh.points[inlet] - [1.0, 0.0, 0.0], mesh.points[inlet]])
    write_blocks(tmp_path / "block.cgns", [Block("block", own, np.arange(8).reshape(2, 2, 2))])
    with h5py.File(tmp_path / "mesh.cgns", "r+") as file, h5py.File(tmp_path / "block.cgns") as other:
        other.copy("Base#1/block", file["Base"])
        connect(file["Base/block"], "Zone", how, np.array([[2, j, k] for k in (1, 2) for j in (1, 2)]), [1, 4, 5, 8])
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
    assert len(both.points) == 14 + (8 if how == "abutting" else 4)
    faces = sorted(map(sorted, (row for shape in boundary_faces(both.cells).values() for row in shape.tolist())))
    held = sorted(sorted(row.tolist()) for patch in both.patches for block in patch.faces for row in block.nodes)
    if how == "abutting":  # the two faces that touch are on no patch
        assert len(held) == len(faces) - 2
    else:
        assert held == faces
    Cgns().rewrite(tmp_path / "mesh.cgns", both.points * 2.0, tmp_path / "moved.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "moved.cgns").points, both.points * 2.0)


def connect(zone, donor, how, own, partners):
    group = create(zone, "ZoneGridConnectivity", "ZoneGridConnectivity_t")
    node = create(group, "meets", "GridConnectivity_t", donor)
    kind = {"abutting": "Abutting", "overset": "Overset"}.get(how, "Abutting1to1")
    create(node, "GridConnectivityType", "GridConnectivityType_t", kind)
    if how == "faces" and own.shape[1] == 3:
        own = np.array([[2, 1, 1]])
    create(node, "PointList", "IndexArray_t", own.astype(np.int32))
    if how == "faces":
        create(node, "GridLocation", "GridLocation_t", "IFaceCenter" if own.shape[1] == 3 else "FaceCenter")
    elif own.shape[1] == 3:
        create(node, "PointListDonor", "IndexArray_t", np.array(partners, dtype=np.int32)[:, None])


DAMAGE = {
    "size": (lambda z: replace_data(z, np.array([4, 3, 5], dtype=np.int32)), "its size [4, 3, 5] is none of 3 axes"),
    "flat": (lambda z: replace_data(z, np.array([[4, 3, 1], [3, 2, 0], [0, 0, 0]])), "4 x 3 x 1 points hold no cells"),
    "larger": (lambda z: replace_data(z, np.array([[4, 3, 6], [3, 2, 5], [0, 0, 0]])), "CoordinateX holds (5, 3, 4)"),
    "huge": (lambda z: replace_data(z, np.full((3, 3), 2**40)), "CoordinateX holds (5, 3, 4)"),
    "rind": (
        lambda z: create(z["GridCoordinates"], "Rind", "Rind_t", np.array([1, 1, 0, 0, 0, 0])), "have rind planes",
    ),
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
    "nowhere": (lambda z: z["ZoneBC/a"].__delitem__("PointRange"), "a says not where it is on the block"),
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


def plane_blocks():
    """Two plane blocks round half a body each, which meet in two lines."""
    radius = np.linspace(1.0, 3.0, 5)
    found = []
    for name, begin in (("upper", 0.0), ("lower", np.pi)):
        a, r = np.meshgrid(begin + np.linspace(0.0, np.pi, 9), radius, indexing="ij")
        points = np.stack([r * np.cos(a), r * np.sin(a)], axis=-1)
        conditions = [("w", "wall", "BCWall", (1, 1), (9, 1), None), ("f", "far", "BCFarfield", (1, 5), (9, 5), None)]
        found.append(Block(name, points, np.arange(45).reshape(9, 5) + (100 if begin else 0), conditions))
    upper, lower = found
    lower.points[0], lower.points[-1] = upper.points[-1], upper.points[0]
    lower.places[0], lower.places[-1] = upper.places[-1], upper.places[0]
    return found


@pytest.mark.parametrize("order", [(0, 1), (1, 0), (-1, 1)])
def test_plane_blocks_are_quads_with_lines_around_them(order, tmp_path):
    blocks = [block.transposed(*order) if i else block for i, block in enumerate(plane_blocks())]
    write_blocks(tmp_path / "plane.cgns", blocks, dimension=2)
    mesh = Cgns().read(tmp_path / "plane.cgns")
    assert mesh.plane
    assert len(mesh.points) == 16 * 5
    assert {patch.name: len(patch) for patch in mesh.patches} == {"wall": 16, "far": 16}
    a, b, c, d = mesh.points[mesh.cells[0].nodes].transpose(1, 0, 2)
    assert np.cross(c - a, d - b)[:, 2].min() > 0.0
    for name, way in (("far", 1.0), ("wall", -1.0)):  # the flow is on the left of each line
        a, b = mesh.points[mesh.patch(name).faces[0].nodes].transpose(1, 0, 2)
        assert (way * np.cross(a, b - a)[:, 2]).min() > 0.0
    Cgns().rewrite(tmp_path / "plane.cgns", mesh.points * 2.0, tmp_path / "moved.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "moved.cgns").points, mesh.points * 2.0)
    Cgns().write(mesh, tmp_path / "unstructured.cgns")
    again = Cgns().read(tmp_path / "unstructured.cgns")
    np.testing.assert_array_equal(again.points, mesh.points)
    assert content(again) == {**content(mesh), "zones": [("upper", 0, 80)]}
    if shutil.which("cgnscheck"):
        assert complaints(tmp_path / "unstructured.cgns") == complaints(tmp_path / "plane.cgns") == []


def test_plane_blocks_are_deflected_as_in_su2(tmp_path):
    write_blocks(tmp_path / "plane.cgns", plane_blocks(), dimension=2)
    Su2().write(Cgns().read(tmp_path / "plane.cgns"), tmp_path / "plane.su2")
    box = [[-2.05, -2.05], [2.05, 2.05]]
    own, other = (
        sdm_deflect.deflect(tmp_path / name, "wall", [[0.0, 0.0]], 10.0, box=box)
        for name in ("plane.cgns", "plane.su2")
    )
    assert own.passed
    np.testing.assert_array_equal(own.points, other.points)
    own.save(tmp_path / "turned.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "turned.cgns").points, own.points)


@pytest.fixture(params=[("<", 1), ("<", 3), (">", 1), (">", 2)], ids=lambda given: f"{given[0]}{given[1]}")
def old(request, tmp_path):
    """Two blocks in ADF, in an order of bytes, data in some pieces."""
    left, right = two_blocks()
    left.conditions.append(("a", "wall", "BCWall", (1, 1, 1), (1, 3, 5), None))
    write_blocks(tmp_path / "two.cgns", [left, right])
    (tmp_path / "old.cgns").write_bytes(in_adf(tmp_path / "two.cgns", *request.param))
    return tmp_path / "old.cgns"


def coordinate_bytes(path):
    """Which bytes of an ADF file hold coordinates."""
    found = np.zeros(path.stat().st_size, dtype=bool)
    with path.open("rb") as file:
        for zone in adf.Tree(file).root.children["Base#1"].children.values():
            if zone.label == "Zone_t":
                for axis in AXES:
                    for place, length in zone.children["GridCoordinates"].children[axis].data.pieces:
                        found[place : place + length] = True
    return found


def test_adf_holds_the_same_mesh_and_keeps_all_other_bytes(old, tmp_path):
    mesh, same = Cgns().read(tmp_path / "two.cgns"), Cgns().read(old)
    np.testing.assert_array_equal(same.points, mesh.points)
    assert content(same) == content(mesh)
    Cgns().rewrite(old, mesh.points, tmp_path / "copy.cgns")
    assert (tmp_path / "copy.cgns").read_bytes() == old.read_bytes()
    Cgns().rewrite(old, mesh.points * np.pi, tmp_path / "moved.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "moved.cgns").points, mesh.points * np.pi)
    a, b = (np.frombuffer(path.read_bytes(), dtype=np.uint8) for path in (old, tmp_path / "moved.cgns"))
    assert not np.any((a != b) & ~coordinate_bytes(old))
    if shutil.which("cgnsdiff"):
        for path in (old, tmp_path / "copy.cgns"):
            done = subprocess.run(
                ["cgnsdiff", "-d", "-f", tmp_path / "two.cgns", path], capture_output=True, text=True, check=False
            )
            assert done.stdout.split() == ["/", "<>", "/", ":", "labels", "differ"]
        assert complaints(tmp_path / "moved.cgns") == []


@pytest.mark.parametrize("mesh", [hybrid(2), polyhedral(hybrid())], ids=["shapes", "polyhedra"])
def test_unstructured_zones_in_adf(mesh, tmp_path):
    Cgns().write(mesh, tmp_path / "mesh.cgns")
    (tmp_path / "old.cgns").write_bytes(in_adf(tmp_path / "mesh.cgns"))
    same, old = Cgns().read(tmp_path / "mesh.cgns"), Cgns().read(tmp_path / "old.cgns")
    np.testing.assert_array_equal(old.points, mesh.points)
    assert old.names == same.names
    assert [len(patch) for patch in old.patches] == [len(patch) for patch in same.patches]
    assert [len(block) for block in old.cells] == [len(block) for block in same.cells]


def test_damaged_adf_is_refused_in_a_sentence(old, tmp_path):
    whole, path = old.read_bytes(), tmp_path / "damaged.cgns"
    end = len(whole.rstrip())  # blocks of 4096 bytes are filled up with blanks
    for size in range(40, end, end // 61):
        path.write_bytes(whole[:size])
        with pytest.raises(MeshFileError, match=r"damaged\.cgns: "):
            Cgns().read(path)
    random = np.random.default_rng(1)
    for _ in range(100):
        data = bytearray(whole)
        for place in random.integers(0, len(data), 3):
            data[place] = random.choice([0, 48, 49, 70, 255])
        path.write_bytes(data)
        with suppress(MeshFileError):
            Cgns().read(path)


def test_a_node_of_two_parents_is_refused(old, tmp_path):
    data = old.read_bytes()

    def entry(name):
        """Place of a pointer in the table of a node's children."""
        name = name.ljust(32)
        return 32 + next(
            at for at in range(len(data)) if data.startswith(name, at) and not data.startswith(b"NoDe", at - 4)
        )

    to, place = entry(b"right"), entry(b"GridCoordinates")
    (tmp_path / "loop.cgns").write_bytes(data[:to] + data[place : place + 12] + data[to + 12 :])
    with pytest.raises(MeshFileError, match="is there twice"):
        Cgns().read(tmp_path / "loop.cgns")
