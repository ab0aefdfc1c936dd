"""Quality and inversion of every type of cell: against VTK, by theorems, and on what a deformation touches."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.cells import VOLUMES, Cells, Polygons, Polyhedra
from sdm_deflect.meshing.mesh.compiled_quality import BLOCK
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.polyhedra import face_centres_and_areas, pyramids_of
from sdm_deflect.meshing.mesh.quality import (
    by_shape,
    find_orientation,
    inverted_of,
    mean_ratio,
    quality_and_inverted,
    quality_of,
    summarise,
)
from sdm_deflect.meshing.mesh.standard import POLYHEDRON, type_of
from tests.deform.blocks import block_with_body
from tests.extras import Library
from tests.meshing.formats.examples import KINDS

pv = Library("pyvista")

REGULAR, ONE = np.array([[1.0, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]]), np.array([[0, 1, 2, 3]])
SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
# The cell of quality 1 of each shape, in VTK's order.
IDEAL = {
    "tetra": REGULAR / np.sqrt(8.0),
    "pyramid": np.array([*SQUARE, [0.5, 0.5, np.sqrt(0.5)]], dtype=float),
    "wedge": np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (0.5, np.sqrt(0.75)), (1, 0))], dtype=float),
    "hexahedron": np.array([[x, y, z] for z in (0, 1) for x, y, _ in SQUARE], dtype=float),
}
coordinates = arrays(np.float64, (4, 3), elements=st.floats(-1.0, 1.0, width=32))


def distorted(shape, amount, count=500):
    """Many ideal cells whose nodes are moved at random, each with nodes of its own."""
    rng = np.random.default_rng(7)
    points = IDEAL[shape] + amount * rng.normal(size=(count, *IDEAL[shape].shape))
    return points.reshape(-1, 3), Cells(shape, np.arange(points[..., 0].size).reshape(count, -1))


def alone(shape):
    return IDEAL[shape], Cells(shape, np.arange(len(IDEAL[shape]))[None])


@pytest.mark.parametrize("shape", VOLUMES)
@pytest.mark.parametrize("amount", [0.02, 0.1, 0.3, 1.0])
def test_quality_is_that_of_vtk(shape, amount):
    points, cells = distorted(shape, amount)
    name = "shape" if shape == "tetra" else "scaled_jacobian"
    expected = pv.UnstructuredGrid({KINDS[shape]: cells.nodes}, points).cell_quality(name)[name]
    np.testing.assert_allclose(quality_of(points, cells), expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("shape", VOLUMES)
def test_the_ideal_cell_has_quality_one(shape):
    points, cells = alone(shape)
    np.testing.assert_allclose(quality_of(points, cells), [1.0], atol=1e-14)
    assert not inverted_of(points, cells)[0]


@pytest.mark.parametrize("shape", VOLUMES)
def test_cells_are_inverted_if_a_corner_is(shape):
    points, cells = distorted(shape, 0.3)
    corners = {
        "tetra": [(0, 1, 2, 3)],
        "pyramid": [(0, 1, 3, 4), (1, 2, 0, 4), (2, 3, 1, 4), (3, 0, 2, 4)],
        "wedge": [(k, (k + 2) % 3, (k + 1) % 3, k + 3) for k in range(3)]
        + [(k + 3, (k + 1) % 3 + 3, (k + 2) % 3 + 3, k) for k in range(3)],
        "hexahedron": [(k, (k + 1) % 4, (k + 3) % 4, k + 4) for k in range(4)]
        + [(k + 4, (k + 3) % 4 + 4, (k + 1) % 4 + 4, k) for k in range(4)],
    }[shape]
    p = points[cells.nodes]
    spanned = [np.linalg.det(p[:, others] - p[:, [corner]]) for corner, *others in corners]
    expected = np.min(spanned, axis=0) <= 0.0
    assert 0.02 < expected.mean() < 0.98
    assert np.array_equal(inverted_of(points, cells), expected)
    if shape != "hexahedron":  # its quality sees its axes as well
        assert np.array_equal(quality_of(points, cells) <= 0.0, expected)


@pytest.mark.parametrize("shape", VOLUMES)
def test_a_flat_cell_and_one_with_nodes_that_coincide_are_inverted_without_quality(shape):
    points, cells = alone(shape)
    for bad in (points * [1.0, 1.0, 0.0], np.zeros_like(points)):
        assert inverted_of(bad, cells)[0]
        assert quality_of(bad, cells)[0] == 0.0


@pytest.mark.parametrize("shape", VOLUMES)
def test_quality_ignores_size_place_and_attitude(shape):
    points, cells = distorted(shape, 0.2)
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    moved = 3e-4 * points @ (turn * np.linalg.det(turn)).T + 5e-3
    np.testing.assert_allclose(quality_of(moved, cells), quality_of(points, cells), atol=1e-9)
    assert np.array_equal(inverted_of(moved, cells), inverted_of(points, cells))


@pytest.mark.parametrize("shape", VOLUMES)
def test_a_mirror_inverts_and_the_other_orientation_mends(shape):
    points, cells = distorted(shape, 0.2)
    mirror = points * [1.0, 1.0, -1.0]
    good = ~inverted_of(points, cells)
    assert inverted_of(mirror, cells)[good].all()
    assert np.array_equal(inverted_of(mirror, cells, orientation=-1.0), ~good)
    np.testing.assert_allclose(quality_of(mirror, cells, orientation=-1.0), quality_of(points, cells), atol=1e-14)
    assert find_orientation(mirror, cells) == (-1.0, np.count_nonzero(~good))
    assert find_orientation(points, cells) == (1.0, np.count_nonzero(~good))


@pytest.mark.parametrize("shape", VOLUMES)
def test_rows_are_those_of_the_whole_across_blocks(shape):
    points, cells = distorted(shape, 0.2, BLOCK + 10)
    rows = np.array([BLOCK + 3, 0, 17])
    assert np.array_equal(quality_of(points, cells, rows), quality_of(points, cells)[rows])
    assert np.array_equal(inverted_of(points, cells, rows), inverted_of(points, cells)[rows])
    assert len(quality_of(points, cells, rows[:0])) == 0


@pytest.mark.parametrize("shape", VOLUMES)
def test_what_is_no_number_stays_none(shape):
    """A cell with a node at nan is not inverted, whichever of its corners that node is, and has no quality."""
    points, cells = distorted(shape, 0.0)
    for corner in range(cells.nodes.shape[1]):
        points[cells.nodes[corner, corner]] = np.nan
    quality, inverted = quality_and_inverted(points, cells)
    assert not inverted_of(points, cells)[: cells.nodes.shape[1]].any()
    assert not inverted.any()
    assert np.isnan(quality).sum() == cells.nodes.shape[1]


@given(coordinates)
def test_the_mean_ratio_lies_between_zero_and_one(points: np.ndarray) -> None:
    assert 0.0 <= mean_ratio(points, ONE)[0] <= 1.0 + 1e-12


def test_summary_counts_shares() -> None:
    summary = summarise(np.array([0.0, 0.1, 0.3, 0.9]))
    assert (summary.below_0_2, summary.below_0_4, summary.inverted, summary.cells) == (0.5, 0.75, 1, 4)
    assert (summary.min, summary.mean, summary.measure) == (0.0, pytest.approx(0.325), "mean ratio")
    assert summarise(np.array([-0.1, 0.5]), "hexahedron", 0).inverted == 0
    with pytest.raises(ValueError, match="no cells"):
        summarise(np.empty(0))


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


@pytest.fixture(scope="module")
def block():
    return block_with_body()


def wedge_of_faces(points):
    """A prism under a gable: three quadrilaterals and two triangles, as one polyhedron."""
    faces = [[0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5], [0, 2, 1], [3, 4, 5]]
    offsets = np.concatenate([[0], np.cumsum([len(face) for face in faces])])
    return points, Polyhedra(Polygons(np.concatenate(faces), offsets), np.zeros(5, dtype=int), np.empty(0, dtype=int))


def test_cells_of_faces_have_the_quality_of_their_type_and_turn_negative(block):
    cells = as_polyhedra(block)
    some = np.array([3, 100, 7])
    for rows in (None, some):
        np.testing.assert_allclose(quality_of(block.points, cells, rows), 1.0)
        np.testing.assert_allclose(pyramids_of(block.points, cells, rows).orthogonality, 1.0)
        assert not inverted_of(block.points, cells, rows).any()
    points = block.points.copy()
    inner = np.setdiff1d(np.arange(len(points)), block.on(*(p.name for p in block.patches)))
    points[inner[0]] += [1.2, 0.0, 0.0]
    hit = AffectedCells.of(Mesh(points, (cells,), ()), inner[:1]).rows[0]
    assert len(hit) == 8
    assert quality_of(points, cells, hit).min() < 0.0
    assert inverted_of(points, cells, hit).any()
    assert inverted_of(points, cells).sum() == inverted_of(points, cells, hit).sum()


def pentagonal(points):
    """The cube of eight corners as a cell of no type: a node in the middle of an edge makes pentagons of two faces."""
    faces = [[0, 3, 2, 1], [4, 8, 5, 6, 7], [0, 1, 5, 8, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    offsets = np.concatenate([[0], np.cumsum([len(face) for face in faces])])
    points = np.vstack([points, points[[4, 5]].mean(axis=0)])
    return points, Polyhedra(Polygons(np.concatenate(faces), offsets), np.zeros(6, dtype=int), np.empty(0, dtype=int))


@pytest.mark.parametrize("height", [1.0, 0.01])
@pytest.mark.parametrize(("shear", "quality"), [(0.0, 1.0), (1.0, 0.7071), (3.0, 0.3162), (10.0, 0.0995)])
def test_the_quality_of_a_polyhedron_falls_as_it_is_sheared_and_not_as_it_is_thin(shear, quality, height):
    """The smallest face pyramid over the volume is a sixth for each of them."""
    points, cell = pentagonal(IDEAL["hexahedron"] @ np.diag([1.0, 1.0, height]))
    points[:, 0] += shear * points[:, 2]
    assert type_of(cell, 0) == POLYHEDRON
    pyramids = pyramids_of(points, cell)
    np.testing.assert_allclose(pyramids.smallest / pyramids.volume, 1.0 / 6.0)
    angle = np.arctan(shear) if height == 1.0 else 0.0
    if height == 1.0:
        np.testing.assert_allclose(quality_of(points, cell), quality, atol=5e-5)
        np.testing.assert_allclose(quality_of(points, cell), np.cos(angle))


def test_a_hexahedron_with_a_negative_corner_is_not_inverted_if_checkmesh_takes_it():
    points = IDEAL["hexahedron"].copy()
    points[6] = [0.45, 0.45, 0.8]
    table = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
    cell = Polyhedra(Polygons(table.ravel(), 4 * np.arange(7)), np.zeros(6, dtype=int), np.empty(0, dtype=int))
    quality, inverted = quality_and_inverted(points, cell)
    assert quality[0] < 0.0
    assert not inverted[0]
    assert quality_and_inverted(points, Cells("hexahedron", np.arange(8)[None]))[1][0]
    assert by_shape(points, [(cell, None, 1.0)])[0].shape == "hexahedron"


def test_volume_and_centre_of_a_polyhedron_are_those_of_its_tetrahedra():
    points, cell = wedge_of_faces(IDEAL["wedge"][[0, 2, 1, 3, 5, 4]] @ np.diag([2.0, 1.0, 3.0]))
    pyramids = pyramids_of(points, cell)
    volume, centre = 3.0 * np.sqrt(0.75), points.mean(axis=0)
    np.testing.assert_allclose(pyramids.volume, [volume])
    centres, areas = face_centres_and_areas(points, cell.faces)
    expected = np.einsum("ij,ij->i", areas, centres - centre) / 3.0
    np.testing.assert_allclose(pyramids.smallest, [expected.min()])
    np.testing.assert_allclose(areas.sum(axis=0), 0.0, atol=1e-14)


def test_the_centre_of_a_face_is_that_of_its_area():
    trapezium = np.array([[0, 0, 0], [4, 0, 0], [2, 2, 0], [0, 2, 0]], dtype=float)
    centres, areas = face_centres_and_areas(trapezium, Polygons(np.arange(4), np.array([0, 4])))
    np.testing.assert_allclose(areas, [[0, 0, 6]])
    np.testing.assert_allclose(centres, [[28 / 18, 8 / 9, 0]])


def test_a_polyhedron_whose_corners_mean_lies_outside_is_not_inverted():
    """Most faces stand at one end: their mean sees another one from behind, the centre of the volume does not."""
    left = [[0.0, y] for y in np.linspace(1.0, 0.05, 20)]
    bend = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.2], [0.9, 1.2], [0.7, 1.0], *left])
    n = len(bend)
    points = np.vstack([np.column_stack([bend, np.full(n, z)]) for z in (0.0, 1.0)])
    sides = [[k, (k + 1) % n, (k + 1) % n + n, k + n] for k in range(n)]
    faces = [np.arange(n)[::-1], np.arange(n) + n, *sides]
    offsets = np.concatenate([[0], np.cumsum([len(face) for face in faces])])
    cell = Polyhedra(Polygons(np.concatenate(faces), offsets), np.zeros(n + 2, dtype=int), np.empty(0, dtype=int))
    centres, areas = face_centres_and_areas(points, cell.faces)
    of_corners = np.einsum("ij,ij->i", areas, centres - centres.mean(axis=0))
    assert of_corners.min() < 0.0
    assert not inverted_of(points, cell)[0]
    assert inverted_of(points * [1, 1, -1], cell)[0]
    assert not inverted_of(points * [1, 1, -1], cell, orientation=-1.0)[0]


def test_polyhedra_are_judged_like_the_cells_they_are(block):
    poly = Mesh(block.points, (as_polyhedra(block),), block.patches)
    moved = np.flatnonzero(np.abs(block.points).max(axis=1) < 1.2)
    one, other = (AffectedCells.of(mesh, moved) for mesh in (block, poly))
    assert one.count == other.count
    assert one.orientation == other.orientation == (1.0,)
    shaken = block.points + np.random.default_rng(8).normal(0.0, 0.05, block.points.shape)
    (first,), (second,) = one.quality(shaken), other.quality(shaken)
    assert (first.shape, first.measure, first.cells) == (second.shape, second.measure, second.cells)
    np.testing.assert_allclose((second.min, second.p01, second.mean), (first.min, first.p01, first.mean), atol=1e-13)


@pytest.mark.parametrize(("shape", "corners"), [("triangle", 3), ("quad", 4)])
def test_a_plane_cell_whose_corners_are_on_a_line_is_inverted(shape, corners):
    points = np.column_stack([np.arange(float(corners)), np.zeros((corners, 2))])
    quality, inverted = quality_and_inverted(points, Cells(shape, np.arange(corners)[None]))
    assert (quality.tolist(), inverted.tolist()) == ([0.0], [True])
