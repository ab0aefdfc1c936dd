"""Where a hinge lies beside its surface: slips of units are refused, what is unusual is said, the rest is silent."""

import re
from dataclasses import replace

import numpy as np
import pytest

import sdm_deflect as sd
from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.run.metrics import farthest, travels, warnings_of
from sdm_deflect.deform.rbf.fitting import Fitting
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.deform.surface.placement import UNITS, Placement
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.edges import median_edge
from tests.deform.blocks import block_with_body
from tests.deform.jobs import job
from tests.deform.plates import plate

HINGE = np.array([[3.0, -0.5, 0.0], [3.0, 0.5, 0.0]])
AFT, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def mesh():
    """A unit cube, 3 from the origin, in a block."""
    mesh = block_with_body()
    return replace(mesh, points=mesh.points + 3.0 * AFT)


def test_a_hinge_is_measured_beside_its_surface(mesh):
    surface = Surface.of(mesh, ["body"])
    found = Placement.of(surface, Rotation.about([3.0, 0.0, 2.0], [3.0, 1.0, 2.0]).axis)
    assert found.width == pytest.approx(np.sqrt(2.0))
    assert found.distance == pytest.approx(1.5)
    assert found.covered == pytest.approx(0.5)
    assert not found.near
    assert Placement.of(surface, Rotation.about([3.0, 0.0]).axis).covered == 1.0  # one point: nothing to span


@pytest.mark.parametrize("factor", UNITS)
def test_a_hinge_in_another_unit_is_refused_with_the_factor(mesh, factor):
    other = replace(mesh, points=mesh.points * factor)
    match = rf"hinge: its line passes \S+ from body, which is \S+ wide across it; times {factor:.4g} it would fit"
    with pytest.raises(InputError, match=match):
        Plan.of(other, [job(["body"], HINGE, force=False)])


def warned(mesh, hinge, angle=1.0, force=False, **settings):
    return warnings_of(Plan.of(mesh, [replace(job(["body"], hinge, angle), force=force, **settings)]))


def test_a_hinge_that_is_far_away_in_any_unit_is_refused_unless_it_is_meant(mesh):
    far = "its line passes 1.5 from body, which is 1.414 wide across it"
    with pytest.raises(InputError, match=re.escape(f"hinge: {far}; correct it, or say --force (force = true) if")):
        warned(mesh, HINGE + 2.0 * UP)
    assert warned(mesh, HINGE + 2.0 * UP, force=True) == (f"hinge: {far}: is it the right one?",)


def test_a_hinge_beyond_a_quarter_of_the_width_is_warned_of(mesh):
    assert warned(mesh, HINGE + 0.8 * UP) == ()
    (text,) = warned(mesh, HINGE + 0.9 * UP)
    assert text == "hinge: its line passes 0.4 from body, which is 1.414 wide across it: is it the right one?"


@pytest.mark.parametrize(
    ("hinge", "said"),
    [
        ([[3.0, -0.5, 0.0], [3.0, -5.0, 0.0]], "its second point, (3, -5, 0), is 4.5 from body"),
        ([[30.0, -0.5, 0.0], [3.0, 0.5, 0.0]], "its first point, (30, -0.5, 0), is 26.5 from body"),
    ],
)
def test_a_point_with_a_wrong_digit_is_named(mesh, hinge, said):
    assert f"hinge: {said}, whose chord is 1: is it right?" in warned(mesh, hinge)


@pytest.mark.parametrize("hinge", [HINGE, [[3.0, -1.0, 0.0], [3.0, 1.4, 0.0]]])
def test_two_points_on_or_beside_the_surface_are_taken_silently(mesh, hinge):
    assert warned(mesh, hinge) == ()


@pytest.mark.parametrize(("last", "share"), [(-0.4, "10 %"), (-1.5, "0 %")])
def test_two_points_that_cover_little_of_the_span_are_warned_of(mesh, last, share):
    """Of a blended surface; where all of it turns, only the line counts."""
    found = Placement.of(Surface.of(mesh, ["body"]), Rotation.about([3.0, -0.5, 0.0], [3.0, last, 0.0]).axis)
    said = f"hinge: its two points cover {share} of the span of body: is it the right one?"
    assert said in found.warnings(blended=True)
    assert said not in found.warnings(blended=False)


def test_a_blended_surface_on_both_sides_of_its_hinge_is_warned_of(mesh):
    surface = Surface.of(mesh, ["body"])
    amidships, ahead = (Placement.of(surface, Rotation.about(*(HINGE - x * AFT)).axis) for x in (0.0, 0.5))
    assert list(amidships.warnings(blended=False)) == list(ahead.warnings(blended=True)) == []
    (text,) = amidships.warnings(blended=True)
    assert re.fullmatch(r"hinge: body, 1.414 wide, reaches 0\.7\d* ahead of it: is it right\?", text)


def test_a_tolerance_above_a_tenth_of_an_edge_is_warned_of(mesh):
    edge = median_edge(mesh.points, mesh.faces_of(["body"]))
    for share, count in ((0.09, 0), (0.11, 1)):
        texts = warned(mesh, HINGE, fitting=Fitting(tolerance=share * edge))
        assert len(texts) == count
        assert all("is above 0.1 of the surface's median edge" in text for text in texts)


def test_a_box_that_does_not_fit_says_so_beside_the_hinge(mesh):
    with pytest.raises(InputError, match=r"must not move.*; hinge: its line passes 3\.5 from body, .*the right one\?"):
        Plan.of(mesh, [replace(job(["body"], HINGE + 4.0 * UP, 40.0), force=True)])


def test_the_farthest_node_says_where_the_surface_goes(mesh):
    plan = Plan.of(mesh, [job(["body"], HINGE - 0.5 * AFT, 10.0)])  # about its front: the rear turns down
    ((name, place, move),) = farthest(plan, plan.largest)
    arm = np.array([[1.0, 0.0, -0.5], [1.0, 0.0, 0.5]])
    turned = plan.job.surfaces[0].motion.axis.matrix(10.0)
    assert name == "body"
    assert np.linalg.norm(move) == pytest.approx(np.linalg.norm(arm @ turned.T - arm, axis=1).max())
    assert move[2] < 0.0
    assert place[0] == pytest.approx(3.5)
    ((_, text),) = travels(plan, plan.largest)
    assert re.fullmatch(rf"{np.linalg.norm(move):.4g} towards -z, at \(3\.5, \S+, \S+\)", text)


def wave(points):
    return 0.05 * np.column_stack([np.sin(points[:, 1]), 0.0 * points[:, 0], np.cos(2.0 * points[:, 0])])


@pytest.fixture(scope="module")
def wing():
    """A slab, 1 by 4 by 0.5, of which the table knows all or some points."""
    mesh = block_with_body(8)
    return mesh.with_points(mesh.points * [1.0, 4.0, 0.5] + 2.0 * AFT)


def deflected(mesh, points, vectors=None, **settings):
    points = np.asarray(points, dtype=float)
    return sd.deflect(mesh, "body", None, 1.0, table=(points, wave(points) if vectors is None else vectors), **settings)


def skin(mesh):
    return mesh.points[mesh.on("body")]


@pytest.mark.parametrize("factor", UNITS)
def test_a_table_in_another_unit_is_refused_with_the_factor(wing, factor):
    points = skin(wing)
    with pytest.raises(InputError, match=rf"table: times {1.0 / factor:.4g} its points would lie where body does"):
        deflected(wing, factor * points)
    with pytest.warns(UserWarning, match=r"beyond its points|too coarse"):
        deflected(wing, factor * points, 0.0 * points, force=True)


@pytest.mark.parametrize("factor", [1e3, 0.0254])
def test_a_blended_table_lies_at_its_surface_too(wing, factor):
    """The box was refused for its far field, or a tiny displacement passed."""
    points, hinge = skin(wing), [[1.5, -2.0, 0.0], [1.5, 2.0, 0.0]]
    held = {"motion": "blended", "held": "edges:50", "driven": "edges:50"}
    with pytest.raises(InputError, match=rf"table: times {1.0 / factor:.4g} its points would lie where body does"):
        sd.deflect(wing, "body", hinge, 1.0, table=(factor * points, factor * wave(points)), **held)


@pytest.mark.parametrize("way", [30.0 * AFT, -9.0 * UP, np.array([0.0, 40.0, 0.0])])
def test_a_table_elsewhere_is_refused_unless_it_is_meant(wing, way):
    with pytest.raises(InputError, match=r"table: its points are \S+ from body, 4 long; correct it, or say --force"):
        deflected(wing, skin(wing) + way)


def test_a_table_of_its_own_nodes_is_exact_and_silent(wing):
    nodes, points = wing.on("body"), skin(wing)
    vectors = wave(points) + 1e-3 * np.random.default_rng(1).normal(size=points.shape)  # no smooth field
    found = deflected(wing, points[::-1], vectors[::-1])
    assert np.abs(found.displacement[nodes] - vectors).max() <= 4.0 * np.spacing(4.0)
    rounded = deflected(wing, np.round(points, 6), vectors)
    np.testing.assert_allclose(rounded.displacement[nodes], vectors, atol=1e-14)


def test_a_table_on_a_line_lacks_rotations_and_one_of_a_larger_wing_is_silent(wing):
    axis = np.column_stack([np.full(40, 2.0), np.linspace(-2.0, 2.0, 40), np.zeros(40)])
    bend, turns = np.outer(axis[:, 1] ** 2, UP) / 40, np.outer(axis[:, 1], [1.0, 0.0, 0.0]) / 20
    with pytest.warns(UserWarning, match="its points lie on a line and have no rotations, so that sections of body"):
        assert np.abs(deflected(wing, axis, bend).displacement).max() > 0.09
    sd.deflect(wing, "body", None, 1.0, table=(axis, bend, turns))
    larger = np.stack(np.meshgrid(np.linspace(0, 5, 21), np.linspace(-8, 8, 41), [-0.25, 0.25]), -1).reshape(-1, 3)
    deflected(wing, larger, wave(larger))


def test_what_a_table_does_not_cover_is_told(wing):
    points = skin(wing)
    with pytest.warns(UserWarning, match=r"table: \d+ % of the nodes of body lie beyond its points, by up to 2: "):
        deflected(wing, points[points[:, 1] <= 0.0])
    few = np.array([[x, y, z] for x in (1.5, 2.5) for y in (-2.0, 2.0) for z in (-0.25, 0.25)])
    with pytest.warns(UserWarning, match=r"nodes of body are farther than 0\.25 from its points: is it too coarse"):
        deflected(wing, few)


@pytest.mark.parametrize("points", [np.zeros((5, 2)), np.zeros((5, 4)), [[0.0, 1.0]], "x", np.full((5, 3), np.nan)])
def test_arrays_that_are_no_table_are_one_sentence(wing, points):
    with pytest.raises(InputError) as caught:
        sd.deflect(wing, "body", None, 1.0, table=(points, np.zeros((5, 3))))
    assert "table" in str(caught.value)
    with pytest.raises(InputError, match=r"must be a file, or points \(P, 3\) and displacements \(P, 3\)"):
        sd.deflect(wing, "body", None, 1.0, table=[points])


def test_nodes_shared_with_a_fixed_patch_stay_if_they_hardly_move():
    """A table of six digits was refused for 9e-8."""
    mesh = plate(20, "triangle")
    hole, parts = mesh.patch("hole"), {"flap": [], "foil": []}
    for line in np.vstack([faces.nodes for faces in hole.faces]):
        parts["flap" if mesh.points[line, 0].mean() > 0.2 else "foil"].append(line)
    cut = tuple(Patch(name, (Cells("line", np.array(lines)),)) for name, lines in parts.items())
    mesh = replace(mesh, patches=(*(one for one in mesh.patches if one.name != "hole"), *cut))
    nodes = mesh.on("flap")
    points, shared = mesh.points[nodes], np.isin(nodes, mesh.on("foil"))
    assert shared.sum() == 2

    def moved(slip):
        vectors = np.where(shared[:, None], slip, [0.0, -0.01, 0.0])
        return sd.deflect(mesh, "flap", None, 1.0, table=(points, vectors), fixed="foil", margin=0.4)

    found = moved(9e-8)
    assert not found.displacement[nodes[shared]].any()
    assert found.displacement[nodes[~shared], 1] == pytest.approx(-0.01)
    with pytest.raises(
        InputError, match=r"would move by up to .*; let the table fall to zero there, or let foil slide"
    ):
        moved(0.005)
