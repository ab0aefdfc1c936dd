"""SU2 files: a round trip loses nothing, a rewritten file differs in coordinates alone, others read what we write."""

import numpy as np
import pytest

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.formats.su2 import Su2
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Polygons
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.extras import Library
from tests.meshing.formats.alike import content
from tests.meshing.formats.examples import hybrid, with_gmsh

meshio = Library("meshio")

KEPT = b"""% made by hand = not by a mesher
NMARK=   2
MARKER_TAG=  wing
MARKER_ELEMS= 2   % two of the four faces
5 0 2 1
\t5  0 1 3   7

MARKER_TAG= SEND_RECEIVE
MARKER_ELEMS= 1
SEND_TO= 1
1 3 0
NDIME= 3
NPOIN= 4 4\r
  0.0   0 +0e0  0\r
% the next point is at x = 1
1.000 0.0 0.0\r
0.0 1.000 0.0   2\r

-0.0 0.0 1.000 3 % the last point
FFD_NBOX= 1
FFD_TAG= box
FFD_CORNER_POINTS= 2
0.5 0.5 0.5
1 1 1
NELEM= 1
10 0 1 2 3
NPERIODIC= 0
"""


@pytest.fixture
def kept(tmp_path):
    path = tmp_path / "kept.su2"
    path.write_bytes(KEPT)
    return path


@pytest.mark.parametrize("zones", [1, 2, 3])
def test_round_trip_loses_names_of_zones_and_blanks_alone(zones, tmp_path):
    mesh = hybrid(zones)
    lost = Su2().write(mesh, tmp_path / "mesh.su2")
    again = Su2().read(tmp_path / "mesh.su2")
    expected, found = content(mesh), content(again)
    np.testing.assert_array_equal(again.points, mesh.points)
    assert found["cells"] == expected["cells"]
    assert found["patches"] == {name.replace(" ", "_"): faces for name, faces in expected["patches"].items()}
    assert [zone[1:] for zone in found["zones"]] == [zone[1:] for zone in expected["zones"]]
    assert "patch left wall is marker left_wall" in lost
    assert any("block 1" in sentence for sentence in lost) == (zones > 1)


def test_patches_of_equal_names_in_two_zones_are_told_apart(tmp_path):
    mesh = hybrid(2)
    text = []
    Su2().write(mesh, tmp_path / "mesh.su2")
    text = (tmp_path / "mesh.su2").read_text().replace("floor_2", "floor")
    (tmp_path / "mesh.su2").write_text(text)
    again = Su2().read(tmp_path / "mesh.su2")
    names = [patch.name for patch in again.patches]
    assert names[0] == "zone 1/floor"
    assert names[6] == "zone 2/floor"
    assert "inlet" in names
    Su2().write(again, tmp_path / "again.su2")
    assert (tmp_path / "again.su2").read_text() == text


def test_sections_in_any_order_comments_and_optional_numbers_are_read(kept):
    mesh = Su2().read(kept)
    np.testing.assert_array_equal(mesh.points, np.vstack([np.zeros(3), np.eye(3)]))
    assert content(mesh)["cells"] == {"tetra": [(0, 1, 2, 3)]}
    assert content(mesh)["patches"] == {"wing": [(0, 2, 1), (0, 1, 3)]}


def test_rewriting_replaces_the_characters_of_moved_coordinates_alone(kept, tmp_path):
    points = Su2().read(kept).points.copy()
    points[1, 0] = 1.0 / 3.0
    points[3] = [-0.0, 1e-300, 2.0]
    Su2().rewrite(kept, points, tmp_path / "moved.su2")
    expected = KEPT.replace(b"1.000 0.0 0.0\r", b"0.3333333333333333 0.0 0.0\r").replace(
        b"-0.0 0.0 1.000 3 %", b"-0.0 1e-300 2.0 3 %"
    )
    assert (tmp_path / "moved.su2").read_bytes() == expected
    np.testing.assert_array_equal(Su2().read(tmp_path / "moved.su2").points, points)
    assert kept.read_bytes() == KEPT


def test_chunks_may_end_anywhere(kept, tmp_path, monkeypatch):
    whole = content(Su2().read(kept))
    moved = Su2().read(kept).points * 3.0
    Su2().rewrite(kept, moved, tmp_path / "whole.su2")
    for size in (1, 7, 40):
        monkeypatch.setattr("sdm_deflect.meshing.formats.numbers.CHUNK", size)
        assert content(Su2().read(kept)) == whole
        Su2().rewrite(kept, moved, tmp_path / "pieces.su2")
        assert (tmp_path / "pieces.su2").read_bytes() == (tmp_path / "whole.su2").read_bytes()


def test_wedges_of_either_hand_are_read_in_vtk_order(tmp_path):
    mesh = hybrid()
    Su2().write(mesh, tmp_path / "mesh.su2")
    text = (tmp_path / "mesh.su2").read_text()
    other = text.replace("13 4 12 7 5 13 6", "13 4 7 12 5 6 13")
    assert other != text
    (tmp_path / "mesh.su2").write_text(other)
    assert content(Su2().read(tmp_path / "mesh.su2"))["cells"] == content(mesh)["cells"]


def test_polygons_of_three_and_four_corners_become_triangles_and_quads(tmp_path):
    mesh = hybrid()
    floor = Polygons(np.array([1, 2, 8, 0, 3, 2, 1, 2, 9, 8]), np.array([0, 3, 7, 10]))
    Su2().write(Mesh(mesh.points, mesh.cells, (Patch("floor", (floor,)),)), tmp_path / "mesh.su2")
    found = content(Su2().read(tmp_path / "mesh.su2"))["patches"]
    assert found == {"floor": [(1, 2, 8), (2, 9, 8), (0, 3, 2, 1)]}


def test_faces_of_five_corners_are_an_error_that_names_the_patch(tmp_path):
    mesh = hybrid()
    face = Polygons(np.arange(5), np.array([0, 5]))
    with pytest.raises(MeshFileError, match="patch cap: 1 faces have more than four corners"):
        Su2().write(Mesh(mesh.points, mesh.cells, (Patch("cap", (face,)),)), tmp_path / "mesh.su2")
    assert not list(tmp_path.iterdir())


def test_meshio_reads_the_same_counts_per_marker(tmp_path):
    mesh = hybrid()
    Su2().write(mesh, tmp_path / "mesh.su2")
    read = meshio.read(tmp_path / "mesh.su2")
    np.testing.assert_array_equal(read.points, mesh.points)
    assert {block.type: len(block.data) for block in read.cells if block.dim == 3} == {
        "hexahedron": 1, "pyramid": 1, "tetra": 4, "wedge": 1,
    }  # fmt: skip
    blocks = zip(read.cells, read.cell_data["su2:tag"], strict=True)
    tags = np.concatenate([data for block, data in blocks if block.dim == 2])
    # meshio numbers the markers that are strings in the order of the file
    assert [np.count_nonzero(tags == tag) for tag in np.unique(tags[tags > 0])] == [len(p) for p in mesh.patches]


def test_gmsh_writes_what_we_read_and_what_we_write(tmp_path):
    path, ours = tmp_path / "gmsh.su2", tmp_path / "ours.su2"
    with_gmsh(path)
    mesh = Su2().read(path)
    assert {patch.name: len(patch) > 0 for patch in mesh.patches} == {"wing": True, "far_field": True}
    assert {block.shape for block in mesh.cells} == {"tetra", "wedge"}
    Su2().write(mesh, ours)
    a, b = meshio.read(ours), meshio.read(path)
    np.testing.assert_array_equal(a.points, b.points)
    for shape in ("tetra", "wedge", "triangle", "quad"):
        np.testing.assert_array_equal(a.get_cells_type(shape), b.get_cells_type(shape))
    for shape in ("triangle", "quad"):
        np.testing.assert_array_equal(a.get_cell_data("su2:tag", shape), b.get_cell_data("su2:tag", shape))


def test_cells_are_one_block_of_each_shape(tmp_path):
    mesh = hybrid()
    halves = tuple(Cells("tetra", part) for part in np.split(mesh.cells[2].nodes, 2))
    Su2().write(Mesh(mesh.points, (halves[0], *mesh.cells[:2], halves[1], mesh.cells[3]), ()), tmp_path / "m.su2")
    again = Su2().read(tmp_path / "m.su2")
    assert [block.shape for block in again.cells] == ["tetra", "hexahedron", "pyramid", "wedge"]
    np.testing.assert_array_equal(again.cells[0].nodes, mesh.cells[2].nodes)


def test_a_plane_mesh_that_is_not_at_zero_says_that_its_z_is_lost(tmp_path):
    points = np.array([[0, 0, 2.5], [1, 0, 2.5], [0, 1, 2.5]])
    mesh = Mesh(points, (Cells("triangle", [[0, 1, 2]]),), ())
    assert Su2().write(mesh, tmp_path / "a.su2") == ("SU2 has no z in a plane mesh; z = 2.5 is lost",)
    assert Su2().write(mesh.with_points(points * (1, 1, 0)), tmp_path / "b.su2") == ()
