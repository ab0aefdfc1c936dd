"""Meshes that are spoiled on purpose come back."""

import numpy as np
import pytest

from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.repair import region as goal
from sdm_deflect.meshing.repair.freedom import FreeNodes
from sdm_deflect.meshing.repair.repair import repair_cells
from tests.meshing.repair.meshes import all_of, inner, lattice


@pytest.mark.parametrize("seed", range(5))
def test_shuffled_nodes_find_back(seed):
    """30 % of the nodes change places at random: 1,500 of 6,000 cells are inverted."""
    mesh, rng = lattice(counts=(10, 10, 10)), np.random.default_rng(seed)
    some = rng.permutation(inner(mesh))[: int(0.3 * len(inner(mesh)))]
    points = mesh.points.copy()
    points[some] = points[rng.permutation(some)]
    affected, freedom = all_of(mesh)
    assert affected.newly_inverted(points).sum() > 1000
    found = repair_cells(points, affected, freedom, 0.9)
    assert not len(found.inverted)
    assert not found.left
    before, after = affected.quality(mesh.points)[0], affected.quality(found.points)[0]
    assert after.min >= 0.9 * before.min
    held = np.setdiff1d(np.arange(len(points)), freedom.nodes)
    assert found.points[held].tobytes() == points[held].tobytes()


@pytest.mark.parametrize(("degrees", "least"), [(60.0, 0.6), (180.0, 0.45)])
def test_a_bar_whose_surface_is_bent_and_twisted_is_followed(degrees, least):
    """Like the wrench of Garanzha et al.: the surface is where it shall be, the nodes within are where they were."""
    mesh = lattice((4.0, 1.0, 1.0), (24, 6, 6))
    wall = mesh.on("wall")
    points = mesh.points.copy()
    x, y, z = (points[wall] - [0.0, 0.5, 0.5]).T
    turn, bend = np.radians(degrees) * x / 4.0, np.radians(90.0) * x / 4.0
    y, z = np.cos(turn) * y - np.sin(turn) * z, np.sin(turn) * y + np.cos(turn) * z
    radius = 4.0 / np.radians(90.0) + y
    points[wall] = np.column_stack([radius * np.sin(bend), radius * np.cos(bend), z])
    affected, freedom = all_of(mesh)
    assert affected.newly_inverted(points).sum() > 1000
    found = repair_cells(points, affected, freedom, 0.9)
    assert not len(found.inverted)
    assert affected.quality(found.points)[0].min > least


@pytest.mark.parametrize("lost", [0.005, 2.0])
def test_many_cells_are_not_traded_for_few(lost, monkeypatch):
    """The surface of a bar is twisted so much within a tenth of its length that its cells cannot be as good again."""
    monkeypatch.setattr(goal, "LOST", lost)
    mesh = lattice((4.0, 1.0, 1.0), (24, 6, 6))
    x, y, z = (mesh.points - [0.0, 0.5, 0.5]).T
    turn = np.radians(40.0) * np.clip((x - 1.8) / 0.4, 0.0, 1.0)
    y, z = np.cos(turn) * y - np.sin(turn) * z, np.sin(turn) * y + np.cos(turn) * z
    points = np.column_stack([x, 0.5 + y, 0.5 + z])
    affected, freedom = all_of(mesh)
    found = repair_cells(points, affected, freedom, 0.9)
    (before,), (after,) = affected.quality(points), affected.quality(found.points)
    assert not before.inverted
    assert (before.mean - after.mean < 0.005) == (lost < 1.0)
    assert after.p01 >= before.p01


def test_weights_rise_with_what_good_cells_shall_keep():
    mesh = lattice()
    affected, freedom = all_of(mesh)
    asked = goal.QualityGoal.of(affected, freedom)
    found = affected.before
    expected = asked.weights * np.maximum(0.95 * found.quality / found.quality.min(), 1.0) ** 3
    np.testing.assert_allclose(asked.with_weights(found, True).weights, expected)
    assert asked.with_weights(found, False) is asked
    assert asked.keeps(found, asked.spread(found) + 0.004)
    assert not asked.keeps(found, asked.spread(found) + 0.006)


def test_good_cells_far_away_keep_their_bits():
    mesh = lattice((4.0, 1.0, 1.0), (24, 6, 6))
    points = mesh.points.copy()
    (node,) = np.flatnonzero(np.abs(points - [0.5, 0.5, 0.5]).max(axis=1) < 1e-9)
    points[node] += [0.3, 0.0, 0.0]
    affected, freedom = all_of(mesh)
    found = repair_cells(points, affected, freedom, 0.9)
    assert not len(found.inverted)
    assert 0 < len(found.moved) < 0.5 * len(freedom.nodes)
    assert points[found.moved, 0].max() < 2.0
    still = np.setdiff1d(np.arange(len(points)), found.moved)
    assert found.points[still].tobytes() == points[still].tobytes()


def test_a_good_mesh_is_left_alone():
    mesh = lattice()
    found = repair_cells(mesh.points, *all_of(mesh), 0.9)
    assert found.points is mesh.points
    assert (found.spoiled, found.left, found.steps, len(found.moved)) == (0, 0, 0, 0)


def test_a_cell_whose_nodes_are_held_inverted_is_told():
    mesh = lattice(counts=(4, 4, 4))
    points = mesh.points.copy()
    wall = np.zeros(len(points), dtype=bool)
    wall[mesh.on("wall")] = True
    held = np.flatnonzero(wall[mesh.cells[0].nodes].all(axis=1))
    (a, b, c, d) = mesh.cells[0].nodes[held[0]]
    normal = np.cross(points[b] - points[a], points[c] - points[a])
    points[d] -= 2.0 * normal / (normal @ normal) * ((points[d] - points[a]) @ normal)
    affected, freedom = all_of(mesh)
    found = repair_cells(points, affected, freedom, 0.9)
    assert held[0] in found.inverted


def test_other_cells_get_their_own_shape_back(block):
    """Hexahedra of 2 : 1, of which nodes are pushed through faces: they shall not become cubes."""
    points = block.points * [2.0, 1.0, 1.0]
    mesh = Mesh(points, block.cells, block.patches)
    free = np.setdiff1d(np.arange(len(points)), mesh.on(*mesh.names))
    rng = np.random.default_rng(5)
    moved = points.copy()
    moved[free] += rng.uniform(-0.6, 0.6, (len(free), 3))
    affected = AffectedCells.of(mesh, np.arange(len(points)))
    assert affected.newly_inverted(moved).sum() > 100
    found = repair_cells(moved, affected, FreeNodes(free, ()), 0.9)
    assert not len(found.inverted)
    assert np.abs(found.points - points).max() < 0.25
    assert affected.quality(found.points)[0].min > 0.9


def test_the_same_bits_for_any_number_of_threads(monkeypatch):
    mesh, rng = lattice(counts=(10, 10, 10)), np.random.default_rng(0)
    points, nodes = mesh.points.copy(), inner(mesh)
    points[nodes] += rng.uniform(-0.15, 0.15, (len(nodes), 3))
    found = []
    for threads in (1, 2):
        monkeypatch.setattr("sdm_deflect.base.threads.available_threads", lambda threads=threads: threads)
        found.append(repair_cells(points, *all_of(mesh), 0.9).points.tobytes())
    assert found[0] == found[1]
