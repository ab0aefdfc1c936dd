"""Parts of patches: what hangs together, what is chosen, and what is left."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Polygons
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.selection import Before, Component, Part, Selection, Within, with_selections
from tests.deform.blocks import block_with_body, two_bodies


def one_marker():
    """Two plates in a channel, all in one patch: ``wall``; the channel has most faces, then the right plate."""
    mesh = two_bodies()
    left, right, channel = (mesh.patch(name).faces[0].nodes for name in ("left", "right", "wall"))
    faces = np.vstack([left[:-8], right, channel])
    return Mesh(mesh.points, mesh.cells, (Patch("wall", (Cells("quad", faces),)), Patch("end", ())), name="channel")


def rows(mesh, name):
    """The faces of a patch as rows of sorted nodes, sorted."""
    return sorted(tuple(sorted(face)) for block in mesh.patch(name).faces for face in block.nodes.tolist())


def test_components_are_numbered_by_their_faces():
    mesh = one_marker()
    part = Part.of(mesh, mesh.patch("wall"))
    parts = part.cut(part.components(), "#")
    sizes = [len(one) for one in parts]
    assert [one.name for one in parts] == ["wall#1", "wall#2", "wall#3"]
    assert sizes == sorted(sizes, reverse=True)
    assert sum(sizes) == len(part)
    assert parts[1].centres[:, 0].min() > 0.0 > parts[2].centres[:, 0].max()
    assert np.concatenate(parts[0].extent).tolist() == [-4.0, -1.5, -2.0, 4.0, 1.5, 2.0]


def test_equally_large_components_come_in_the_order_of_their_first_faces():
    mesh = two_bodies()
    plates = tuple(mesh.patch(name).faces[0] for name in ("right", "left"))
    part = Part.of(Mesh(mesh.points, (), (Patch("plates", plates),)), Patch("plates", plates))
    assert len(plates[0]) == len(plates[1])
    assert part.cut(part.components(), "#")[0].centres[:, 0].min() > 0.0


def test_a_component_is_a_patch_and_the_rest_keeps_its_name():
    mesh, whole = one_marker(), two_bodies()
    again = with_selections(mesh, (), ["wall#2"])
    assert again.names == ("wall", "wall#2", "end")
    assert rows(again, "wall#2") == rows(whole, "right")
    assert len(again.patch("wall")) + len(again.patch("wall#2")) == len(mesh.patch("wall"))
    assert again.points is mesh.points
    assert again.cells == mesh.cells
    assert with_selections(mesh, (), ["wall", "w*"]) is mesh


def test_a_wildcard_stands_for_the_components_that_nothing_else_has():
    mesh = one_marker()
    assert with_selections(mesh, (), ["wall#*"]).names == ("wall#1", "wall#2", "wall#3", "end")
    flap = Selection("flap", "wall#2")
    assert set(with_selections(mesh, [flap], ["wall#3", "wall#*"]).names) == {"flap", "wall#1", "wall#3", "end"}


def test_a_box_and_a_plane_take_faces_by_their_centres():
    """Each face is on one side; nodes between both are on both patches."""
    mesh = one_marker()
    ahead = with_selections(mesh, [Selection("ahead", "wall#2", (Before((1.25, 0, 0), (1, 0, 0)),))])
    boxed = with_selections(mesh, [Selection("ahead", "wall#2", (Within((1.25, -9, -9), (9, 9, 9)),))])
    assert rows(ahead, "ahead") == rows(boxed, "ahead")
    centres = Part.of(ahead, ahead.patch("ahead")).centres
    assert centres[:, 0].min() > 1.25
    assert len(np.intersect1d(ahead.on("ahead"), ahead.on("wall"))) > 0


def test_each_test_narrows_what_the_one_before_it_left():
    """The half space before z = 0 has one half of each plate and of the channel: components again."""
    mesh = one_marker()
    upper = Before((0, 0, 0.1), (0, 0, 1))
    two = with_selections(mesh, [Selection("top", "wall", (upper, Component(2)))])
    other = with_selections(mesh, [Selection("top", "wall#2", (upper,))])
    assert rows(two, "top") == rows(other, "top")


def test_sharp_edges_cut_a_cube_into_its_six_sides():
    mesh = block_with_body()
    sides = with_selections(mesh, [Selection("side", "body", sharp=40.0)])
    names = [f"side~{k}" for k in range(1, 7)]
    assert set(sides.names) == {*(name for name in mesh.names if name != "body"), *names}
    for name in names:
        flat = np.ptp(sides.points[sides.on(name)], axis=0)
        assert sorted(flat.tolist()) == [0.0, 1.0, 1.0]
    top = Selection("top", "body", (Before((0, 0, 0.4), (0, 0, 1)),), 40.0)
    assert len(with_selections(mesh, [top]).patch("top~1")) == 4


@pytest.mark.parametrize("kind", ["triangles", "polygons"])
def test_faces_of_several_blocks_are_cut_alike(kind):
    mesh = one_marker()
    quads = mesh.patch("wall").faces[0].nodes
    first, rest = quads[::2], quads[1::2]
    if kind == "triangles":
        blocks = (Cells("triangle", np.vstack([first[:, :3], first[:, [0, 2, 3]]])), Cells("quad", rest))
    else:
        blocks = (Polygons(first.ravel(), np.arange(0, first.size + 1, 4)), Cells("quad", rest))
    mixed = Mesh(mesh.points, mesh.cells, (Patch("wall", blocks),))
    again, plain = with_selections(mixed, (), ["wall#2"]), with_selections(mesh, (), ["wall#2"])
    assert again.on("wall#2").tolist() == plain.on("wall#2").tolist()
    assert again.on("wall").tolist() == plain.on("wall").tolist()


def ring(centre, n, corners=()):
    """Points and lines of a closed polygon in the plane z = 0: a circle, or a polygon with n lines a side."""
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    points = np.column_stack([centre[0] + np.cos(angle), centre[1] + np.sin(angle), 0.0 * angle])
    if corners:
        ends = np.array([*corners, corners[0]], dtype=float)
        sides = [np.linspace(a, b, n, endpoint=False) for a, b in pairwise(ends)]
        points = np.column_stack([np.vstack(sides), np.zeros(n * len(corners))])
    index = np.arange(len(points))
    return points, np.column_stack([index, np.roll(index, -1)])


def test_lines_of_a_plane_mesh_are_chosen_like_faces():
    """A circle and a triangle in one patch of lines; the triangle has three sides between its sharp corners."""
    circle, around = ring((5.0, 0.0), 64)
    triangle, along = ring((0.0, 0.0), 10, [(0, 0), (3, 0), (0, 2)])
    lines = np.vstack([around, along[:, ::-1] + len(circle)])
    mesh = Mesh(np.vstack([circle, triangle]), (), (Patch("wall", (Cells("line", lines),)),))
    again = with_selections(mesh, [Selection("side", "wall#2", sharp=40.0)])
    assert [len(again.patch(name)) for name in again.names] == [64, 10, 10, 10]
    assert rows(again, "wall") == sorted(tuple(sorted(line)) for line in around.tolist())
    upper = with_selections(mesh, [Selection("upper", "wall#1", (Before((5, 0, 0), (0, 1, 0)),))])
    assert len(upper.patch("upper")) == 32
    right = with_selections(mesh, [Selection("right", "wall", (Within((5, -2, 0), (9, 2, 0)),))])
    assert len(right.patch("right")) == 32


def test_a_patch_of_nodes_alone_keeps_them():
    mesh = one_marker()
    patch = Patch("wall", mesh.patch("wall").faces, np.array([0, 1]))
    again = with_selections(Mesh(mesh.points, (), (patch,)), (), ["wall#2"])
    assert again.patch("wall").loose.tolist() == [0, 1]
    assert not len(again.patch("wall#2").loose)


FLAP = Selection("flap", "wall#2")
WRONG = [
    ([Selection("flap", "wal#2")], "'wal' is no patch; did you mean wall"),
    ([Selection("flap", "wall#4")], "there is no component 4; there are wall#1 [0-9]+ faces from .*; wall#3 "),
    ([Selection("flap", "w*"), Selection("x", "wall")], "all [0-9]+ faces of wall; name wall itself"),
    ([Selection("flap", "*")], "stands for several patches, wall, end"),
    ([Selection("flap", "end")], "end has no faces"),
    ([Selection("flap", "wall", (Within((50, 50, 50), (51, 51, 51)),))], "the box from .* leaves nothing of wall"),
    ([Selection("flap", "wall", (Before((0, 9, 0), (0, 1, 0)),))], "side of the plane .* leaves nothing of wall"),
    ([Selection("end", "wall#2")], "end is the name of two patches"),
    ([FLAP, Selection("flap", "wall#3")], "flap is the name of two patches"),
    ([FLAP, Selection("lower", "wall", (Before((0, 0, 0), (0, 0, -1)),))], "flap and lower overlap: [0-9]+ faces"),
    ([Selection("bent", "wall#2", (Before((0, 0, 0.1), (0, 0, 1)), Component(1)), 95.0), FLAP], "overlap"),
]


@pytest.mark.parametrize(("selections", "words"), WRONG, ids=[words[:30] for _, words in WRONG])
def test_what_cannot_be_chosen_is_one_sentence(selections, words):
    with pytest.raises(InputError, match=words):
        with_selections(one_marker(), selections)


def test_a_component_that_is_chosen_under_another_name_is_none_of_its_own():
    with pytest.raises(InputError, match="flap and wall#2 overlap"):
        with_selections(one_marker(), [FLAP], ["wall#2"])


def test_too_many_regions_are_refused():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(3000 * 3, 3))
    mesh = Mesh(points, (), (Patch("dust", (Cells("triangle", np.arange(9000).reshape(-1, 3)),)),))
    with pytest.raises(InputError, match="3000 regions; choose a larger angle"):
        with_selections(mesh, [Selection("grain", "dust", sharp=40.0)])
    with pytest.raises(InputError, match="stands for 3000 components"):
        with_selections(mesh, (), ["dust#*"])
    with pytest.raises(InputError, match="; and 2994 more"):
        with_selections(mesh, (), ["dust#3001"])


def test_what_a_reader_has_noted_stays():
    mesh = replace(one_marker(), notes=("parts were joined",))
    assert with_selections(mesh, (), ["wall#2"]).notes == mesh.notes
