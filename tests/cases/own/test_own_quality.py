"""Jacobians of every cell type, against VTK; polyhedra; what counts as inverted."""

import numpy as np
import pytest

from sdm_deflect.cases.own.edges import area_vectors, edges_of, polygons_of, sharp_edges
from sdm_deflect.cases.own.jacobians import CORNERS, scaled_jacobian, smallest_jacobian
from sdm_deflect.cases.own.polyhedra import smallest_pyramid, touching
from sdm_deflect.cases.own.quality import Touched
from sdm_deflect.deform.mesh import Cells, Mesh, Polygons, Polyhedra
from tests.meshing.formats.examples import KINDS, hybrid
from tests.meshing.formats.examples import grid as vtk_grid

rng = np.random.default_rng(3)
SHAPES = tuple(CORNERS)


@pytest.mark.parametrize("shape", ["tetra", "hexahedron", "wedge"])
def test_scaled_jacobians_are_those_of_vtk(shape, hybrid_wing):
    mesh = hybrid_wing.mesh
    bent = mesh.with_points(mesh.points + 1e-4 * rng.normal(size=mesh.points.shape))
    whole = vtk_grid(bent)
    expected = whole.cell_quality("scaled_jacobian")["scaled_jacobian"][whole.celltypes == KINDS[shape]]
    (cells,) = (block for block in mesh.cells if block.shape == shape)
    own = scaled_jacobian(bent.points, cells)
    if shape == "wedge":
        assert np.array_equal(np.sign(own), np.sign(expected))
    else:
        np.testing.assert_allclose(own, expected, atol=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_jacobians_change_sign_in_a_mirror_and_keep_to_rows(shape):
    mesh = hybrid()
    (cells,) = (block for block in mesh.cells if block.shape == shape)
    values = smallest_jacobian(mesh.points, cells)
    assert values.min() > 0.0
    assert smallest_jacobian(mesh.points * [1, 1, -1], cells).max() < 0.0
    assert np.array_equal(smallest_jacobian(mesh.points, cells, np.array([0])), values[:1])


def test_scaled_jacobians_do_not_depend_on_size_or_place():
    mesh = hybrid()
    for block in mesh.cells:
        once = scaled_jacobian(mesh.points, block)
        np.testing.assert_allclose(scaled_jacobian(3e-4 * mesh.points + 5.0, block), once, rtol=1e-8)


def as_polyhedra(mesh):
    """Hexahedra as cells given by faces; inner faces first."""
    (cells,) = mesh.cells
    table = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
    faces, owner = cells.nodes[:, table].reshape(-1, 4), np.repeat(np.arange(len(cells)), 6)
    _, first, which, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    last = np.zeros(len(first), dtype=int)
    last[which.ravel()] = np.arange(len(faces))
    order = np.argsort(count[np.arange(len(first))] == 1, kind="stable")
    inner = int((count == 2).sum())
    nodes = faces[first[order]]
    polygons = Polygons(nodes.ravel(), 4 * np.arange(len(nodes) + 1))
    return Polyhedra(polygons, owner[first[order]], owner[last[order[:inner]]])


def test_pyramids_of_a_cube_are_a_sixth_and_turn_negative(block):
    cells = as_polyhedra(block)
    np.testing.assert_allclose(smallest_pyramid(block.points, cells), 1.0 / 6.0)
    some = np.array([3, 100, 7])
    np.testing.assert_allclose(smallest_pyramid(block.points, cells, some), 1.0 / 6.0)
    points = block.points.copy()
    inner = np.setdiff1d(np.arange(len(points)), block.on(*(p.name for p in block.patches)))
    points[inner[0]] += [1.2, 0.0, 0.0]
    flagged = np.zeros(len(points), dtype=bool)
    flagged[inner[0]] = True
    hit = touching(cells, flagged)
    assert len(hit) == 8
    assert smallest_pyramid(points, cells, hit).min() < 0.0


def test_polyhedra_are_judged_like_the_cells_they_are(block):
    poly = Mesh(block.points, (as_polyhedra(block),), block.patches)
    moved = np.flatnonzero(np.abs(block.points).max(axis=1) < 1.2)
    one, other = (Touched.of(mesh, moved) for mesh in (block, poly))
    assert one.count == other.count
    assert one.hand == other.hand == (1.0,)
    assert other.quality(block.points)[0].shape == "polyhedron"


def test_area_vectors_and_edges_of_mixed_faces():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 1], [1, 1, 1]], dtype=float)
    faces = polygons_of((Cells("quad", np.array([[0, 1, 2, 3]])), Polygons(np.array([1, 4, 5, 2]), np.array([0, 4])),
                         Cells("triangle", np.array([[0, 1, 3]]))))  # fmt: skip
    np.testing.assert_allclose(area_vectors(points, faces), [[0, 0, 1], [-1, 0, 0], [0, 0, 0.5]])
    edges, face = edges_of(faces)
    assert edges.tolist()[:4] == [[0, 1], [1, 2], [2, 3], [3, 0]]
    assert face.tolist() == [0] * 4 + [1] * 4 + [2] * 3
    bent = polygons_of((Cells("quad", np.array([[0, 1, 2, 3], [1, 4, 5, 2]])),))
    assert sharp_edges(points, bent, 40.0).tolist() == [[1, 2]]
    assert len(sharp_edges(points, bent, 100.0)) == 0
