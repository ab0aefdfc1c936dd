"""Layers keep their heights while their nodes are moved."""

import numpy as np
import pytest

from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.layers import LayerColumns
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.sliding import CylinderWall, Plane
from sdm_deflect.meshing.repair.freedom import Columns, FreeNodes, Heights, Slide
from tests.deform.blocks import grid

NONE = np.empty(0, dtype=np.intp)


def rng():
    return np.random.default_rng(3)


@pytest.fixture(scope="module")
def found(hybrid_wing):
    """The columns of the wing's layers."""
    mesh = hybrid_wing.mesh
    affected = AffectedCells.of(mesh, np.arange(len(mesh.points)))
    layers = LayerColumns.of(affected, mesh.on(*(name for name in mesh.names if name.startswith(("wing", "flap")))))
    return rigid(layers, mesh.points)


def rigid(layers, points):
    """Columns all of whose nodes follow the wall rigidly."""
    return Columns.of(layers.levels, np.arange(len(points)), NONE, points, points)


def stack():
    """Two flat layers of three hexahedra each over z = 0, one of them narrow, and a high layer."""
    points, cells = grid([0, 0, 0], [3, 1, 3], [3, 1, 3])
    points[:, 0] = np.array([0.0, 1.0, 1.02, 2.0])[points[:, 0].astype(int)]
    points[:, 2] = np.array([0.0, 0.05, 0.15, 1.0])[points[:, 2].astype(int)]
    return Mesh(points, (Cells("hexahedron", cells),), ())


def test_heights_stay_wherever_nodes_go(found, hybrid_wing):
    points, columns = hybrid_wing.mesh.points, hybrid_wing.columns
    nodes = found.closure(np.concatenate([pairs[::3, 0] for pairs in found.pairs]), len(points))
    heights = Heights.of(found, points, nodes)
    places = points[nodes] + 1e-3 * rng().normal(size=(len(nodes), 3))
    places[::5] = points[nodes][::5]
    heights.keep(places)
    moved = points.copy()
    moved[nodes] = places
    for pairs in found.pairs:
        before, after = (np.linalg.norm(at[pairs[:, 0]] - at[pairs[:, 1]], axis=1) for at in (points, moved))
        np.testing.assert_allclose(after, before, rtol=1e-13)
    assert np.abs(moved[columns[:, -1]] - points[columns[:, -1]]).max() > 1e-3


def test_columns_that_stay_keep_their_bits(found, hybrid_wing):
    points = hybrid_wing.mesh.points
    nodes = found.closure(found.pairs[0][:, 0], len(points))
    places = points[nodes].copy()
    places[0] += 1e-3
    Heights.of(found, points, nodes).keep(places)
    same = (places == points[nodes]).all(axis=1)
    assert 1 <= (~same).sum() <= len(found.pairs)


def test_heights_of_outer_layers_stay_within_their_bounds(found, hybrid_wing):
    """Nodes that are not rigid go where they like, but edges keep half to twice the length before."""
    points = hybrid_wing.mesh.points
    outer = Columns.of(found.pairs, found.pairs[0][:, 0], NONE, points, points)
    nodes = outer.closure(outer.pairs[0][:, 0], len(points))
    places = points[nodes] + 2e-3 * rng().normal(size=(len(nodes), 3))
    Heights.of(outer, points, nodes).keep(places)
    moved = points.copy()
    moved[nodes] = places
    for level, pairs in enumerate(outer.pairs):
        before, after = (np.linalg.norm(at[pairs[:, 0]] - at[pairs[:, 1]], axis=1) for at in (points, moved))
        low, high = (after / before).min(), (after / before).max()
        assert (low, high) == pytest.approx((1.0, 1.0)) if not level else (0.5 - 1e-9 < low < high < 2.0 + 1e-9)
    assert high > 1.1


def test_a_height_beyond_its_bounds_goes_no_farther():
    """A layer that the deflection stretched to three times its height may keep that, but not more."""
    before = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    columns = Columns.of([np.array([[1, 0]])], NONE, NONE, before, 3.0 * before)
    assert columns.lengths[0].tolist() == [[0.5, 3.0]]
    assert columns.without(np.array([1])).pairs[0].size == 0


@pytest.mark.parametrize("rigidly", [True, False])
def test_the_gradient_is_that_of_the_kept_places(rigidly):
    mesh = stack()
    affected = AffectedCells.of(mesh, np.arange(len(mesh.points)))
    walls = np.flatnonzero(mesh.points[:, 2] == 0.0)
    layers = LayerColumns.of(affected, walls)
    some = np.arange(len(mesh.points)) if rigidly else layers.levels[0][:3, 0]
    columns = Columns.of(layers.levels, some, NONE, mesh.points, mesh.points)
    assert [len(pairs) for pairs in columns.pairs] == [8, 8]
    nodes = np.flatnonzero(mesh.points[:, 2] > 0.0)
    heights, weights = Heights.of(columns, mesh.points, nodes), rng().normal(size=(len(nodes), 3))
    way = mesh.points[nodes] + 0.02 * rng().normal(size=(len(nodes), 3))

    def value(places):
        kept = places.copy()
        arms = heights.keep(kept)
        return float(np.sum(weights * kept)), arms

    gradient = weights.copy()
    heights.pull(value(way)[1], gradient)
    h = 1e-7
    for row in range(len(nodes)):
        for k in range(3):
            step = np.zeros_like(way)
            step[row, k] = h
            difference = (value(way + step)[0] - value(way - step)[0]) / (2.0 * h)
            assert gradient[row, k] == pytest.approx(difference, abs=1e-6)


def test_nodes_over_several_others_stay_and_planes_keep_their_own():
    mesh = stack()
    points, cells = mesh.points, mesh.cells[0].nodes
    one, other = np.flatnonzero(
        np.isclose(points[:, 2], 0.05) & (points[:, 1] == 1.0) & (np.abs(points[:, 0] - 1.01) < 0.1)
    )
    joined = Mesh(points, (Cells("hexahedron", np.where(cells == one, other, cells)),), ())
    walls = np.flatnonzero(points[:, 2] == 0.0)
    columns = LayerColumns.of(AffectedCells.of(joined, np.arange(len(points))), walls)
    assert columns.forked.tolist() == [other]
    first = columns.levels[0][:, 0]
    side = np.flatnonzero((points[:, 1] == 0.0) & (points[:, 2] > 0.0))
    free = np.flatnonzero((points[:, 1] > 0.0) & (points[:, 2] > 0.0))
    plane = Plane(np.zeros(3), np.array([0.0, 1.0, 0.0]))
    kept = FreeNodes(free, (Slide(side, plane),)).with_columns(columns, np.arange(len(points)), points, points)
    assert set(kept.columns.pairs[0][:, 0]) == set(first)
    assert set(free) | set(side) == {*kept.nodes, other}
    turned = CylinderWall.fitted(np.column_stack([np.cos(np.arange(9)), np.sin(np.arange(9)), np.arange(9)]))
    none = FreeNodes(free, (Slide(side, turned),)).with_columns(columns, np.arange(len(points)), points, points)
    assert set(none.columns.pairs[0][:, 0]) == set(first) - set(side)
    assert set(free) | set(side) == {*none.nodes, other, *np.intersect1d(first, side)}
