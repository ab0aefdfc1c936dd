"""Neutral map files of PLOT3D grids: names of patches, faces that meet, deflections of named surfaces."""

import re
from pathlib import Path

import numpy as np
import pytest

import sdm_deflect as sdm
from sdm_deflect.meshing.formats.plot3d import Plot3d
from sdm_deflect.meshing.formats.registry import read
from sdm_deflect.meshing.formats.su2 import Su2
from tests.meshing.formats.plot3d_files import BODY, SIDES, box, cut, head, stored, whole_face, with_body, written
from tests.meshing.formats.test_hostile import complaint


@pytest.fixture
def body(tmp_path):
    """26 blocks around a cube with a map that names the cube, and the same mesh in SU2."""
    blocks = with_body(6)
    lines = [f"wall {whole_face(blocks[int(b[5:]) - 1], int(b[5:]), face)} # body" for b, face in BODY]
    path = written(tmp_path / "mesh.p3d", blocks, "<f8r")
    (tmp_path / "mesh.nmf").write_text(head(blocks) + "\n".join(lines) + "\n")
    return path


def test_a_deflection_is_that_of_the_same_mesh_in_su2_and_interfaces_stay_the_same_bits(body, tmp_path):
    mesh = read(body)
    assert len(mesh.patch("body")) == 24
    Su2().write(mesh, tmp_path / "mesh.su2")
    moved = []
    for name in ("mesh.p3d", "mesh.su2"):
        result = sdm.deflect(tmp_path / name, "body", hinge=[(0, -1, 0), (0, 1, 0)], angle=5.0, fixed="block*")
        result.save(tmp_path / f"mesh-moved{Path(name).suffix}")
        moved.append(read(tmp_path / f"mesh-moved{Path(name).suffix}"))
    assert np.abs(moved[0].points - mesh.points).max() > 0.01
    np.testing.assert_array_equal(moved[0].points, moved[1].points)
    assert moved[0].names == mesh.names  # by the map of mesh.p3d
    places = {point.tobytes() for point in stored(tmp_path / "mesh-moved.p3d")}
    assert len(places) == len(mesh.points)


def test_a_map_names_patches_and_the_rest_are_sides(tmp_path):
    first, second = cut(box((5, 4, 3)), 0, 2)
    path = written(tmp_path / "wing.v2.p3d", [first, second])
    (tmp_path / "wing.nmf").write_text(
        head([first, second]) + "'viscous_solid ' 1 5 1 2 1 3  TRUE\n viscous_solid 2 5 1 3 1 3 ! flap\n"
        '"farfield riem" 1 3 4 1 3 1\nfarfield_riem 2 4 1 4 1 3\nunprocessed 2 6 1 3 1 3\n'
        "ONE_TO_ONE 1 4 1 4 1 3  2 3 1 4 1 3 FALSE # a comment\n# the end\n"
    )
    mesh = read(path)
    assert {patch.name: len(patch) for patch in mesh.patches} == {
        "viscous_solid": 2, "flap": 4, "farfield riem": 6, "farfield_riem": 6, "block1/jmin": 2, "block1/jmax": 4,
        "block1/kmin": 6, "block1/kmax": 6, "block2/jmax": 4, "block2/kmin": 6, "block2/kmax": 6,
    }  # fmt: skip
    assert len(mesh.zones) == 1
    (tmp_path / "wing.v2.nmf").write_text(head([first, second]) + "wall 1 5 1 3 1 3\nwall 2 5 1 3 1 3\n")
    assert len(read(path).patch("wall")) == 8


def test_walls_without_thickness_stay_apart(tmp_path):
    left, right = cut(box((5, 5, 3)), 0, 2)
    path = written(tmp_path / "a.p3d", [left, right])
    (tmp_path / "a.nmf").write_text(head([left, right]) + "wall 1 4 1 3 1 3 # left\nwall 2 3 1 3 1 3 # right\n")
    mesh = read(path)
    assert (len(mesh.patch("left")), len(mesh.patch("right"))) == (4, 4)
    assert len(mesh.points) == 5 * 5 * 3 + 2 * 3  # two lines of points beside the one at the edge
    assert len(mesh.zones) == 1


def test_faces_that_the_map_pairs_may_be_a_little_apart_and_keep_their_bits_at_rest(tmp_path):
    left, right = cut(box(), 0, 2)
    source = written(tmp_path / "a.p3d", [left, right * (1.0 + 1e-9)])
    assert len(read(source).zones) == 2
    (tmp_path / "a.nmf").write_text(head([left, right]) + "one-to-one 2 3 4 1 1 3 1 4 4 1 1 3 false\n")
    mesh = read(source)
    assert len(mesh.points) == 60
    assert not {"block1/imax", "block2/imin"} & set(mesh.names)
    points = mesh.points.copy()
    points[3] += 0.25
    Plot3d().rewrite(source, points, tmp_path / "a-moved.p3d")
    before, after = stored(source), stored(tmp_path / "a-moved.p3d")
    at = np.flatnonzero((before != after).any(axis=1))
    assert len(np.unique(after[at], axis=0)) == 1
    np.testing.assert_allclose(after[at], before[at] + 0.25, rtol=1e-8)


def test_interfaces_that_are_periodic_or_patched(tmp_path):
    left, right = cut(box((5, 5, 3), 0.0), 0, 2)
    source = written(tmp_path / "a.p3d", [left, right[:, ::2]])
    text = head([left, right[:, ::2]]) + "one_to_one 1 3 1 5 1 3 2 4 1 3 1 3 FALSE\n"
    (tmp_path / "a.nmf").write_text(text + "PATCHED 1 4 1 5 1 3 2 3 1 3 1 3\n")
    mesh = read(source)
    assert [zone.blocks for zone in mesh.zones] == [("block1", "block2")]
    assert {"block1/imin", "block2/imax"} <= set(mesh.names)
    assert not {"block1/imax", "block2/imin"} & set(mesh.names)


def test_an_interface_between_far_sides_joins_nothing(tmp_path):
    left, right = cut(box((5, 4, 3)), 0, 2)
    source = written(tmp_path / "a.p3d", [left, right])
    (tmp_path / "a.nmf").write_text(head([left, right]) + "one_to_one 1 3 1 4 1 3 2 4 1 4 1 3 FALSE\n")
    mesh = read(source)
    assert len(mesh.points) == 60
    assert {"block1/imin", "block2/imax"} <= set(mesh.names)


def test_faces_that_the_map_calls_collapsed_are_no_patches(tmp_path):
    path = written(tmp_path / "a.p3d", [box()])
    (tmp_path / "a.nmf").write_text(head([box()]) + "pole_dir2 1 5 1 3 1 5\n")
    assert set(read(path).names) == SIDES - {"block1/jmin"}


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("wall 2 1 1 5 1 4", "there is no face 1 of block 2; there are 6 of 1 blocks"),
        ("wall 1 7 1 5 1 4", "there is no face 7 of block 1"),
        ("wall 1 1 1 6 1 4", "face 1 of block 1 has points 1 to 5, but not 1 to 6"),
        ("wall 1 1 0 5 1 4", "has points 1 to 5, but not 0 to 5"), ("wall 1 1 5 5 1 4", "but not 5 to 5"),
        ("wall 1 1 1 5", "'wall 1 1 1 5' is no type with the block"), ("5 1 1 5 1 4 4", "is no type with the block"),
        ("wall 1 1 1 5 1 4 7", "is no type with the block"), ("wall one 1 1 5 1 4", "is no type"),
        ("one_to_one 1 1 1 5 1 4", "one_to_one has 1 faces; interfaces have two"),
        ("wall 1 1 1 5 1 4 1 2 1 5 1 4", "wall has 2 faces"),
    ],
)  # fmt: skip
def test_wrong_lines_of_a_map(lines, said, tmp_path):
    path = written(tmp_path / "a.p3d", [box()])
    (tmp_path / "a.nmf").write_text(head([box()]) + "# nothing\n" + lines)
    assert re.search(rf"a\.nmf: line 8: .*{re.escape(said)}", complaint(Plot3d(), path))


@pytest.mark.parametrize(
    "text", ["", "#", "2\n1 5 4 3\n2 5 4 3\n", "1\n1 5 4 4\n", "wall 1 1 1 5 1 4", "\0\0", "1" * 9999]
)
def test_a_map_of_another_grid(text, tmp_path):
    path = written(tmp_path / "a.p3d", [box()])
    (tmp_path / "a.nmf").write_text(text)
    assert re.search(r"a\.nmf: should begin with 1 1 5 4 3, the number and the sizes", complaint(Plot3d(), path))


def test_a_plane_grid_with_a_map_turns_about_a_point(tmp_path):
    whole = 2.0 * box((13, 13, 2), 0.0)[:, :, :1] - 1.0
    blocks = [whole[a : a + 5, b : b + 5] for b in (0, 4, 8) for a in (0, 4, 8) if (a, b) != (4, 4)]
    sides = [(2, "jmax"), (4, "imax"), (5, "imin"), (7, "jmin")]
    lines = [f"wall {whole_face(blocks[i - 1], i, face)} # body" for i, face in sides]
    lines += [f"symmetry {whole_face(blocks[0], 1, 'kmin')}", ""]
    source = written(tmp_path / "a.xyz", blocks, "<f8r", axes=2)
    (tmp_path / "a.nmf").write_text(head(blocks) + "\n".join(lines))
    mesh = read(source)
    assert mesh.plane
    assert len(mesh.patch("body")) == 16
    result = sdm.deflect(source, "body", hinge=[(0, 0)], angle=10.0, fixed="block*")
    assert result.save(tmp_path / "b.xyz") == tmp_path / "b.xyz"
    assert np.abs(stored(tmp_path / "b.xyz") - stored(source)).max() > 0.01
    assert len({point.tobytes() for point in stored(tmp_path / "b.xyz")}) == len(mesh.points)
