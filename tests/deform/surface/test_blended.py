"""Surfaces blended between nodes that stay and nodes that follow."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.surface import blended
from sdm_deflect.deform.surface.blended import Blended, Rib
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.deform.surface.surface import Listed, OnPatches, Surface, TrailingEdge
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.meshing.mesh.cells import Patch
from sdm_deflect.meshing.mesh.mesh import Mesh

HINGE = Rotation.about([0.7, 0.0, 0.0], [0.7, 1.0, 0.0])
ABOUT_Y = Rotation.about([0, 0, 0], [0, 1, 0])
SPAN = 3.0


@pytest.fixture(scope="module")
def flap(hybrid_wing, flap_names):
    return Surface.of(hybrid_wing.mesh, flap_names)


@pytest.fixture(scope="module")
def wedge():
    """Hinge edges at x = 0, trailing edge at x = 1, a rib at y = 0; nodes only."""
    u, v = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, SPAN, 13), indexing="ij")
    top = np.column_stack([u.ravel(), v.ravel(), 0.1 * (1.0 - u.ravel())])
    points = np.unique(np.vstack([top, top * [1, 1, -1]]), axis=0)
    nodes = np.arange(len(points))
    own = {
        "wedge": nodes,
        "hinge": nodes[points[:, 0] == 0.0],
        "edge": nodes[points[:, 0] == 1.0],
        "rib": nodes[points[:, 1] == 0.0],
    }
    mesh = Mesh(points, (), tuple(Patch(name, (), rows) for name, rows in own.items()), name="wedge")
    return Surface.of(mesh, ("wedge",))


def on(*names):
    return OnPatches(names)


def out_of_plane(points):
    centred = points - points.mean(axis=0)
    return np.abs(centred @ np.linalg.svd(centred, full_matrices=False)[2][2]).max()


def test_a_blended_flap_is_fixed_at_its_borders_and_turns_at_its_trailing_edge(flap):
    move = Blended(HINGE).law(flap).displacement(10.0)
    shared = OnPatches().of(flap, HINGE.axis)
    assert np.array_equal(move[shared], np.zeros_like(move[shared]))
    edge = TrailingEdge().of(flap, HINGE.axis) & ~shared
    assert edge.sum() >= 4
    assert flap.points[edge, 0].min() == pytest.approx(1.0)
    np.testing.assert_allclose(move[edge], HINGE.law(flap).displacement(10.0)[edge], atol=1e-15)


def test_a_wedge_between_hinge_and_trailing_edge_stays_plane(wedge):
    """With hinge and trailing edge as the only data the field is affine (appendix A)."""
    law = Blended(ABOUT_Y, on("hinge"), on("edge")).law(wedge)
    moved = wedge.points + law.displacement(20.0)
    for side in (1.0, -1.0):
        assert out_of_plane(moved[side * wedge.points[:, 2] >= 0.0]) < 1e-9
    assert law.exact.all()


@pytest.mark.parametrize("rib", [Rib(share=0.25), Rib(width=0.25 * SPAN), Rib(on("rib"), share=0.25)])
def test_beside_a_closed_rib_a_strip_is_bent_and_the_rest_stays_plane(rib, wedge):
    law = Blended(ABOUT_Y, on("hinge", "rib"), on("edge"), rib, on("hinge")).law(wedge)
    station, move = wedge.points[:, 1], law.displacement(20.0)
    assert np.array_equal(law.strip, station < 0.25 * SPAN)
    assert np.array_equal(law.exact, ~law.strip)
    held = OnPatches(("hinge", "rib")).of(wedge, ABOUT_Y.axis)
    assert not move[held].any()
    beyond = ~law.strip & (wedge.points[:, 2] >= 0.0)
    moved = wedge.points + move
    assert out_of_plane(moved[beyond]) < 1e-9
    assert out_of_plane(moved[wedge.points[:, 2] >= 0.0]) > 1e-3
    without = Blended(ABOUT_Y, on("hinge"), on("edge")).law(wedge).displacement(20.0)
    np.testing.assert_allclose(move[~law.strip], without[~law.strip], atol=1e-9)
    edge = np.flatnonzero(OnPatches(("edge",)).of(wedge, ABOUT_Y.axis))
    rise = np.linalg.norm(move[edge[np.argsort(station[edge])]], axis=1)
    assert rise[0] == 0.0
    inside = np.sort(station[edge]) < 0.25 * SPAN
    assert (np.diff(rise[inside]) > 0.0).all()  # from the rib to the full turn
    np.testing.assert_allclose(rise[~inside], 2.0 * np.sin(np.radians(10.0)), atol=1e-12)


def test_hinge_nodes_that_are_not_named_are_the_held_ones_near_the_hinge(wedge):
    """Then some are the rib's own; they pull the surface out of its planes by less than a hundredth of its chord."""
    law = Blended(ABOUT_Y, on("hinge", "rib"), on("edge"), Rib(share=0.25)).law(wedge)
    assert np.array_equal(law.front, law.held & (wedge.points[:, 0] <= 0.35))
    beyond = ~law.strip & (wedge.points[:, 2] >= 0.0)
    assert out_of_plane((wedge.points + law.displacement(20.0))[beyond]) < 0.01


@pytest.mark.parametrize("angle", [-5.0, 10.0, 0.001])
def test_a_chosen_strip_shears_the_trailing_edge_by_35_degrees_but_holds_a_row_of_nodes(angle, wedge):
    rib = Rib(on("rib"), turn=angle)
    law = Blended(ABOUT_Y, on("hinge", "rib"), on("edge"), rib, on("hinge")).law(wedge)
    station = wedge.points[:, 1]
    width = 2.0 * np.sin(np.radians(abs(angle)) / 2.0) / np.tan(np.radians(35.0))  # the chord is 1
    assert rib.width_for(wedge.points, ABOUT_Y.axis) == pytest.approx(width)
    first = np.unique(station)[1]
    assert np.array_equal(law.strip, station < max(width, 1.001 * first))


def test_a_rib_at_both_ends_has_a_strip_at_both(wedge):
    far = np.flatnonzero(wedge.points[:, 1] == SPAN)
    both = Listed(np.concatenate([wedge.mesh.on("rib"), far, wedge.mesh.on("hinge")]))
    law = Blended(ABOUT_Y, both, on("edge"), Rib(share=0.25)).law(wedge)
    station = wedge.points[:, 1]
    assert np.array_equal(law.strip, np.minimum(station, SPAN - station) < 0.25 * SPAN)


def test_the_strip_is_measured_along_the_direction_asked_for(wedge):
    slanted = np.array([0.6, 0.8, 0.0])
    law = Blended(ABOUT_Y, on("hinge", "rib"), on("edge"), Rib(on("rib"), width=0.3, direction=slanted)).law(wedge)
    station = wedge.points @ slanted
    ribs = station[OnPatches(("rib",)).of(wedge, ABOUT_Y.axis)]
    distance = np.abs(station[:, None] - ribs).min(axis=1)
    assert np.array_equal(law.strip, distance < 0.3)


@pytest.mark.parametrize("bad", [{"share": 0.0}, {"share": -1.0}, {"share": 1.1}, {"share": np.nan}, {"width": -1.0}])
def test_a_strip_has_a_width(bad):
    with pytest.raises(InputError, match=r"strip = .* must be a positive width, as a share at most 1"):
        Rib(**bad)


def test_a_strip_that_takes_all_is_refused(wedge):
    with pytest.raises(InputError, match="wedge: all of it lies beside a rib that stays: lower the strip's width"):
        Blended(ABOUT_Y, on("hinge", "rib"), on("edge"), Rib(width=2.0 * SPAN)).law(wedge)


def test_a_blended_motion_is_linear_in_that_of_its_driven_nodes(wedge):
    rng = np.random.default_rng(2)
    places, vectors = rng.random((9, 3)), rng.random((9, 3))
    one, two = (Blended(Table(places, k * vectors, ABOUT_Y.axis), on("hinge"), on("edge")).law(wedge) for k in (1, 2))
    np.testing.assert_allclose(two.displacement(0.3), one.displacement(0.6), atol=1e-12)


def test_many_nodes_are_thinned_and_still_take_their_places(wedge, monkeypatch):
    full = Blended(ABOUT_Y, on("hinge"), on("edge")).law(wedge).displacement(20.0)
    monkeypatch.setattr(blended, "MOST", 5)
    law = Blended(ABOUT_Y, on("hinge"), on("edge")).law(wedge)
    thinned = law.displacement(20.0)
    assert np.array_equal(thinned[law.driven], ABOUT_Y.law(wedge).displacement(20.0)[law.driven])
    assert not thinned[law.held].any()
    np.testing.assert_allclose(thinned, full, atol=1e-9)  # affine


def test_a_blended_motion_says_what_it_did_not_find(flap, wedge):
    with pytest.raises(InputError, match="flap_upper, flap_lower, flap_base: found no nodes that follow the motion"):
        Blended(HINGE, driven=Listed(np.array([0]))).law(flap)
    with pytest.raises(InputError, match="wedge: found no nodes that stay, such as its hinge edge"):
        Blended(ABOUT_Y, Listed(np.array([len(wedge.points)])), on("edge")).law(wedge)
    with pytest.raises(InputError, match="wedge: a blended motion needs a hinge"):
        Blended(Table(np.random.default_rng(0).random((5, 3)), np.zeros((5, 3))), on("hinge"), on("edge")).law(wedge)


def test_holding_by_a_wildcard_that_matches_the_surface_still_leaves_nodes_that_follow(flap):
    """`*` once held the flap itself: 'found no nodes that follow the motion' was not the reason."""
    by_name = Blended(HINGE, held=OnPatches(("wing_*",))).law(flap)
    by_all = Blended(HINGE, held=OnPatches(("*",))).law(flap)
    assert np.array_equal(by_all.displacement(10.0), by_name.displacement(10.0))
