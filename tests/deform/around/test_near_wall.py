"""Near a boundary the mesh follows it rigidly: layer sites, and what fades out away from the wall."""

import numpy as np
import pytest

from sdm_deflect.deform.around import near_wall
from sdm_deflect.deform.around.near_wall import AROUND, MOST_RIGID, RIGID, Nearby, NearWall, RigidFollow, layer_sites
from sdm_deflect.meshing.mesh.axis import Axis

rng = np.random.default_rng(6)
BOUNDARY = rng.random((60, 3))
PARTS = [np.arange(0, 20), np.arange(20, 60)]
POINTS = rng.uniform(-0.2, 1.2, (500, 3))
# No point is of a layer.
BARE = np.zeros(500, dtype=bool)


@pytest.fixture(scope="module")
def nearby():
    return Nearby.of(POINTS, BOUNDARY, PARTS)


def test_nearest_node_and_distance_of_the_next_part(nearby):
    every = np.linalg.norm(POINTS[:, None] - BOUNDARY, axis=2)
    assert np.array_equal(nearby.node, every.argmin(axis=1))
    np.testing.assert_allclose(nearby.first, every.min(axis=1), rtol=1e-12)
    least = np.stack([every[:, part].min(axis=1) for part in PARTS])
    np.testing.assert_allclose(nearby.second, least.max(axis=0), rtol=1e-12)


def test_one_part_alone_has_no_next_one_and_no_part_no_node():
    alone = Nearby.of(POINTS, BOUNDARY, [np.arange(60), np.empty(0, dtype=np.intp)])
    assert np.isinf(alone.second).all()
    nothing = Nearby.of(POINTS, BOUNDARY, [])
    assert np.isinf(nothing.first).all()
    assert len(NearWall.of(POINTS, BOUNDARY, nothing, [], BARE, 1.0).follow.rows) == 0


def test_points_that_are_carried_keep_their_place_beside_a_rigid_boundary(nearby):
    """x_j + u_j + R_j (p - x_j) is the rigid motion of p, whichever node carries it."""
    axis, rows = Axis(np.array([0.1, 0.2, 0.3]), np.array([1.0, -1.0, 0.5])), np.arange(0, 500, 7)
    follow = RigidFollow.of(POINTS, BOUNDARY, rows, nearby)
    turns = np.broadcast_to(axis.matrix(40.0) - np.eye(3), (60, 3, 3))
    moved = follow.displacement(axis.displacement(BOUNDARY, 40.0), turns)
    np.testing.assert_allclose(moved, axis.displacement(POINTS[rows], 40.0), atol=1e-14)


def test_the_weight_is_one_beside_the_wall_and_then_weight_times_distance_falls_linearly():
    wall = np.zeros((1, 3))
    r = np.linspace(0.0, 1.3, 131)
    points = np.column_stack([r, 0.0 * r, 0.0 * r])
    parts = [np.zeros(1, dtype=np.intp)]
    near = NearWall.of(points, wall, Nearby.of(points, wall, parts), parts, BARE[: len(points)], 1.0)
    rows, weight = near.follow.rows, near.weight
    assert np.array_equal(rows, np.flatnonzero(r < 1.0))
    assert (weight[r[rows] <= RIGID] == 1.0).all()
    outer = r[rows] > RIGID
    np.testing.assert_allclose((weight * r[rows])[outer], RIGID * (1.0 - r[rows][outer]) / (1.0 - RIGID), atol=1e-12)


@pytest.mark.parametrize(("top", "share"), [(0.15, RIGID), (0.3, 0.3), (0.8, MOST_RIGID)])
def test_the_rigid_part_reaches_the_top_of_layers_up_to_half_of_the_reach(top, share):
    wall, r = np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 0.0]]), np.linspace(0.0, 1.0, 101)
    points = np.column_stack([r, 0.0 * r, 0.0 * r])
    points = np.vstack([points, points + wall[1]])
    parts, stacked = [np.arange(2)], np.zeros(len(points), dtype=bool)
    stacked[:101] = r <= top
    near = NearWall.of(points, wall, Nearby.of(points, wall, parts), parts, stacked, 1.0)
    weight, rows = np.zeros(len(points)), near.follow.rows
    weight[rows] = near.weight
    assert weight[:101][r <= share - 1e-9].min() > 1.0 - 1e-12
    assert weight[:101][r > share + 1e-9].max() < 1.0
    assert (weight[101:][r > RIGID + 1e-9] < 1.0).all(), "beside the other wall node nothing has changed"


def test_points_follow_only_what_is_nearer_than_the_next_part(nearby):
    near = NearWall.of(POINTS, BOUNDARY, nearby, PARTS, BARE, 0.25)
    rows = near.follow.rows
    assert (nearby.first[rows] < np.minimum(0.25, nearby.second[rows])).all()
    left = np.setdiff1d(np.arange(500), rows)
    assert (nearby.first[left] >= np.minimum(0.25, nearby.second[left])).all()
    assert (near.weight > 0.0).all()
    assert (near.weight <= 1.0).all()


def test_following_blends_between_the_interpolant_and_the_wall(nearby):
    near = NearWall.of(POINTS, BOUNDARY, nearby, PARTS, BARE, 0.25)
    rows, move = near.follow.rows, rng.normal(size=(60, 3))
    interpolated, none = rng.normal(size=(500, 3)), np.zeros((60, 3, 3))
    kept = interpolated.copy()
    out = near.following(interpolated, move, none)
    carried = near.follow.displacement(move, none)
    weight = near.weight[:, None]
    np.testing.assert_allclose(out[rows], (1.0 - weight) * kept[rows] + weight * carried, atol=1e-14)
    left = np.setdiff1d(np.arange(500), rows)
    assert np.array_equal(out[left], kept[left])
    assert np.array_equal(interpolated, kept)


def test_a_point_follows_the_mean_of_the_nodes_around_by_inverse_distance():
    """The mean of rigid motions, by the fifth power of 1/d - 1/D, D that of the next; at a node its own, to the bit."""
    rows, move, turns = np.arange(0, 500, 9), rng.normal(size=(60, 3)), 0.1 * rng.normal(size=(60, 3, 3))
    follow = RigidFollow.around(POINTS, BOUNDARY, rows, np.arange(60))
    assert follow.nodes.shape == (len(rows), AROUND)
    for q, row in enumerate(rows):
        offset = POINTS[row] - BOUNDARY
        distance = np.linalg.norm(offset, axis=1)
        near = np.argsort(distance)[: AROUND + 1]
        share = (1.0 / distance[near] - 1.0 / (near_wall.BEYOND * distance[near[-1]])) ** 5.0
        near, share = near[:-1], share[:-1]
        expected = share @ (move[near] + np.einsum("nij,nj->ni", turns[near], offset[near])) / share.sum()
        np.testing.assert_allclose(follow.displacement(move, turns)[q], expected, rtol=1e-12)
    at_nodes = RigidFollow.around(BOUNDARY, BOUNDARY, np.arange(60), np.arange(60))
    assert np.array_equal(at_nodes.displacement(move, turns), move)


def test_between_two_nodes_the_motion_does_not_jump():
    wall = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    x = np.linspace(0.4, 0.6, 201)
    points = np.column_stack([x, 0.0 * x, 0.1 + 0.0 * x])
    follow = RigidFollow.around(points, wall, np.arange(201), np.arange(2))
    moved = follow.displacement(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.zeros((2, 3, 3)))[:, 2]
    assert moved[100] == pytest.approx(0.5)
    assert np.diff(moved).max() < 0.03


def test_where_the_nodes_around_change_the_motion_does_not_jump():
    """Beside a symmetric trailing edge as many nodes above as below are equally far: cells of no height feel a jump."""
    x = np.linspace(0.0, 1.0, 60)
    wall = np.vstack([np.column_stack([x, 0.0 * x, side * 0.05 * (1.0 - x)]) for side in (1.0, -1.0)])
    height = 1e-7 * np.arange(-3.0, 4.0)
    points = np.array([[1.02, 0.0, h] for h in height])
    follow = RigidFollow.around(points, wall, np.arange(7), np.arange(120))
    move = np.column_stack([0.0 * wall[:, 0], 0.0 * wall[:, 0], np.where(np.arange(120) < 60, wall[:, 0], 0.0)])
    moved = follow.displacement(move, np.zeros((120, 3, 3)))[:, 2]
    assert np.abs(np.diff(moved)).max() < 100.0 * 1e-7


def test_a_field_that_the_boundary_shares_is_not_changed(nearby):
    """An interpolant that is the boundary's rigid motion stays what it is."""
    axis = Axis(np.zeros(3), np.array([0.0, 1.0, 1.0]))
    field = axis.displacement(POINTS, 12.0)
    near = NearWall.of(POINTS, BOUNDARY, nearby, PARTS, BARE, 0.4)
    turns = np.broadcast_to(axis.matrix(12.0) - np.eye(3), (60, 3, 3))
    np.testing.assert_allclose(near.following(field, axis.displacement(BOUNDARY, 12.0), turns), field, atol=1e-14)


def test_layer_sites_stand_in_the_layers_one_for_each_node():
    """Columns of ten points over each of nine wall nodes: the farthest within .4 of the reach is taken."""
    x, y = (g.ravel() for g in np.meshgrid(np.arange(3.0), np.arange(3.0), indexing="ij"))
    wall = np.column_stack([x, y, 0.0 * x])
    heights = np.linspace(0.02, 0.8, 10)
    points = np.vstack([wall + np.array([0.0, 0.0, h]) for h in heights])
    other = np.array([[1.0, 1.0, 5.0]])
    nearby = Nearby.of(points, np.vstack([wall, other]), [np.arange(9), np.array([9])])
    rows = layer_sites(nearby, np.arange(9), 1.25)
    assert len(rows) == 9
    highest = heights[heights < 0.5].max()
    np.testing.assert_allclose(points[rows, 2], highest)
    assert sorted(nearby.node[rows].tolist()) == list(range(9))
    assert len(layer_sites(nearby, np.arange(4), 1.25)) == 4  # of the moving nodes alone
    assert not len(layer_sites(nearby, np.arange(9), 0.0125))  # a mesh without layers has none


def test_layer_sites_keep_away_from_another_part():
    wall, other = np.zeros((1, 3)), np.array([[0.0, 0.0, 0.6]])
    points = np.array([[0.0, 0.0, h] for h in (0.15, 0.19, 0.25, 0.45)])
    nearby = Nearby.of(points, np.vstack([wall, other]), [np.array([0]), np.array([1])])
    assert layer_sites(nearby, np.arange(1), 1.25).tolist() == [1]


def test_too_many_layer_sites_are_thinned(monkeypatch):
    monkeypatch.setattr(near_wall, "MOST_LAYER_SITES", 30)
    wall = np.column_stack([np.arange(100.0), np.zeros(100), np.zeros(100)])
    nearby = Nearby.of(wall + np.array([0.0, 0.0, 0.3]), wall, [np.arange(100)])
    rows = layer_sites(nearby, np.arange(100), 1.25)
    assert len(rows) == 25
    assert np.array_equal(np.diff(rows), np.full(24, 4))
