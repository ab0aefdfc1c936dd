"""An all-moving tail on a cylinder: where its nodes go, and how fast."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.box.hexahedron import box
from sdm_deflect.deform.mesh.axis import Axis, Cylinder
from sdm_deflect.deform.mesh.cells import Patch
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.surface.tail_root import RootOnCylinder

RADIUS, DEPTH, AMOUNT = 0.067, 0.03, 9.0
FUSELAGE = Cylinder(Axis(np.zeros(3), np.array([1.0, 0.0, 0.0])), RADIUS)
PIVOT = Axis(np.array([0.080, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
APEX = np.array([0.090, 0.300, 0.0])
WITHIN = box(np.array([-0.01, 0.0, -0.1]), np.array([0.17, 0.3, 0.1]))
MOTION = RootOnCylinder(PIVOT, FUSELAGE, APEX, ("panel",), WITHIN, DEPTH)


def root(n=15):
    """The root line (2 n, 3): upper and lower side of a diamond on the cylinder."""
    x = np.concatenate([np.linspace(0.02, 0.14, n), np.linspace(0.14, 0.02, n + 2)[1:-1]])
    half = 0.006 * (1.0 - np.abs(x - 0.08) / 0.06)
    z = np.where(np.arange(len(x)) < n, half, -half)
    return np.column_stack([x, np.sqrt(RADIUS**2 - z**2), z])


@pytest.fixture(scope="module")
def surface():
    """A tail on rays to its apex, and a panel of the fuselage around it that ends at `rest`."""
    line = root()
    tail = np.vstack([line + s * (APEX - line) for s in np.linspace(0.0, 0.6, 13)])
    x, polar = (g.ravel() for g in np.meshgrid(np.linspace(-0.02, 0.18, 17), np.radians(np.linspace(-45, 45, 13))))
    skin = np.column_stack([x, RADIUS * np.cos(polar), RADIUS * np.sin(polar)])
    ahead = len(tail) + np.arange(len(skin))
    border = ahead[(np.abs(x - 0.08) > 0.0999) | (np.abs(polar) > np.radians(44.9))]
    patches = {"tail": np.arange(len(tail)), "panel": np.concatenate([np.arange(len(line)), ahead]), "rest": border}
    mesh = Mesh(np.vstack([tail, skin]), (), tuple(Patch(name, (), rows) for name, rows in patches.items()))
    return Surface.of(mesh, ("tail", "panel"))


@pytest.fixture(scope="module")
def law(surface):
    return MOTION.law(surface)


def cross(points):
    """Velocity (N, 3) of a rigid turn about the pivot, per degree."""
    return np.radians(1.0) * np.cross(PIVOT.direction, points - PIVOT.point)


def rate_of(law, amount):
    """Derivative (K, 3) of a law's displacement per degree, with its choices at the amount."""
    law = law.frozen_at(amount)
    near, far = (law.displacement(amount + d) - law.displacement(amount - d) for d in (0.05, 0.1))
    return (8.0 * near - far) / 0.6


def root_rates(line):
    """Velocities (N, 3) per degree of the root nodes, which keep to the cylinder and to their rays to the apex.

    q = p + t (a - p) with |radial q| = R: differentiated, radial q . q' = 0 gives t'.
    """
    p, a = PIVOT.rotated(line, AMOUNT), PIVOT.rotated(APEX[None], AMOUNT)
    q = FUSELAGE.projected_along(p, a - p)
    ray = a - p
    t = np.sum((q - p) * ray, axis=1, keepdims=True) / np.sum(ray**2, axis=1, keepdims=True)
    turning, radial = (1.0 - t) * cross(p) + t * cross(a), FUSELAGE.axis.radial(q)
    return turning - np.sum(radial * turning, axis=1, keepdims=True) / np.sum(radial * ray, axis=1, keepdims=True) * ray


def panel_rates(law, line_by, line_rates):
    """Velocities per degree of the panel's nodes that follow: thin plate splines are linear, the projection is not."""
    both, follow = law.tail & law.panel, law.panel & ~law.tail & ~law.stays
    sites = np.vstack([law.points[both], law.points[law.stays]])
    none = np.zeros((int(law.stays.sum()), 3))
    by, rates = (
        fit(ThinPlateSpline(), sites, np.vstack([known, none]))(law.points[follow]) for known in (line_by, line_rates)
    )
    radial, along = FUSELAGE.axis.radial(law.points[follow] + by), FUSELAGE.axis.direction
    length = np.linalg.norm(radial, axis=1, keepdims=True)
    across = rates - np.outer(rates @ along, along)
    tangent = across - np.sum(across * radial, axis=1, keepdims=True) / length**2 * radial
    return np.outer(rates @ along, along) + RADIUS / length * tangent


def test_the_root_ends_on_the_cylinder_and_every_node_keeps_its_plane(law):
    moved = law.points + law.displacement(AMOUNT)
    both = law.tail & law.panel
    np.testing.assert_allclose(FUSELAGE.distance(moved[both]), 0.0, atol=1e-12)
    rotated, apex = PIVOT.rotated(law.points, AMOUNT), PIVOT.rotated(APEX[None], AMOUNT)
    slid = np.cross(moved[law.tail] - apex, rotated[law.tail] - apex)
    np.testing.assert_allclose(slid, 0.0, atol=1e-15)
    tip = law.tail & (law.points[:, 1] > RADIUS + 3.0 * DEPTH)
    np.testing.assert_allclose(moved[tip], rotated[tip], atol=1e-15)
    assert tip.any()
    assert np.array_equal(law.exact, law.tail)


def test_the_panel_stays_on_the_cylinder_and_its_border_where_it_is(law, surface):
    move = law.displacement(AMOUNT)
    np.testing.assert_allclose(FUSELAGE.distance((law.points + move)[law.panel]), 0.0, atol=1e-12)
    assert not move[law.stays].any()
    outside = law.panel & ~law.tail & ~WITHIN.contains(law.points)
    assert np.array_equal(law.stays, (surface.on(["rest"]) & ~law.tail) | outside)
    assert np.abs(move[law.panel & ~law.tail & ~law.stays]).max() > 1e-3


def test_no_turn_moves_nothing(law):
    np.testing.assert_allclose(law.displacement(0.0), 0.0, atol=1e-15)


def test_rates_of_root_tip_and_panel_are_those_of_their_equations(law):
    rate, move = rate_of(law, AMOUNT), law.displacement(AMOUNT)
    both, tip = law.tail & law.panel, law.tail & (law.points[:, 1] > RADIUS + 3.0 * DEPTH)
    line = root_rates(law.points[both])
    np.testing.assert_allclose(rate[both], line, atol=1e-12)
    np.testing.assert_allclose(rate[tip], cross(PIVOT.rotated(law.points[tip], AMOUNT)), atol=1e-13)
    follow = law.panel & ~law.tail & ~law.stays
    np.testing.assert_allclose(rate[follow], panel_rates(law, move[both], line), atol=1e-12)
    assert not rate[law.stays].any()
    assert np.abs(rate).max() > 1e-3


@pytest.mark.parametrize("amount", [-12.0, 0.0, 4.0, AMOUNT])
def test_rates_of_every_node_are_those_of_a_polynomial_through_other_angles(law, amount):
    """A Chebyshev polynomial of degree 8 through angles within half a degree, differentiated exactly."""
    nodes, region = chebyshev.chebpts1(9), law._region(amount)
    moves = np.stack([law._moved(amount + 0.5 * x, region, law.stays).ravel() for x in nodes])
    slope = chebyshev.chebval(0.0, chebyshev.chebder(chebyshev.chebfit(nodes, moves, 8))) / 0.5
    np.testing.assert_allclose(rate_of(law, amount), slope.reshape(-1, 3), atol=1e-13)


def test_panel_nodes_that_would_leave_the_hexahedron_stay(law, surface):
    follow = np.flatnonzero(law.panel & ~law.tail & ~law.stays)
    aft = law.displacement(AMOUNT)[follow, 0]
    farthest = follow[aft.argmax()]
    rear = law.points[farthest, 0] + 0.01 * aft.max()
    within = box(np.array([-0.01, 0.0, -0.1]), np.array([rear, 0.3, 0.1]))
    short = replace(MOTION, within=within).law(surface)
    assert not short.stays[farthest]
    panel = short.panel & ~short.tail
    alone = short.points + short._moved(AMOUNT, short._region(AMOUNT), short.stays)
    assert not within.contains(alone[farthest][None])[0]
    move = short.displacement(AMOUNT)
    moving = panel & move.any(axis=1)
    assert not moving[farthest]
    assert moving.sum() > 20
    assert within.contains((short.points + move)[moving]).all()
    assert np.array_equal(rate_of(short, AMOUNT).any(axis=1)[panel], moving[panel])


def test_rates_do_not_see_that_the_root_region_gets_a_further_row_of_points(law):
    """Their number grows with the region; the displacement may then jump by a hair, its derivative must not."""
    counts = [len(law._region(AMOUNT + d).still) for d in (-0.1, 0.1)]
    assert counts[0] != counts[1]
    rates = [rate_of(law, AMOUNT + d) for d in (-0.1, 0.0, 0.1)]
    bend = np.abs(rates[2] - 2.0 * rates[1] + rates[0]).max()
    assert bend < 1e-4 * np.abs(rates[1]).max()


def test_a_turn_so_far_that_the_root_misses_is_refused(surface):
    high = replace(MOTION, hinge=Axis(np.array([-0.3, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])))
    with pytest.raises(InputError, match=r"the tail turns so far that its root leaves the fuselage: .* lines miss"):
        high.law(surface).displacement(60.0)


def test_a_tail_and_its_panel_share_nodes(surface):
    patches = {"tail": np.arange(4), "panel": np.arange(5, 9)}
    mesh = Mesh(surface.mesh.points, (), tuple(Patch(name, (), rows) for name, rows in patches.items()))
    with pytest.raises(InputError, match="tail, panel: the surface and its panel share no node"):
        MOTION.law(Surface.of(mesh, ("tail", "panel")))
