"""Polyhedra are mended by their corners, like the cells that they are."""

import numpy as np
import pytest

from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.cells import Cells, Polygons, Polyhedra
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.repair.elements import Tetrahedra, corners_of
from sdm_deflect.meshing.repair.freedom import FreeNodes
from sdm_deflect.meshing.repair.repair import repair_cells
from tests.deform.blocks import grid
from tests.meshing.formats.examples import hybrid, polyhedral


def sorted_corners(four):
    """Corners as rows that do not depend on the order of edges, but on their handedness."""
    turns = np.stack([four[:, [0, *(1 + (np.arange(3) + k) % 3)]] for k in range(3)])
    best = np.argmin(turns[:, :, 1], axis=0)
    return {tuple(row) for row in turns[best, np.arange(len(four))].tolist()}


def test_corners_of_hexahedra_and_wedges_are_found_in_polyhedra_too():
    mesh = hybrid()
    poly = polyhedral(mesh).cells[0]
    count = 0
    for block in mesh.cells:
        rows = np.arange(count, count + len(block))
        count += len(block)
        own, _ = corners_of(mesh.points, block, np.arange(len(block)))
        other, _ = corners_of(mesh.points, poly, rows)
        if block.shape in ("hexahedron", "wedge"):
            assert sorted_corners(own) == sorted_corners(other)
        if block.shape == "pyramid":
            assert sorted_corners(own) < sorted_corners(other)
            assert len(other) == (4 + 4) * len(block)


def test_nodes_within_edges_and_faces_of_a_polyhedron_are_no_corners():
    """A cube of which the upper face is cut into four, as beside cells half as large."""
    points, (cell,) = grid([0, 0, 0], [2, 2, 2], [1, 1, 1])
    points = np.vstack([points, [[1, 0, 2], [2, 1, 2], [1, 2, 2], [0, 1, 2], [1, 1, 2]]])
    a, b, c, d, e, f, g, h = cell
    i, j, k, m, n = range(8, 13)
    upper = [[e, i, n, m], [i, f, j, n], [j, g, k, n], [k, h, m, n]]
    split = [[a, d, c, b], *upper, [a, b, f, i, e], [b, c, g, j, f], [c, d, h, k, g], [d, a, e, m, h]]
    offsets = np.cumsum([0, *map(len, split)])
    poly = Polyhedra(
        Polygons(np.concatenate(split), offsets), np.zeros(len(split), dtype=np.intp), np.empty(0, np.intp)
    )
    found = Tetrahedra.of(points, [(poly, np.array([0]), 1.0)])
    assert sorted(found.nodes[:, 0].tolist()) == sorted(cell.tolist())
    assert not found.regular.any()


@pytest.mark.parametrize("mirrored", [1.0, -1.0])
def test_a_shuffled_mesh_of_polyhedra_comes_back(mirrored):
    points, cells = grid([0, 0, 0], [6, 6, 6], [6, 6, 6])
    points = points * [1.0, 1.0, mirrored]
    mesh = polyhedral(Mesh(points, (Cells("hexahedron", cells),), ()))
    inner = np.flatnonzero((np.abs(points - points.mean(axis=0)) < 2.5).all(axis=1))
    affected = AffectedCells.of(mesh, inner)
    bent = points.copy()
    bent[inner] += 0.8 * np.random.default_rng(4).uniform(-1.0, 1.0, (len(inner), 3))
    assert affected.newly_inverted(bent).sum() > 20
    found = repair_cells(bent, affected, FreeNodes(inner, ()), 0.9)
    assert affected.newly_inverted(found.points).sum() == 0
    assert affected.quality(found.points)[0].min > 0.9 / 6.0
    assert np.array_equal(np.delete(found.points, inner, axis=0), np.delete(points, inner, axis=0))
