"""What a user may get wrong: one sentence that names file, patch and count."""

from dataclasses import replace

import numpy as np
import pytest
from sdm_deflect.cases.own import deflect

from sdm_deflect.cases.errors import InputError
from sdm_deflect.deform.mesh import Cells, Mesh, Patch
from sdm_deflect.deform.volume.region import Region
from tests.deform.blocks import joined
from tests.meshing.formats.examples import hybrid

HINGE = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


def turn(mesh, **given):
    wanted = {"surfaces": ("body",), "hinge": HINGE, "angle": 10.0, **given}
    return deflect(mesh, **wanted)


def test_a_hinge_of_zero_length(block):
    with pytest.raises(InputError, match="the hinge has no length: both its points are at 1, 2, 3"):
        turn(block, hinge=[[1, 2, 3], [1, 2, 3]])


@pytest.mark.parametrize("given", [{"surfaces": ("boddy",)}, {"fixed": ("boddy",)}, {"slide": {"boddy": "plane"}}])
def test_an_unknown_marker_with_the_nearest_names(block, given):
    with pytest.raises(InputError, match=r"'boddy' is no patch; did you mean body\?"):
        turn(block, **given)


def test_an_unknown_marker_like_none(block):
    with pytest.raises(InputError, match="the patches are body, x-, x"):
        turn(block, surfaces=("flaperon",))


@pytest.mark.parametrize("angle", [91.0, -120.0, float("nan"), float("inf")])
def test_an_angle_out_of_range(block, angle):
    with pytest.raises(InputError, match=f"angle = {angle:g}"):
        turn(block, angle=angle)


def test_a_surface_that_crosses_the_box(block):
    with pytest.raises(InputError, match=r"\d+ of 24 moving nodes of body cross the box at 10; enlarge it"):
        turn(block, box=[[-0.4, -1, -1], [1, 1, 1]])


def test_a_box_that_cuts_another_patch_names_it_and_counts(block):
    with pytest.raises(InputError, match=r"the box contains \d+ of 81 nodes of x\+; name it in --fixed x\+"):
        turn(block, box=[[-1, -1, -1], [3, 1, 1]])


def test_an_automatic_box_gives_way_to_other_patches(block):
    result = turn(block)
    assert "give way" not in result.plan.region.why
    wide = turn(block, box=type(result.plan.job.box)(margin=1.6))
    assert "faces that give way to other patches" in wide.plan.region.why
    corners = wide.plan.region.hexahedron.corners
    assert np.abs(corners).max() < 2.0


def test_coordinates_that_are_not_numbers(block):
    points = np.array(block.points)
    points[[3, 7], 1] = np.nan
    with pytest.raises(InputError, match="arrays: 2 points are not finite, the first is point 3"):
        turn((points, {"body": block.on("body")}))


def test_a_mesh_that_is_inverted_already(block):
    points = np.array(block.points)
    inner = np.setdiff1d(np.arange(len(points)), block.on(*(p.name for p in block.patches)))
    points[inner[0]] += [1.2, 0.0, 0.0]
    broken = block.with_points(points)
    with pytest.raises(InputError, match=r"mesh: \d+ of 504 cells \(hexahedron\) are inverted in the file already"):
        turn(broken)
    result = turn(broken, allow_inverted=True)
    assert any("inverted in the file" in why for why in notes(result))


def notes(result):
    from sdm_deflect.cases.own.report import notes_of

    return notes_of(result.plan)


def test_a_mesh_numbered_left_handed_is_taken_and_noted(block):
    (cells,) = block.cells
    mirrored = replace(block, cells=(Cells("hexahedron", cells.nodes[:, [4, 5, 6, 7, 0, 1, 2, 3]]),))
    result = turn(mirrored)
    assert result.report.passed
    assert any("left-handed" in note for note in notes(result))
    assert np.array_equal(result.points, turn(block).points)


def test_coincident_nodes_move_as_one_and_are_reported(block):
    """A patch with nodes of its own at the same places, as thin walls have them."""
    n, body = len(block.points), block.patch("body")
    nodes = body.nodes
    place = np.full(n, -1)
    place[nodes] = n + np.arange(len(nodes))
    second = Patch("back", tuple(Cells(f.shape, place[f.nodes]) for f in body.faces))
    doubled = replace(block, points=np.vstack([block.points, block.points[nodes]]), patches=(*block.patches, second),
                      zones=())  # fmt: skip
    result = turn(doubled, surfaces=("body", "back"))
    assert np.array_equal(result.points[n:], result.points[nodes])
    assert any("26 moving nodes coincide with others" in note for note in notes(result))
    with pytest.raises(InputError, match=r"24 nodes of the moving surface lie exactly on nodes that move otherwise"):
        turn(doubled, fixed=("back",))


def test_patches_that_share_nodes_with_the_surface_must_be_declared(hybrid_wing):
    w = hybrid_wing
    with pytest.raises(InputError, match=r"nodes of wing_upper \(\d+ shared with the moving surface\)"):
        deflect(w.mesh, ("flap_*",), w.hinge, 10.0, slide={"symmetry": "plane"})


def test_a_rigid_surface_cannot_share_moving_nodes_with_a_fixed_one(hybrid_wing):
    w = hybrid_wing
    with pytest.raises(InputError, match=r"\d+ nodes shared by the moving surface and wing_\w+, which is fixed"):
        deflect(w.mesh, ("flap_*",), w.hinge, 10.0, fixed=("wing_*",), slide={"symmetry": "plane"})


def test_nodes_shared_by_two_moving_patches_move_once(hybrid_wing):
    w = hybrid_wing
    both = np.intersect1d(w.mesh.on("flap_upper"), w.mesh.on("flap_base"))
    result = deflect(w.mesh, ("wing_*", "flap_*"), w.hinge, 10.0, slide={"symmetry": "plane"})
    expected = result.plan.job.surfaces[0].motion.axis.rotated(w.mesh.points[both], 10.0)
    assert len(both)
    np.testing.assert_allclose(result.points[both], expected, atol=1e-14)


def test_a_patch_has_one_part(block):
    with pytest.raises(InputError, match="patch body cannot be moving and fixed at once"):
        turn(block, fixed=("body",))
    assert turn(block, fixed=("*",)).plan.boundary.fixed == ("x-", "x+", "y-", "y+", "z-", "z+")


def test_an_unknown_slide_shape(block):
    with pytest.raises(InputError, match="--slide x-:sphere: the shape must be plane or cylinder"):
        turn(block, slide={"x-": "sphere"})


def test_something_that_is_no_mesh():
    with pytest.raises(InputError, match="a dict is no mesh"):
        deflect({}, ("a",), HINGE, 1.0)


def test_the_mesh_given_is_never_touched(block):
    before = block.points.copy()
    turn(block)
    assert np.array_equal(block.points, before)


def test_zones(block):
    apart = joined(block, block.with_points(block.points + np.array([10.0, 0.0, 0.0])))
    result = turn(apart)
    n = len(block.points)
    assert result.plan.region.zones == ("near",)
    assert np.array_equal(result.points[n:], apart.points[n:])
    assert np.array_equal(result.points[:n], turn(block).points)
    over = joined(block, block.with_points(0.251 * block.points + [0.7531, 0.013, 0.017]))
    assert np.array_equal(turn(over).points[n:], over.points[n:])
    both = turn(over, zones=("far",), fixed=("*'",))
    assert np.any(both.points[n:] != over.points[n:])
    with pytest.raises(InputError, match="--zone 'north' is no zone; the zones are near, far"):
        turn(over, zones=("north",))


def test_zones_that_fit_must_deform_together():
    mesh = hybrid(zones=2)
    assert Region is not None
    with pytest.raises(InputError):
        deflect(mesh, ("roof",), HINGE, 5.0)


def test_a_wildcard_stands_for_a_patch_in_every_zone_and_a_plain_name_does_not():
    names = ("block/wing_left", "background/wing_left", "wing_right", "tail")
    points = np.zeros((1, 3))
    subject = Mesh(points, (), tuple(Patch(name, (), np.array([0])) for name in names), name="pair.cgns")
    assert subject.named(["wing*"], "--fixed") == names[:3]
    assert subject.named(["block/*"], "--fixed") == names[:1]
    with pytest.raises(InputError, match=r"'wing_left' is no patch; did you mean .*block/wing_left"):
        subject.named(["wing_left"], "--fixed")
