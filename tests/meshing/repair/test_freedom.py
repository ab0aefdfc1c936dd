"""Nodes of a box slide in its faces and along its edges; its corners stay."""

import numpy as np
import pytest

from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.sliding import Plane
from sdm_deflect.meshing.repair.elements import IntersectionCurve
from sdm_deflect.meshing.repair.freedom import FreeNodes
from sdm_deflect.meshing.repair.repair import repair_cells
from tests.meshing.repair.meshes import inner, lattice

COUNT = 6


@pytest.fixture(scope="module")
def box():
    return lattice(counts=(COUNT,) * 3)


@pytest.fixture(scope="module")
def freedom(box):
    everywhere = np.ones(len(box.points), dtype=bool)
    return FreeNodes.of(box, box.points, everywhere, inner(box), {"wall": "plane"})


def sides(points):
    """On how many sides of the unit box each node is."""
    return ((points == 0.0) | (points == 1.0)).sum(axis=1)


def test_faces_edges_and_corners(box, freedom):
    count = sides(box.points)
    kinds = {
        shape: np.concatenate([one.nodes for one in freedom.slides if isinstance(one.shape, shape)])
        for shape in (Plane, IntersectionCurve)
    }
    assert sorted(kinds[Plane]) == np.flatnonzero(count == 1).tolist()
    assert sorted(kinds[IntersectionCurve]) == np.flatnonzero(count == 2).tolist()
    assert np.setdiff1d(np.arange(len(count)), freedom.nodes).tolist() == np.flatnonzero(count == 3).tolist()


@pytest.mark.parametrize("seed", range(3))
def test_shuffled_faces_and_edges_find_back(box, freedom, seed):
    rng = np.random.default_rng(seed)
    way = rng.uniform(-0.7, 0.7, box.points.shape) / COUNT
    way[(box.points == 0.0) | (box.points == 1.0)] = 0.0
    points = box.points + way
    affected = AffectedCells.of(box, np.arange(len(points)))
    assert affected.newly_inverted(points).sum() > 100
    found = repair_cells(points, affected, freedom, 0.9)
    assert not len(found.inverted)
    assert not found.left
    np.testing.assert_allclose(found.points[box.points == 1.0], 1.0, atol=1e-15)
    np.testing.assert_allclose(found.points[box.points == 0.0], 0.0, atol=1e-15)
    still = sides(box.points) == 3
    assert np.array_equal(found.points[still], box.points[still])


def test_where_every_face_is_left_nothing_moves(box, monkeypatch):
    everywhere = np.ones(len(box.points), dtype=bool)
    sliding = FreeNodes.of(box, box.points, everywhere, np.empty(0, dtype=np.intp), {"wall": "plane"})
    monkeypatch.setattr(FreeNodes, "slides_left_by", lambda self, start, points: self.slides)
    points = box.points.copy()
    points[inner(box)] += np.random.default_rng(0).uniform(-0.3, 0.3, (len(inner(box)), 3))
    affected = AffectedCells.of(box, np.arange(len(points)))
    found = repair_cells(points, affected, sliding, 0.9)
    assert np.array_equal(found.points, points)
    assert found.left == found.spoiled > 0


def test_a_face_that_a_node_left_is_told(box, freedom):
    assert freedom.slides_left_by(box.points, box.points) == ()
    node = np.flatnonzero(sides(box.points) == 1)[0]
    nearby, beyond = box.points.copy(), box.points.copy()
    within = np.flatnonzero((box.points[node] != 0.0) & (box.points[node] != 1.0))[0]
    nearby[node, within] += 0.3 / COUNT
    beyond[node, within] += 2.0
    assert freedom.slides_left_by(box.points, nearby) == ()
    left = freedom.slides_left_by(box.points, beyond)
    assert any(node in one.nodes for one in left)
    assert not np.isin(node, freedom.without(left).nodes)
