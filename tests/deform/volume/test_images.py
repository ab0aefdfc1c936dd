"""Nodes that are images of one another: of periodic pairs, by translation and rotation, and of cases one cell thick."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.box.automatic import Outline
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.deform.surface.surface import OnPatches
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Periodic
from sdm_deflect.meshing.mesh.images import Images
from sdm_deflect.meshing.mesh.selection import Selection, Within, with_selections
from sdm_deflect.meshing.repair import region as goal
from tests.deform.blocks import block_with_body
from tests.deform.jobs import job, placed, sensitivity
from tests.deform.paired import about_x, airfoil, bound, sector, wedge
from tests.deform.plates import plate

SMALL = {"around": 32, "outwards": 8}
AIRFOIL = [[0.7, 0.0, 0.0], [0.7, 0.3, 0.0]]
BLADE = [[0.5, 0.0, 1.1], [0.5, 0.0, 1.5]]
RING = [[0.6, 0.55, 0.0], [0.6, 0.55, 0.1]]


def cyclic(**options):
    return bound(airfoil(3, 0.3, **SMALL, **options), "side0", "side1", shift=(0.0, 0.3, 0.0))


def made(name):
    """A mesh, and a job that turns its flap by 10 degrees."""

    def flap(hinge, held, fixed, **more):
        motion = Blended(Rotation.about(*hinge), held=OnPatches(held))
        return job(["flap"], motion=motion, angle=10.0, fixed=fixed, **more)

    if name == "cyclic":
        return cyclic(), flap(AIRFOIL, ("wing",), ("wing",))
    if name == "empty":
        mesh = bound(airfoil(1, 0.1, **SMALL), "side0", "side1", shift=(0.0, 0.1, 0.0), constraint="empty")
        return mesh, flap(AIRFOIL, ("wing",), ("wing",))
    if name == "sector":
        mesh = bound(sector(), "left", "right", about_x(-30.0))
        return mesh, flap(BLADE, ("blade",), ("blade", "hub", "casing"))
    mesh = bound(wedge(), "front", "back", about_x(5.0), constraint="wedge")
    return mesh, flap(RING, ("ring",), ("ring",))


KINDS = ("cyclic", "empty", "sector", "wedge")


@pytest.fixture(scope="module")
def turned():
    known = {}

    def turn(name):
        if name not in known:
            mesh, wanted = made(name)
            known[name] = deflect(Plan.of(mesh, [wanted]), (10.0,))
        return known[name]

    return turn


def apart(mesh, points):
    """The largest distance of a node from its partner's image."""
    gaps = [pair.image(points[pair.nodes[:, 0]]) - points[pair.nodes[:, 1]] for pair in mesh.periodic]
    return max(float(np.abs(gap).max()) for gap in gaps)


def checked(result):
    return {check.name: check for check in checks_of(result)}


@pytest.mark.parametrize("name", KINDS)
def test_what_becomes_of_displacements_is_an_orthogonal_projection(name):
    mesh, _ = made(name)
    images = Images.of(mesh)
    a, b = np.random.default_rng(3).normal(size=(2, *mesh.points.shape))
    once = images.projected(a)
    np.testing.assert_allclose(images.projected(once), once, atol=1e-14)
    np.testing.assert_allclose(np.sum(once * b), np.sum(a * images.projected(b)), rtol=1e-12)
    for pair in mesh.periodic:
        first, second = once[pair.nodes.T]
        np.testing.assert_allclose(second, first @ pair.rotation.T, atol=1e-14)


def test_corners_of_several_pairs_move_as_one():
    mesh = block_with_body(4)
    for one, axis in (("x-", 0), ("y-", 1), ("z-", 2)):
        mesh = bound(mesh, one, f"{one[0]}+", shift=4.0 * np.eye(3)[axis])
    images = Images.of(mesh)
    assert sorted(set(np.bincount(images.group).tolist())) == [2, 4, 8]
    corners = np.flatnonzero((np.abs(mesh.points) == 2.0).all(axis=1))
    moved = images.projected(np.random.default_rng(1).normal(size=mesh.points.shape))[corners]
    assert len(corners) == 8
    assert (moved == moved[0]).all()


def test_nodes_on_the_axis_stay_on_it():
    mesh, _ = made("wedge")
    on = np.flatnonzero(np.hypot(mesh.points[:, 1], mesh.points[:, 2]) == 0.0)
    moved = Images.of(mesh).projected(np.ones(mesh.points.shape))
    assert len(on) == 37
    assert (moved[on] == [1.0, 0.0, 0.0]).all()
    normal = about_x(2.5)[2]
    np.testing.assert_allclose(moved[mesh.patch("front").nodes] @ normal, 0.0, atol=1e-15)


@pytest.mark.parametrize("name", KINDS)
def test_pairs_are_kept_and_checked(name, turned):
    result = turned(name)
    mesh, points = result.plan.mesh, result.points
    assert apart(mesh, points) <= 4e-16 * np.abs(points).max() + apart(mesh, mesh.points)
    found = checked(result)
    check = next(found[key] for key in found if key.startswith(("periodic_", "plane_")))
    assert all(one.passed for one in found.values())
    moved = (points != mesh.points).any(axis=1)
    assert moved[mesh.periodic[0].nodes].all(axis=1).sum() > 30
    torn = points.copy()
    torn[mesh.periodic[0].nodes[moved[mesh.periodic[0].nodes[:, 0]]][0, 0]] += 1e-9
    assert not checked(placed(result, torn))[check.name].passed


def test_a_case_one_cell_thick_is_as_plane_as_it_was(turned):
    result = turned("empty")
    mesh, points = result.plan.mesh, result.points
    front, back = mesh.periodic[0].nodes.T
    assert np.array_equal(points[:, 1], mesh.points[:, 1])
    assert np.array_equal(points[front][:, [0, 2]], points[back][:, [0, 2]])


@pytest.mark.parametrize("name", KINDS)
def test_sensitivities_are_central_differences(name, turned):
    result, h = turned(name), 1e-3
    ends = [deflect(result.plan, (10.0 + d,), earlier=result).points for d in (-h, h)]
    rate = sensitivity(result)
    np.testing.assert_allclose(rate, (ends[1] - ends[0]) / (2.0 * h), atol=2e-8)
    for pair in result.plan.mesh.periodic:
        np.testing.assert_allclose(rate[pair.nodes[:, 1]], rate[pair.nodes[:, 0]] @ pair.rotation.T, atol=1e-15)


@pytest.mark.parametrize(("name", "angle"), [("cyclic", 45.0), ("empty", 45.0), ("sector", 25.0), ("wedge", 30.0)])
def test_a_repair_moves_images_alike(name, angle, monkeypatch):
    monkeypatch.setattr(goal, "LOST", 1.0)
    mesh, wanted = made(name)
    wanted = replace(wanted.at((angle,)), repair=replace(wanted.repair, mode="auto", share=0.98))
    result = deflect(Plan.of(mesh, [wanted]), (angle,))
    moved = np.isin(mesh.periodic[0].nodes, result.boxes[0].repaired.moved)
    assert moved.all(axis=1).any()
    assert np.array_equal(moved[:, 0], moved[:, 1])
    assert apart(mesh, result.points) <= 1e-15 * np.abs(mesh.points).max() + apart(mesh, mesh.points)


def test_images_of_nodes_that_stay_or_are_beyond_the_box_stay():
    mesh = bound(block_with_body(), "y-", "y+", shift=[0.0, 4.0, 0.0])
    low, high = [-1.8, -2.1, -1.8], [1.8, 1.8, 1.8]  # the nodes of y+ are outside
    result = deflect(Plan.of(mesh, [job(["body"], box=[low, high])]), (10.0,))
    side = mesh.patch("y-").nodes
    assert np.isin(side, result.plan.boxes[0].region.inside).any()
    assert np.array_equal(result.points[side], mesh.points[side])
    assert all(check.passed for check in checks_of(result))
    wide = job(["body"], box=[[-1.8, -2.1, -1.8], [1.8, 2.1, 1.8]])
    assert (deflect(Plan.of(mesh, [wide]), (10.0,)).points[side] != mesh.points[side]).any()
    held = deflect(Plan.of(mesh, [replace(wide, fixed=("y+",))]), (10.0,))
    assert np.array_equal(held.points[side], mesh.points[side])


REFUSED = {
    "slide": (lambda j: replace(j, slides=job(["flap"], slide={"side0": "surface"}).slides), "side0 is one side of a"),
    "moves": (lambda j: replace(j, surfaces=job(["flap", "side1"]).surfaces), "side1 is one side of a periodic pair"),
    "hinge": (
        lambda j: replace(j, surfaces=job(["flap", "wing"], [[0.7, 0, 0], [0.7, 0, 1]]).surfaces, fixed=()),
        "would move unlike their periodic images, by up to .* the hinge must fit to the periodicity",
    ),
    "held": (lambda j: replace(j, fixed=("wing", "side1")), "nodes shared by the moving surface and side1"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_a_pair_cannot_do_is_refused(name):
    mesh, wanted = made("cyclic")
    change, said = REFUSED[name]
    with pytest.raises(InputError, match=said):
        Plan.of(mesh, [change(wanted)])


def test_a_plane_case_turns_within_its_plane():
    mesh, wanted = made("empty")
    tilted = job(["flap", "wing"], [[0.7, 0.0, 0.0], [0.7, 1.0, 0.5]]).surfaces
    with pytest.raises(InputError, match=r"would leave the plane of the mesh by .*; the hinge must be normal to it"):
        Plan.of(mesh, [replace(wanted, surfaces=tilted, fixed=())])
    with pytest.raises(InputError, match="patch side0 is empty, so that its nodes move as their images do"):
        Plan.of(mesh, [replace(wanted, slides=job(["flap"], slide={"side*": "cylinder"}).slides)])


def test_sides_that_do_not_match_stay_out_of_the_box():
    mesh, wanted = made("cyclic")
    pair = replace(mesh.periodic[0], nodes=np.empty((0, 2), dtype=int))
    mesh = replace(mesh, periodic=(pair,))
    with pytest.raises(InputError, match=r"also belong to side0; the sides of side0 and side1 do not match"):
        Plan.of(mesh, [wanted])
    with pytest.raises(InputError, match="side0, which is fixed, would move"):
        Plan.of(mesh, [replace(wanted, fixed=("wing", "side0", "side1"))])


def test_planes_of_symmetry_slide_without_being_asked():
    mesh, wanted = made("cyclic")
    mesh = replace(mesh, periodic=(), patches=tuple(
        replace(p, constraint="symmetry" if p.name.startswith("side") else "") for p in mesh.patches
    ))  # fmt: skip
    plan = Plan.of(mesh, [wanted])
    asked = Plan.of(mesh, [replace(wanted, slides=job(["flap"], slide={"side*": "plane"}).slides)])
    assert np.array_equal(deflect(plan, (10.0,)).points, deflect(asked, (10.0,)).points)


@pytest.mark.parametrize(("name", "sides"), [("sector", ["left"]), ("empty", ["side0", "side1"])])
def test_a_pair_may_be_kept_plane(name, sides, turned):
    mesh, wanted = made(name)
    slides = job(["flap"], slide=dict.fromkeys(sides, "plane")).slides
    result = deflect(Plan.of(mesh, [replace(wanted, slides=slides)]), (10.0,))
    if name == "empty":
        assert np.array_equal(result.points, turned(name).points)
    for patch, degrees in (("left", -15.0), ("right", 15.0)) if name == "sector" else ():
        normal, nodes = about_x(degrees)[1], mesh.patch(patch).nodes
        assert np.abs(result.points[nodes] @ normal).max() < 1e-15
        assert np.abs(turned(name).points[nodes] @ normal).max() > 1e-3


def test_a_plane_mesh_has_pairs():
    mesh = plate()
    middle = np.concatenate([mesh.points[line].mean(axis=0)[None] for line in mesh.patch("rest").faces[0].nodes])
    lines = mesh.patch("rest").faces[0].nodes
    ends = {"left": middle[:, 0] < -0.99, "right": middle[:, 0] > 0.99, "top": np.abs(middle[:, 0]) < 0.99}
    parts = (Patch(name, (Cells("line", lines[own]),)) for name, own in ends.items())
    mesh = bound(replace(mesh, patches=(*mesh.patches[:2], *parts)), "left", "right", shift=[2.0, 0.0, 0.0])
    box = Outline.at(np.array([[-1.1, -0.9], [1.1, 0.9]]))
    wanted = job(["hole"], hinge=[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], box=box)
    result = deflect(Plan.of(mesh, [wanted]), (8.0,))
    left, right = mesh.periodic[0].nodes.T
    assert np.array_equal(result.points[left, 1], result.points[right, 1])
    assert np.abs(result.points[left] - mesh.points[left]).max() > 1e-3
    assert all(check.passed for check in checks_of(result))


def test_parts_of_a_pair_cannot_be_selected():
    mesh, _ = made("cyclic")
    with pytest.raises(InputError, match="patch side0 is one side of a pair"):
        with_selections(mesh, [Selection("part", "side0")])
    some = with_selections(made("empty")[0], [Selection("tip", "flap", (Within((0.9, -1.0, -1.0), (1.1, 1.0, 1.0)),))])
    assert [p.constraint for p in some.patches if p.name.startswith("side")] == ["empty"] * 2
    assert len(some.periodic) == 1


def test_a_pair_of_coincident_nodes_moves_as_one():
    mesh = block_with_body(4)
    nodes = np.array([[0, 0], [1, 2]])
    images = Images.of(replace(mesh, periodic=(Periodic("baffle", ("x-", "x-"), nodes),)))
    moved = images.projected(np.arange(3.0 * len(mesh.points)).reshape(-1, 3))
    assert (moved[0] == [0.0, 1.0, 2.0]).all()
    assert (moved[1] == moved[2]).all()
