"""Checks that can fail: values beside what was asked, and when there is nothing to ask."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.deform.checks import Check, checks_of, site_error, worst
from sdm_deflect.deform.checks import verdict as total_verdict
from sdm_deflect.deform.rbf.fitting import Fitting
from sdm_deflect.deform.volume.deflection import Deflection, deflect
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.quality import inverted_of
from tests.deform.blocks import block_with_body
from tests.deform.jobs import WING, job, placed, turn
from tests.meshing.formats.wing import wing
from tests.meshing.mesh.test_quality import as_polyhedra

TIGHT = [[-1.2, -1.2, -1.2], [1.2, 1.2, 1.2]]


def named(deflection):
    return {check.name: check for check in checks_of(deflection)}


def kept(block, share, angle=10.0):
    """A deflection whose cells must keep a share of their quality."""
    wanted = job(("body",), angle=angle, box=TIGHT)
    return deflect(Plan.of(block, [replace(wanted, repair=replace(wanted.repair, min_quality=share))]), (angle,))


def twisted(mesh, rows):
    """The mesh with two corners of some hexahedra in one another's place: they are good in neither hand."""
    nodes = mesh.cells[0].nodes.copy()
    nodes[rows] = nodes[rows][:, [1, 0, 2, 3, 4, 5, 6, 7]]
    return replace(mesh, cells=(Cells("hexahedron", nodes),))


def mirrored(mesh, rows):
    """The mesh with some hexahedra numbered so that they are inside out."""
    (cells,) = mesh.cells
    nodes = cells.nodes.copy()
    nodes[rows] = nodes[rows][:, [4, 5, 6, 7, 0, 1, 2, 3]]
    return replace(mesh, cells=(Cells("hexahedron", nodes),))


@pytest.fixture(scope="module")
def torn(block):
    """The body turned so far, in one step, that cells beside it invert."""
    return turn(block, angle=60.0, box=TIGHT, fitting=Fitting(max_steps=1))


@pytest.fixture(scope="module")
def far(block):
    """Rows of the cells with no node in the tight box."""
    (cells,) = block.cells
    return np.flatnonzero((np.abs(block.points[cells.nodes]).max(axis=2) > 1.2).all(axis=1))


@pytest.mark.parametrize(
    ("value", "limit", "judgement", "passed"),
    [
        (1.0, 1.0, "at most", True),
        (1.1, 1.0, "at most", False),
        (1.0, 1.0, "at least", True),
        (0.9, 1.0, "at least", False),
        (np.nan, 1.0, "at most", False),
        (np.nan, 1.0, "at least", False),
    ],
)
def test_a_value_passes_on_the_right_side_of_its_limit(value, limit, judgement, passed):
    check = Check("a", value, limit, "m", "here", judgement)
    assert check.passed is passed
    assert check.verdict == ("passed" if passed else "FAILED")
    assert check.as_dict()["value"] == (None if np.isnan(value) else value)


def test_a_check_over_nothing_is_not_applicable():
    check = Check("a", np.nan, 0.0, "m", "nowhere", over=0)
    assert check.passed
    assert check.verdict == "not applicable"
    assert (check.as_dict()["value"], check.as_dict()["verdict"]) == (None, "not applicable")


def test_checks_of_a_surface_alone_in_its_box(block):
    """No fixed patch reaches into it: that none of its nodes moved is no achievement."""
    checks = named(turn(block, box=TIGHT))
    assert [check.name for check in checks.values()] == [
        "outside_moved", "fixed_surfaces_moved", "left_behind", "site_error", "inverted_cells", "surfaces_crossed",
        "quality_min:hexahedron", "layer_height",
    ]  # fmt: skip
    nothing = {"fixed_surfaces_moved", "layer_height"}  # cells as high as wide are no layer
    assert {name for name, check in checks.items() if check.verdict == "not applicable"} == nothing
    assert {check.verdict for name, check in checks.items() if name not in nothing} == {"passed"}


def test_a_sliding_patch_without_nodes_in_the_box_is_not_applicable(block):
    checks = named(turn(block, box=TIGHT, slide={"x-": "plane"}))
    assert checks["on_x-"].verdict == "not applicable"
    assert named(turn(block, slide={"x-": "plane"}, box=[[-2.5, -1.2, -1.2], [1.2, 1.2, 1.2]]))["on_x-"].over > 0


def test_a_node_that_moved_where_it_must_not_is_found_by_its_last_bit(block):
    result = turn(block, box=[[-2.5, -1.2, -1.2], [1.2, 1.2, 1.2]], fixed=("x-",))
    plan = result.plan
    outside = np.setdiff1d(np.arange(len(block.points)), plan.movable)
    for node, name in ((outside[5], "outside_moved"), (plan.boxes[0].sites.fixed[0], "fixed_surfaces_moved")):
        points = result.points.copy()
        points[node, 1] = np.nextafter(points[node, 1], 9.0)
        failed = [check.name for check in checks_of(placed(result, points)) if not check.passed]
        assert failed == [name]


def test_a_node_off_its_shape_fails(inboard_wing):
    w = inboard_wing
    result = turn(w.mesh, WING, w.hinge, slide={"symmetry": "plane"})
    assert named(result)["on_symmetry"].passed
    ((_, nodes, *_),) = result.plan.boxes[0].sites.bind.slides
    points = result.points.copy()
    points[nodes[0], 1] += 1e-6
    check = named(placed(result, points))["on_symmetry"]
    assert not check.passed
    assert check.value == pytest.approx(1e-6)


def test_a_site_beyond_the_tolerance_fails(block):
    few = Fitting(initial_surface=4, initial_hexahedron=4, max_centers=8, max_steps=1)
    result = turn(block, box=TIGHT, angle=30.0, fitting=few)
    check = site_error(result.boxes[0], "m")
    assert not check.passed
    assert (check.value, check.limit, check.unit) == (
        result.boxes[0].steps[0].error,
        result.plan.boxes[0].sites.tolerance,
        "m",
    )
    assert check.where == "all data sites, 1 step"


def test_cells_that_invert_fail(torn):
    check = named(torn)["inverted_cells"]
    assert check.value == torn.inverted > 0
    assert check.limit == 0
    assert not check.passed


def test_cells_inverted_far_away_do_not_excuse_those_that_invert_in_the_box(torn, block, far):
    """As many cells were inverted in the file as invert now, but none of them where anything moves."""
    broken = twisted(block, far[: torn.inverted])
    settings = {"angle": 60.0, "box": TIGHT, "fitting": Fitting(max_steps=1)}
    result = turn(broken, allow_inverted=True, **settings)
    assert sum(result.plan.affected.inverted) == torn.inverted
    check = named(result)["inverted_cells"]
    assert (check.value, check.limit) == (torn.inverted, 0)
    assert not check.passed


def test_cells_in_the_box_that_are_mirror_images_are_judged_in_their_own_hand(torn, block, far):
    near = np.setdiff1d(np.arange(len(block.cells[0])), far)
    result = turn(mirrored(block, near[::2]), angle=60.0, box=TIGHT, fitting=Fitting(max_steps=1))
    check = named(result)["inverted_cells"]
    assert check.value == torn.inverted > 0
    assert "before" not in check.where


@pytest.mark.parametrize("share", [0.1, 0.9, 1.0])
def test_quality_must_keep_a_share_of_what_it_was(block, share):
    result = kept(block, share, 25.0)
    check = named(result)["quality_min:hexahedron"]
    (before,), (after,) = result.plan.before, result.quality
    assert (check.value, check.limit) == (after.min, share * before.min)
    assert check.passed == (after.min >= share * before.min)
    assert check.judgement == "at least"
    assert after.min < before.min


def test_no_share_no_check_of_quality(block):
    assert "quality_min:hexahedron" not in named(kept(block, 0.0))


def test_points_alone_have_no_checks_of_cells(block):
    bare = replace(block, cells=())
    expected = ["outside_moved", "fixed_surfaces_moved", "left_behind", "site_error", "surfaces_crossed"]
    assert list(named(turn(bare, box=TIGHT))) == expected


@pytest.fixture(scope="module")
def layered():
    """A wing of a thousand columns, and its deflection: it is turned rigidly, with its layers as they were."""
    w = wing()
    return w, turn(w.mesh, WING, w.hinge, slide={"symmetry": "plane"})


def raised(deflection, w, share, columns):
    """The deflection with the first layer higher over some columns of the wing, and all layers above with it."""
    points, nodes = deflection.points.copy(), w.columns[columns]
    points[nodes[:, 1:]] += share * (points[nodes[:, 1:2]] - points[nodes[:, :1]])
    return Deflection.at(deflection.plan, points)


@pytest.mark.parametrize(("share", "some", "verdict", "limit"), [
    (0.05, slice(100, None), "passed", 0.5),
    (-0.15, slice(100, None), "usable", 0.5),
    (0.15, slice(100, None), "FAILED", 0.1),
    (1.4, [100], "usable", 0.5),
    (2.4, [100], "FAILED", 0.5),
])  # fmt: skip
def test_heights_of_layers_are_graded(layered, share, some, verdict, limit):
    """A column has four corners: one raised by 1.4 raises its cells by .35, and those around.

    A first layer that grows in many columns fails, one that becomes thinner does not.
    """
    w, deflection = layered
    check = named(raised(deflection, w, share, some))["layer_height"]
    assert (check.verdict, check.limit) == (verdict, limit)
    assert check.over > 1000
    assert check.figures["first_layer_growth" if limit == 0.1 else "change"]["max"] == check.value
    assert (check.window is None) == (check.value <= 0.1)
    if check.window:
        low, high = check.window
        raised_nodes = w.mesh.points[w.columns[some, 0]]
        assert ((raised_nodes > low) & (raised_nodes < high)).all(axis=1).any()
    if verdict == "usable":
        told = r"layers changed by up to 0\.[13]5 in \d+ of \d+ columns at \(.*\)"
        assert re.fullmatch(told, check.reservation)
        assert total_verdict([check]) == f"usable, with {check.reservation}"
    if verdict == "FAILED":
        assert check.cause == "gap"
        assert "another wall is near" in check.where


def test_columns_that_lie_down_fail_although_their_cells_keep_their_heights(layered):
    w, deflection = layered
    points, nodes = deflection.points.copy(), w.columns[100:]
    points[nodes[:, 1:], 1] += 2.0 * np.linalg.norm(points[nodes[:, 1:]] - points[nodes[:, :1]], axis=2)
    check = named(Deflection.at(deflection.plan, points))["layer_height"]
    assert (check.verdict, check.limit, check.unit) == ("FAILED", 60.0, "degrees")
    assert check.value == pytest.approx(np.degrees(np.arctan(2.0)), abs=2.0)
    assert re.match(r"\d+ of \d+ columns lie down, by up to 6\d degrees at", check.where)
    assert check.cause == "gap"


def test_without_following_walls_the_cause_is_named(hybrid_wing):
    w = hybrid_wing
    check = named(turn(w.mesh, WING, w.hinge, 20.0, slide={"symmetry": "plane"}, near_wall=False))["layer_height"]
    assert (check.verdict, check.cause) == ("FAILED", "following")
    assert check.as_dict()["cause"] == "following"


def test_a_flap_of_tetrahedra_has_no_layers_and_says_so(block):
    check = named(turn(block, box=TIGHT))["layer_height"]
    assert check.verdict == "not applicable"
    assert "layers of tetrahedra are not measured" in check.where


def test_the_worst_of_many_is_described():
    points = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    assert worst(np.zeros(2), points) == "2 nodes"
    assert worst(np.array([3.0, 4.0]), points) == "2 nodes, rms 3.5e+00, worst at (1.0000, 2.0000, 3.0000)"


def without(mesh, patch, kept):
    """The mesh with some rows of a patch's faces alone."""
    parts = [
        replace(one, faces=tuple(replace(f, nodes=f.nodes[kept]) for f in one.faces)) if one.name == patch else one
        for one in mesh.patches
    ]
    return replace(mesh, patches=tuple(parts))


@pytest.mark.parametrize("polyhedra", [False, True])
def test_boundary_on_no_patch_is_told_and_fails_where_its_nodes_are_free(block, polyhedra):
    whole = replace(block, cells=(as_polyhedra(block),)) if polyhedra else block
    faces = len(block.patch("body").faces[0])
    assert "boundary_on_no_patch" not in named(turn(whole, box=TIGHT))
    one_missing = named(turn(without(whole, "body", slice(1, None)), box=TIGHT))["boundary_on_no_patch"]
    assert (one_missing.value, one_missing.passed) == (0, True)
    assert "of 1 faces of the boundary" in one_missing.where
    side = np.abs(block.points[block.patch("body").faces[0].nodes].mean(axis=1)[:, 0] - 0.5) > 1e-9
    without_side = named(turn(without(whole, "body", side), box=TIGHT))["boundary_on_no_patch"]
    assert not without_side.passed
    assert without_side.value == 1
    assert f"of {faces // 6} faces of the boundary" in without_side.where


def test_faces_of_no_cell_and_moving_faces_between_two_cells_fail(block):
    (body,) = block.patch("body").faces
    (cells,) = block.cells
    beside = cells.nodes[np.isin(cells.nodes, body.nodes).any(axis=1)]
    inner = next(row for row in beside[:, [0, 1, 2, 3]] if not np.isin(row, body.nodes).all())
    for more, said in ((body.nodes[0, [0, 1, 2, 0]], "1 faces"), (inner, "0 faces")):
        patch = Patch("body", (body, Cells("quad", more[None])))
        found = named(turn(replace(block, patches=(patch, *block.patches[1:])), box=TIGHT))["faces_off_boundary"]
        assert (found.value, found.passed) == (1, False)
        assert found.where.startswith(said)


def test_a_cell_that_no_repair_can_mend_is_named_with_its_patches():
    """Every node of these cells is on the body, which turns, or on the outer faces, which stay."""
    mesh = block_with_body(3)
    outer = tuple(name for name in mesh.names if name != "body")
    result = turn(mesh, angle=80.0, fixed=outer, repair="auto", fitting=Fitting(max_steps=1))
    check = named(result)["inverted_cells"]
    assert not check.passed
    assert result.boxes[0].repaired.left == 0
    assert not len(result.boxes[0].repaired.moved)
    row = int(check.where.split("cell ")[1].split()[0])
    (cells,) = mesh.cells
    assert inverted_of(result.points, cells)[row]
    assert "(hexahedron) with nodes on" in check.where
    assert "body" in check.where
    assert check.where.endswith("all its nodes stay: no repair can mend it")
