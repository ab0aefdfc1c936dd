"""An all-moving tail on a cylinder: where its nodes go, and how fast."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.box.hexahedron import box
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.surface.tail_root import Root, RootOnCylinder
from sdm_deflect.meshing.mesh.axis import Axis, Cylinder
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh

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
    moves = np.stack([law._displacement(amount + 0.5 * x, region, law.stays).ravel() for x in nodes])
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
    alone = short.points + short._displacement(AMOUNT, short._region(AMOUNT), short.stays)
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


ROUND = Axis(np.array([0.3, 0.0, 0.05]), np.array([0.0, 1.0, 0.0]))
TAIL_DEPTH, UP = 0.1, np.array([0.0, 0.5, 0.0])


def height(x, z):
    """Height of a skin that is curved both ways."""
    return 0.2 - 0.4 * (x - 0.2) ** 2 - 0.9 * z**2 + 0.3 * x * z


def rings(points, n):
    """Quadrilaterals (F, 4) between rings of n points, in order."""
    at = np.arange(points - n).reshape(-1, n)
    return np.stack([at, np.roll(at, -1, 1), np.roll(at, -1, 1) + n, at + n], axis=-1).reshape(-1, 4)


@pytest.fixture(scope="module")
def body():
    """A tail of elliptic section, 0.4 long, on a curved body: rings around the root on it, and upwards from it."""
    n, polar = 48, np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    grow = np.linspace(0.0, 1.0, 15)
    oval = np.column_stack([0.2 * np.cos(polar), 0.03 * np.sin(polar)])
    round_ = np.column_stack([0.6 * np.cos(polar), 0.45 * np.sin(polar)])
    flat = np.vstack([np.array([0.3, 0.05]) + (1.0 - s) * oval + s * round_ for s in grow])
    skin = np.column_stack([flat[:, 0], height(*flat.T), flat[:, 1]])
    tail = np.vstack([skin[:n] + s * UP for s in np.linspace(0.0, 1.0, 11)[1:]])
    whole = np.vstack([skin, tail])
    upwards = rings(len(tail) + n, n)
    up = np.where(upwards < n, upwards, upwards - n + len(skin))
    faces = {"tail": up, "body": rings(len(skin), n)}
    patches = tuple(Patch(name, (Cells("quad", nodes),)) for name, nodes in faces.items())
    return Mesh(whole, (), patches, name="body")


def on_body(mesh, **more):
    """The law of the tail, and its surface."""
    motion = Root(ROUND, "tail", ("body",), **more)
    surface = Surface.of(motion.cut(mesh), ("tail", motion.panels))
    return motion.law(surface), surface


def test_a_root_stays_on_a_skin_of_any_shape(body):
    law, surface = on_body(body, depth=TAIL_DEPTH)
    assert surface.label == "tail"
    assert surface.patches == ("tail", "body~tail")
    for amount in (-15.0, 15.0):
        move = law.displacement(amount)
        x, y, z = (law.points + move).T
        root, follow = law.tail & law.panel, law.panel & ~law.stays
        rigid = ROUND.displacement(law.points, amount)
        assert np.abs(height(*(law.points + rigid)[root][:, [0, 2]].T) - law.points[root][:, 1]).max() > 2e-3
        np.testing.assert_allclose(y[root], height(x, z)[root], atol=2e-5)
        np.testing.assert_allclose(y[follow], height(x, z)[follow], atol=1e-3)
        np.testing.assert_allclose(move[law.tail][:, [0, 2]], rigid[law.tail][:, [0, 2]], atol=1e-15)
        np.testing.assert_allclose(move[law.beyond_root], rigid[law.beyond_root], atol=1e-15)
        assert not move[law.stays].any()
    assert law.beyond_root.sum() > 300
    assert law.stays.sum() >= 48
    assert not law.displacement(0.0).any()


def test_a_tail_without_a_body_and_a_body_that_is_all_panel_are_refused(body):
    apart = replace(
        body, patches=(body.patches[0], Patch("body", (Cells("quad", body.patches[1].faces[0].nodes[48:]),)))
    )
    with pytest.raises(InputError, match="tail shares no node with body, on which it turns"):
        on_body(apart)
    small = replace(
        body, patches=(body.patches[0], Patch("body", (Cells("quad", body.patches[1].faces[0].nodes[:96]),)))
    )
    with pytest.raises(InputError, match="all of body is near tail: join it with the patches around it"):
        on_body(small)


def on_round_body(apex):
    """The law, and the mesh, of a tail of rings on a cylinder; its planes meet in an apex, or run along y without."""
    line, rows = root(), 13
    n = len(line)
    x, polar = np.meshgrid(np.linspace(-0.1, 0.26, 31), np.radians(np.linspace(-80, 80, 41)))
    skin = np.column_stack([x.ravel(), RADIUS * np.cos(polar.ravel()), RADIUS * np.sin(polar.ravel())])
    at = np.arange(len(skin)).reshape(41, 31) + rows * n
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    ways = np.array([0.0, 0.2, 0.0]) if apex is None else apex - line
    points = np.vstack([*(line + s * ways for s in np.linspace(0.0, 0.6, rows)), skin])
    joint = np.column_stack([np.arange(n), np.roll(np.arange(n), -1), np.full(n, at[20, 15])])
    blocks = (Cells("quad", quads), Cells("triangle", joint))
    tail = Patch("tail", (Cells("quad", rings(rows * n, n)),))
    mesh = Mesh(points, (), (tail, Patch("body", blocks)), name="round")
    motion = Root(PIVOT, "tail", ("body",), shape="cylinder", depth=DEPTH)
    return motion.law(Surface.of(motion.cut(mesh), ("tail", motion.panels)))


def test_a_cylinder_and_its_apex_are_found():
    law = on_round_body(APEX)
    np.testing.assert_allclose(law.motion.apex, APEX, atol=1e-4)
    moved = law.points + law.displacement(AMOUNT)
    np.testing.assert_allclose(FUSELAGE.distance(moved[law.panel]), 0.0, atol=1e-9)


def test_the_planes_of_a_tail_without_taper_meet_far_away():
    law = on_round_body(None)
    way = law.motion.apex - law.points.mean(axis=0)
    np.testing.assert_allclose(np.abs(way / np.linalg.norm(way)), [0.0, 1.0, 0.0], atol=1e-3)
    assert np.linalg.norm(way) > 100.0
    moved, rigid = law.points + law.displacement(AMOUNT), PIVOT.rotated(law.points, AMOUNT)
    np.testing.assert_allclose(FUSELAGE.distance(moved[law.panel]), 0.0, atol=1e-9)
    np.testing.assert_allclose((moved - rigid)[law.tail][:, [0, 2]], 0.0, atol=1e-5)


def turned_upright(points):
    """Turn y to z and z to -y, as from a tail to a fin."""
    return np.column_stack([points[:, 0], -points[:, 2], points[:, 1]])


def test_a_fin_is_lengthened_as_a_tail_is(surface):
    mesh = surface.mesh.with_points(turned_upright(surface.mesh.points))
    (apex,), (way,) = turned_upright(APEX[None]), turned_upright(PIVOT.direction[None])
    cylinder = Cylinder(Axis(np.zeros(3), np.array([1.0, 0.0, 0.0])), RADIUS)
    room = box(np.array([-0.01, -0.1, 0.0]), np.array([0.17, 0.1, 0.3]))
    fin = RootOnCylinder(Axis(PIVOT.point, way), cylinder, apex, ("panel",), room, DEPTH)
    law, tail = fin.law(Surface.of(mesh, ("tail", "panel"))), MOTION.law(surface)
    expected = turned_upright(tail.displacement(AMOUNT))
    np.testing.assert_allclose(law.displacement(AMOUNT), expected, atol=1e-6)
