"""The box and what is in it: what moves, what must not be there, sections of overlapping blocks, zones."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.box.automatic import Automatic
from sdm_deflect.deform.box.hexahedron import Hexahedron, box
from sdm_deflect.deform.checks import checks_of, left_behind
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.deform.volume.boundary import PrescribedMotion
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import Section
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.deform.volume.region import check_disjoint, confining_box, shared_depth
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Zone
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import block_with_body, joined
from tests.deform.jobs import FLAP, Y_AXIS, job, turn

LOW, HIGH = np.zeros(3), np.ones(3)
BEYOND = (
    r"\d+ of 24 moving nodes of body leave the box at 10; enlarge it \(box\): they reach from "
    r"\(-0\.57\d+, -0\.5, -0\.57\d+\) to \(0\.57\d+, 0\.5, 0\.57\d+\)"
)


@pytest.mark.parametrize(("gap", "depth"), [(-0.4, 0.2), (0.0, 0.0), (0.6, -0.3)])
def test_depth_of_two_boxes(gap, depth):
    shift = np.array([1.0 + gap, 0.0, 0.0])
    assert shared_depth(box(LOW, HIGH), box(LOW + shift, HIGH + shift)) == pytest.approx(depth, abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_depth_is_symmetric_turns_with_the_boxes_and_is_positive_where_they_share_a_point(seed):
    rng = np.random.default_rng(seed)
    q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    q *= np.linalg.det(q)
    a, b = (box(centre - size, centre + size) for centre, size in rng.uniform(0.2, 1.5, (2, 2, 3)))
    turned = [Hexahedron(one.corners @ q.T + 2.0) for one in (a, b)]
    depth = shared_depth(a, b)
    assert shared_depth(b, a) == pytest.approx(depth, abs=1e-9)
    assert shared_depth(*turned) == pytest.approx(depth, abs=1e-8)
    # Of two boxes along the axes the shared part is one, too, where there is any.
    low, high = np.maximum(a.corners[0], b.corners[0]), np.minimum(a.corners[7], b.corners[7])
    assert (depth > 0.0) == bool((high > low).all())
    if depth > 0.0:
        assert depth == pytest.approx((high - low).min() / 2.0, abs=1e-9)


def test_boxes_that_overlap_are_named_with_their_depth():
    def named(shift):
        return [(name, box(LOW + k * shift, HIGH + k * shift)) for k, name in enumerate(("flap", "tab", "rudder"))]

    check_disjoint(named(np.array([1.0, 0.0, 0.0])))  # they only touch
    check_disjoint(named(np.array([1.0 - 1e-11, 0.0, 0.0])))
    check_disjoint([])
    with pytest.raises(InputError, match=r"the boxes of flap and tab overlap by 0\.25; make them smaller \(box\)"):
        check_disjoint(named(np.array([0.75, 0.0, 0.0])))
    beside = np.array([4.5, 0.9, 0.0])
    far = [*named(np.array([2.0, 0.0, 0.0])), ("tail", box(LOW + beside, HIGH + beside))]
    with pytest.raises(InputError, match=r"the boxes of rudder and tail overlap by 0\.1"):
        check_disjoint(far)


def test_an_automatic_box_holds_the_motion_on_its_way(block):
    made = job(("body",), angle=90.0, box=Automatic(0.01))
    law, points = Rotation.about(*Y_AXIS), block.points[block.on("body")]
    hexahedron = confining_box(PrescribedMotion.of(block, made), [(90.0,)])[1].hexahedron
    for angle in (0.0, 22.5, 45.0, 67.5, 90.0):
        assert hexahedron.contains(points + law.axis.displacement(points, angle), 1e-9).all()


def test_a_surface_that_leaves_the_box(block):
    with pytest.raises(InputError, match=BEYOND):
        turn(block, box=[[-0.4, -1, -1], [1, 1, 1]])


def test_a_box_that_cuts_another_patch_names_it_and_counts(block):
    sentence = r"the box contains \d+ of 81 nodes of x\+, which must not move; name it in fixed or slide \(x\+:plane\)"
    with pytest.raises(InputError, match=sentence):
        turn(block, box=[[-1, -1, -1], [3, 1, 1]])


def test_patches_that_share_nodes_with_the_surface_must_be_declared(hybrid_wing):
    w = hybrid_wing
    with pytest.raises(
        InputError, match=r"\d+ nodes of the moving surface also belong to wing_upper; name it in fixed$"
    ):
        turn(w.mesh, FLAP, w.hinge, slide={"symmetry": "plane"})


def test_a_patch_that_shares_nodes_outside_the_box_is_to_be_declared_as_well(block):
    """A plane z = 2 moves within a box that holds no further node of its neighbours."""
    flat = [[-1.9, -1.9, 1.9], [1.9, 1.9, 2.6]]
    still = Rotation.about([0, 0, 2], [1, 0, 2])
    with pytest.raises(InputError, match=r"mesh: 9 nodes of the moving surface also belong to x-; name it in fixed or"):
        turn(block, ("z+",), motion=still, angle=0.0, box=flat)
    result = turn(block, ("z+",), motion=still, angle=0.0, box=flat, fixed=("*",))
    assert np.array_equal(result.points, block.points)


def test_an_automatic_box_gives_way_to_other_patches(block):
    result = turn(block)
    assert "give way" not in result.plan.boxes[0].region.box.why
    wide = turn(block, box=Automatic(margin=1.6))
    assert "faces that give way to other patches" in wide.plan.boxes[0].region.box.why
    corners = wide.plan.boxes[0].region.hexahedron.corners
    assert np.abs(corners).max() < 2.0


def test_coincident_nodes_move_as_one_and_are_counted(block):
    """A patch with nodes of its own at the same places, as thin walls have them."""
    n, body = len(block.points), block.patch("body")
    nodes = body.nodes
    place = np.full(n, -1)
    place[nodes] = n + np.arange(len(nodes))
    second = Patch("back", tuple(Cells(f.shape, place[f.nodes]) for f in body.faces))
    points = np.vstack([block.points, block.points[nodes]])
    doubled = replace(block, points=points, patches=(*block.patches, second), zones=())
    result = turn(doubled, ("body", "back"))
    assert np.array_equal(result.points[n:], result.points[nodes])
    assert result.plan.boxes[0].sites.coincident == 26
    with pytest.raises(InputError, match=r"24 nodes of the moving surface lie exactly on nodes that move otherwise"):
        turn(doubled, fixed=("back",))


def test_zones(block):
    apart = joined(block, block.with_points(block.points + np.array([10.0, 0.0, 0.0])))
    result = turn(apart)
    n = len(block.points)
    assert result.plan.boxes[0].region.zones == ("near",)
    assert np.array_equal(result.points[n:], apart.points[n:])
    assert np.array_equal(result.points[:n], turn(block).points)
    over = joined(block, block.with_points(0.251 * block.points + [0.7531, 0.013, 0.017]))
    assert np.array_equal(turn(over).points[n:], over.points[n:])
    both = turn(over, zones=("far",), fixed=("*'",))
    assert np.any(both.points[n:] != over.points[n:])
    with pytest.raises(InputError, match="zones: 'north' is no zone; the zones are near, far"):
        turn(over, zones=("north",))


def test_zones_that_fit_must_deform_together(block):
    """Half of the points of the mesh in a zone of their own: the two touch where they were cut."""
    (cells,) = block.cells
    right = block.points[cells.nodes].mean(axis=1)[:, 0] > 1.0
    parts = [np.unique(cells.nodes[own]) for own in (~right, right)]
    place = [np.searchsorted(part, cells.nodes[own]) for part, own in zip(parts, (~right, right), strict=True)]
    n = len(parts[0])
    body = Patch("body", (Cells("quad", np.searchsorted(parts[0], block.patch("body").faces[0].nodes)),))
    mesh = Mesh(
        np.vstack([block.points[part] for part in parts]),
        (Cells("hexahedron", np.vstack([place[0], n + place[1]])),),
        (body,),
        (Zone("left", 0, n), Zone("right", n, n + len(parts[1]))),
        name="pair",
    )
    wide = [[-1.9, -1.9, -1.9], [1.9, 1.9, 1.9]]
    alone, together = (turn(mesh, box=wide, zones=zones) for zones in ((), ("right",)))
    check = left_behind(alone)
    assert not check.passed
    assert re.match(
        r"\d+ of zone 'right'; moving nodes that were there are now up to 0\.\d+ away: let the zone", check.where
    )
    assert left_behind(together).passed
    gap = np.abs(together.points[:n, None] - together.points[None, n:]).max(axis=2)
    before = np.abs(mesh.points[:n, None] - mesh.points[None, n:]).max(axis=2)
    assert (before == 0.0).any()
    assert gap[before == 0.0].max() == 0.0


# A box that the lower face of the block cuts, z = -2, as faces of a Chimera block do.
CUT = [[-1.6, -1.6, -2.5], [1.6, 1.6, 1.6]]


def cut(block, slides, z=-2.0):
    section = Section("z-", np.array([0.0, 0.0, z]), 2, slides)
    return Plan.of(block, [job(("body",), box=CUT, sections=(section,), near_wall=False)])


def test_without_a_section_the_patch_must_not_be_in_the_box(block):
    for fixed in ((), ("z-",)):
        with pytest.raises(InputError, match=r"the box contains \d+ of 81 nodes of z-, which must not move; take"):
            turn(block, box=CUT, near_wall=False, fixed=fixed)


def test_nodes_of_a_section_slide_in_its_plane_and_no_other_boundary_node_moves(block):
    plan = cut(block, True)
    ((section, nodes),) = plan.boxes[0].region.sections
    inside = plan.boxes[0].region.hexahedron.contains(block.points)
    assert section.patch == "z-"
    assert np.array_equal(nodes, np.flatnonzero(inside & (block.points[:, 2] == -2.0)))
    result = deflect(plan)
    assert np.array_equal(result.points[nodes, 2], block.points[nodes, 2])
    assert (result.points[nodes, :2] != block.points[nodes, :2]).any()
    others = np.setdiff1d(block.on("x-", "x+", "y-", "y+", "z-", "z+"), nodes)
    assert np.array_equal(result.points[others], block.points[others])


def test_nodes_on_a_section_and_a_sliding_patch_stay_on_both():
    """They are no free nodes: no other node's component is set to zero in their stead."""
    section = Section("z-", np.array([0.0, 0.0, -2.0]), 2)
    box, mesh = [[-1.7, -2.5, -2.5], [1.7, 1.7, 1.7]], block_with_body(8)
    plan = Plan.of(mesh, [job(("body",), angle=10.0, box=box, sections=(section,), slide={"y-": "plane"})])
    ((_, nodes),) = plan.boxes[0].region.sections
    both = np.intersect1d(nodes, mesh.on("y-"))
    moved = deflect(plan, (10.0,)).points - mesh.points
    assert len(both) == 7
    assert np.all(moved[both][:, [1, 2]] == 0.0)
    assert np.any(moved[both, 0])
    inner = np.setdiff1d(plan.boxes[0].region.inside, mesh.on(*mesh.names))
    assert np.all(moved[inner, 2] != 0.0)


def test_sites_of_a_section_are_for_its_normal_alone(block):
    plan = cut(block, True)
    sliding, held = plan.boxes[0].sites, cut(block, False).boxes[0].sites
    faces, section = sliding.zero
    assert (faces.components, section.components) == ((0, 1, 2), (2,))
    np.testing.assert_allclose(section.points[:, 2], -2.0)
    assert sliding.zero_sites(2) == sliding.zero_sites(0) + len(section)
    assert held.zero_sites(2) == held.zero_sites(0) == sliding.zero_sites(2)


def test_a_section_that_does_not_slide_keeps_the_bits_of_its_nodes(block):
    plan = cut(block, False)
    assert plan.boxes[0].region.sections == ()
    own = np.intersect1d(block.on("z-"), plan.boxes[0].region.inside)
    assert len(own)
    assert np.isin(own, plan.boxes[0].region.fixed).all()
    result = deflect(plan)
    assert np.array_equal(result.points[own], block.points[own])
    assert np.any(result.points != block.points)


def test_a_section_elsewhere_is_no_excuse(block):
    with pytest.raises(InputError, match=r"the box contains \d+ of 81 nodes of z-, which must not move"):
        cut(block, True, z=-1.0)


def test_without_near_wall_following_boundary_nodes_in_a_face_of_the_box_keep_their_bits(block):
    """Undeclared patches may touch the box; their nodes there are no sites, but stay."""
    plan = Plan.of(block, [job(("body",), box=[[-1.5, -1.5, -2.0], [1.5, 1.5, 1.5]], near_wall=False)])
    held = np.intersect1d(block.on("z-"), plan.boxes[0].region.inside)
    assert len(held)
    assert np.array_equal(plan.boxes[0].region.fixed, held)
    assert len(plan.boxes[0].sites.sampled) == 0
    result = deflect(plan)
    assert np.array_equal(result.points[held], block.points[held])
    checks = {check.name: check for check in checks_of(result)}
    assert checks["fixed_surfaces_moved"].over == len(held)


def test_without_near_wall_following_the_free_nodes_go_where_the_interpolant_says(block):
    plan = Plan.of(block, [job(("body",), box=[[-1.5, -1.5, -1.5], [1.5, 1.5, 1.5]], near_wall=False)])
    step = deflect(plan).boxes[0].steps[-1]
    free = step.start.free
    expected = block.points[free] + step.fits.interpolant(block.points[free])
    assert np.array_equal(step.points[free], expected)
    assert step.start.modifiers == ()
