"""Structured zones of CGNS files: read in the order of the file, and deflected as one mesh; and plane ones."""

import subprocess

import h5py
import numpy as np
import pytest

import sdm_deflect
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.cases.run.inspection import file_figures, inspect
from sdm_deflect.meshing.formats.cgns import Cgns
from sdm_deflect.meshing.formats.cgns_hdf5 import create
from sdm_deflect.meshing.formats.cgns_nodes import AXES
from sdm_deflect.meshing.formats.cgns_read import PLANE
from sdm_deflect.meshing.mesh.quality import quality_and_inverted
from tests.extras import Library, needs_program
from tests.meshing.formats.alike import content, replace_data
from tests.meshing.formats.blocks import (
    FLAP,
    HINGE,
    Block,
    complaints,
    cube,
    in_a_layer,
    stored,
    two_blocks,
    wing_blocks,
    write_blocks,
)
from tests.meshing.formats.examples import grid
from tests.meshing.formats.wing import boundary_faces

pv = Library("pyvista")
cgns = Library("vtkmodules.vtkIOCGNSReader")

needs_tools = needs_program("cgnscheck")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("wing") / "wing.cgns"
    write_blocks(path, wing_blocks(6))
    return path


def deflected(source, out=None):
    hinge = [[HINGE, FLAP[0], 0.0], [HINGE, FLAP[1], 0.0]]
    slide = {"root": "plane", "end": "plane"}
    result = sdm_deflect.deflect(source, "flap", hinge, -20.0, motion="blended", fixed="wing", slide=slide)
    if out:
        result.save(out)
    return result


@needs_tools
def test_a_flap_in_blocks_turns_and_the_blocks_still_fit(made, tmp_path):
    out = tmp_path / "turned.cgns"
    assert complaints(made) == []
    result = deflected(made, out)
    assert result.passed
    assert {check.name: check.value for check in result.checks}["inverted_cells"] == 0
    written = Cgns().read(out)
    assert not any(quality_and_inverted(written.points, block)[1].any() for block in written.cells)
    assert complaints(out) == []
    differing = subprocess.run(["cgnsdiff", "-d", "-f", made, out], capture_output=True, text=True, check=False).stdout
    assert differing
    assert all("GridCoordinates/Coordinate" in line and "data values differ" in line for line in differing.splitlines())
    before, after = (np.concatenate(list(stored(path).values())) for path in (made, out))
    assert np.abs(after - before).max() > 0.05
    _, place = np.unique(before, axis=0, return_inverse=True)
    _, first = np.unique(place, return_index=True)
    assert len(first) < len(before)
    np.testing.assert_array_equal(after, after[first][place.ravel()])


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
    assert file_figures(made)["blocks"] == {"upper-0": [block.name for block in wing_blocks(6)]}
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
    reader = cgns.vtkCGNSReader()
    reader.SetFileName(str(made))
    reader.UpdateInformation()
    reader.EnableAllBases()
    reader.Update()
    read = pv.wrap(reader.GetOutput())["Base#1"]
    own = stored(made)
    for i, points in enumerate(own.values()):
        np.testing.assert_array_equal(read[i].points, points)


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


@needs_tools
def test_cgnscheck_has_no_complaint_about_plane_blocks(tmp_path):
    write_blocks(tmp_path / "plane.cgns", list(plane_blocks()), dimension=2)
    Cgns().write(Cgns().read(tmp_path / "plane.cgns"), tmp_path / "unstructured.cgns")
    assert complaints(tmp_path / "unstructured.cgns") == complaints(tmp_path / "plane.cgns") == []


@pytest.mark.parametrize(
    ("axis", "third"),
    [(0, "CoordinateZ"), (1, "CoordinateZ"), (2, "CoordinateZ"), (2, "CoordinateY"), (1, "CoordinateX")],
)
def test_blocks_of_one_layer_of_points_are_plane(axis, third, tmp_path):
    blocks = plane_blocks()
    blocks[1] = blocks[1].transposed(1, 0)
    for name in ("plane", "layer"):
        write_blocks(tmp_path / f"{name}.cgns", blocks, dimension=2)
    in_a_layer(tmp_path / "layer.cgns", axis, third)
    mesh, same = (Cgns().read(tmp_path / f"{name}.cgns") for name in ("plane", "layer"))
    np.testing.assert_array_equal(same.points, mesh.points + np.array([0.0, 0.0, 2.5]))
    assert content(same) == content(mesh)
    assert same.notes == (() if third == "CoordinateZ" else (PLANE.format(*(one for one in AXES if one != third)),))
    moved = same.points * [2.0, 3.0, 1.0]
    Cgns().rewrite(tmp_path / "layer.cgns", moved, tmp_path / "moved.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "moved.cgns").points, moved)


def test_a_block_of_one_layer_beside_others_has_no_cells(tmp_path):
    write_blocks(
        tmp_path / "two.cgns",
        [*two_blocks(), cube("flat", n=(4, 3, 1), at=(0.0, 9.0, 0.0), places=5000)],
        connect=False,
    )
    with pytest.raises(MeshFileError, match=r"zone flat: its 4 x 3 x 1 points hold no cells"):
        Cgns().read(tmp_path / "two.cgns")


@pytest.mark.parametrize("where", ["KFaceCenter", "Vertex", "FaceCenter"])
def test_a_condition_on_the_whole_plane_is_on_no_line(where, tmp_path):
    blocks = plane_blocks()
    blocks[0].conditions.append(("sym", "sym", "BCSymmetryPlane", (1, 1), (9, 5), None))
    write_blocks(tmp_path / "layer.cgns", blocks, dimension=2)
    in_a_layer(tmp_path / "layer.cgns", 2, "CoordinateZ")
    with h5py.File(tmp_path / "layer.cgns", "r+") as file:
        node = file["Base#1/upper/ZoneBC/sym"]
        create(node, "GridLocation", "GridLocation_t", where)
        replace_data(node["PointRange"], np.array([[1, 1, 1], [9, 5, 1] if where == "Vertex" else [8, 4, 1]]))
    assert sorted(Cgns().read(tmp_path / "layer.cgns").names) == ["far", "wall"]


def test_what_could_not_be_read_is_said_by_the_commands_and_matters_where_it_is_needed(tmp_path):
    blocks = plane_blocks()
    blocks[0].conditions.append(("lost", None, "BCWall", (1, 5), (9, 6), None))
    write_blocks(tmp_path / "plane.cgns", blocks, dimension=2)
    where = "zone upper: boundary condition lost: it is on the points (1, 5) to (9, 6) of a block of 9 x 5"
    note = f"patch upper/lost is absent: {where}"
    assert file_figures(tmp_path / "plane.cgns")["notes"] == [note]
    assert note in inspect(tmp_path / "plane.cgns").splitlines()
    box = [[-2.05, -2.05], [2.05, 2.05]]
    given = {"hinge": [[0.0, 0.0]], "angle": 10.0, "box": box}
    done = sdm_deflect.deflect(tmp_path / "plane.cgns", "wall", **given)
    assert done.passed
    assert note in done.figures()["notes"]
    for surface, fixed in (("lost", {}), ("wall", {"fixed": ["lost"]})):
        with pytest.raises(
            sdm_deflect.InputError, match=r"'lost' cannot be taken: patch upper/lost is absent: zone upper"
        ):
            sdm_deflect.deflect(tmp_path / "plane.cgns", surface, **given, **fixed)
