"""Local rotations: a rigid motion gives its own, and the rates are derivatives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sdm_deflect.deform.around.local_rotation import LocalRotation
from sdm_deflect.meshing.mesh.axis import Axis

rng = np.random.default_rng(4)
POINTS = rng.random((40, 3))
EDGES = np.array([(i, (i + k) % 40) for i in range(40) for k in (1, 2, 7, 11)])
directions = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)


def of(points=POINTS, edges=EDGES, certain=None):
    return LocalRotation.of(points, edges, len(points) if certain is None else certain)


@settings(max_examples=30, deadline=None)
@given(directions, st.floats(-170.0, 170.0))
def test_a_rigid_motion_gives_its_own_rotation_everywhere(direction, degrees):
    axis = Axis(np.array([0.3, -1.0, 2.0]), direction)
    turns = of().rotations(axis.displacement(POINTS, degrees) + np.array([5.0, 6.0, 7.0]))
    np.testing.assert_allclose(turns, np.broadcast_to(axis.matrix(degrees) - np.eye(3), turns.shape), atol=1e-12)


def test_rotations_are_rotations_whatever_the_displacement():
    turns = of().rotations(0.3 * rng.normal(size=(40, 3))) + np.eye(3)
    np.testing.assert_allclose(turns @ np.swapaxes(turns, 1, 2), np.broadcast_to(np.eye(3), turns.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turns), 1.0, atol=1e-12)


def test_no_displacement_no_rotation_to_the_last_bit():
    assert not of().rotations(np.zeros((40, 3))).any()
    moved = np.zeros((40, 3))
    moved[0] = 0.1
    affected = np.unique(EDGES[(EDGES == 0).any(axis=1)])
    turns = of().rotations(moved)
    others = np.setdiff1d(np.arange(40), affected)
    assert not turns[others].any()
    assert turns[affected].any(axis=(1, 2)).all()


def test_a_pure_stretch_turns_nothing():
    """H = R S with S symmetric: along its own axes a stretch has R = 1."""
    grid = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    pairs = [(i, j) for i in range(27) for j in range(i) if np.abs(grid[i] - grid[j]).sum() == 1.0]
    turns = of(grid, np.array(pairs)).rotations(grid * [0.5, -0.2, 0.1])
    np.testing.assert_allclose(turns, 0.0, atol=1e-12)


def test_rates_are_differences_also_where_edges_are_those_of_a_cube():
    corner = np.vstack([np.zeros(3), np.eye(3)])
    edges = np.array([(0, 1), (0, 2), (0, 3), (1, 2), (2, 3)])
    turning = of(corner, edges)
    at, rate, h = np.zeros((4, 3)), rng.normal(size=(4, 3)), 1e-6
    differences = (turning.rotations(at + h * rate) - turning.rotations(at - h * rate)) / (2.0 * h)
    rates = turning.linearized(at)
    np.testing.assert_allclose(rates.forward(rate), differences, atol=1e-8)
    gradient = rng.normal(size=(4, 3, 3))
    assert np.sum(rates.reverse(gradient) * rate) == pytest.approx(np.sum(gradient * differences), rel=1e-7)


def test_a_strain_is_what_a_turn_leaves_of_the_edges_rates():
    turn = np.cross([0.3, -0.5, 0.2], POINTS) + np.array([4.0, 0.0, 1.0])
    np.testing.assert_allclose(of().strain(turn), 0.0, atol=1e-12)
    stretch = turn.copy()
    stretch[:, 0] += 0.25 * POINTS[:, 0]
    found = of().strain(stretch)
    assert 0.2 < found.max() < 0.3
    assert found.min() > 0.05
    one = turn.copy()
    one[0] += 0.1
    beside = np.isin(np.arange(40), EDGES[(EDGES == 0).any(axis=1)])
    assert np.array_equal(of().strain(one) > 1e-9, beside)


def test_a_plate_turns_with_its_nodes_and_a_line_by_none():
    """Edges in a plane determine a rotation, those along a line do not."""
    x, y = (g.ravel() for g in np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"))
    plate = np.column_stack([x, y, 0.0 * x])
    pairs = np.array([(i, j) for i in range(16) for j in range(i) if np.abs(plate[i] - plate[j]).sum() == 1.0])
    axis = Axis(np.zeros(3), np.array([0.0, 1.0, 0.0]))
    turns = of(plate, pairs).rotations(axis.displacement(plate, 25.0))
    np.testing.assert_allclose(turns, np.broadcast_to(axis.matrix(25.0) - np.eye(3), turns.shape), atol=1e-12)
    line = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    along = of(line, np.column_stack([np.arange(4), np.arange(1, 5)]))
    assert not along.rotations(axis.displacement(line, 25.0)).any()


def test_certain_nodes_turn_among_themselves():
    """What follows them later has no say in how they turn."""
    move, other = 0.1 * rng.normal(size=(40, 3)), rng.normal(size=(40, 3))
    other[:25] = move[:25]
    local = of(certain=25)
    assert np.array_equal(local.rotations(move)[:25], local.rotations(other)[:25])
    assert not np.allclose(local.rotations(move)[25:], local.rotations(other)[25:])
    assert not np.allclose(of().rotations(move)[:25], of().rotations(other)[:25])


def test_edges_without_length_are_left_out_and_without_edges_nothing_turns():
    twice = np.vstack([POINTS, POINTS[:1]])
    axis = Axis(np.zeros(3), np.array([1.0, 2.0, 3.0]))
    local = of(twice, np.vstack([EDGES, [[0, 40]]]))
    turns = local.rotations(axis.displacement(twice, 30.0))
    np.testing.assert_allclose(turns[:40], np.broadcast_to(axis.matrix(30.0) - np.eye(3), (40, 3, 3)), atol=1e-12)
    assert not turns[40].any()
    none = of(edges=np.empty((0, 2), dtype=np.intp))
    assert not none.rotations(POINTS).any()
    assert not none.strain(POINTS).any()
