"""The cells that a deformation may change, and the heights of their first layer."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.threads import SERIAL_PAIRS
from sdm_deflect.deform.mesh.cells import Cells, Polygons, Polyhedra
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.quality import mean_ratio
from sdm_deflect.deform.mesh.touched import WEIGHT, TouchedCells, first_layer, layers
from sdm_deflect.meshing.formats.polyhedra import polyhedral_cells
from tests.deform.blocks import FACES, block_with_body, grid
from tests.meshing.formats.examples import hybrid
from tests.meshing.formats.wing import wing

REGULAR = np.array([[1.0, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]])


def test_touched_cells_have_one_quality_for_each_type():
    mesh = hybrid(2)
    touched = TouchedCells.of(mesh, np.arange(14))
    assert touched.count == 7
    found = {quality.shape: quality for quality in touched.quality(mesh.points)}
    assert {shape: quality.cells for shape, quality in found.items()} == {
        "hexahedron": 1,
        "pyramid": 1,
        "tetra": 4,
        "wedge": 1,
    }
    tets = next(block for block in mesh.cells if block.shape == "tetra")
    assert found["tetra"].min == mean_ratio(mesh.points, tets.nodes).min()
    flat = mesh.points * [1.0, 1.0, 0.0]
    assert touched.newly_inverted(mesh.points).sum() == 0
    assert touched.newly_inverted(flat).sum() == 7


def test_left_handed_files_are_judged_accordingly():
    mesh = hybrid()
    mirror = mesh.with_points(mesh.points * [1.0, 1.0, -1.0])
    touched, plain = TouchedCells.of(mirror, np.arange(14)), TouchedCells.of(mesh, np.arange(14))
    assert set(touched.orientation) == {-1.0}
    assert sum(touched.inverted) == touched.newly_inverted(mirror.points).sum() == 0
    for one, other in zip(touched.quality(mirror.points), plain.quality(mesh.points), strict=True):
        assert one.min == pytest.approx(other.min)
        assert one.inverted == 0


def test_cells_inverted_before_are_refused_unless_allowed():
    tets = np.array([[0, 1, 2, 3], [1, 0, 2, 3], [0, 1, 2, 3]])
    touched = TouchedCells.of(Mesh(REGULAR, (Cells("tetra", tets),), ()), np.array([0]))
    assert touched.inverted == (1,)
    touched.check(allow=True)
    with pytest.raises(InputError, match=r"1 of 3 cells \(tetra\) are inverted in the file already"):
        touched.check()


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_a_mesh_most_of_whose_cells_are_inverted_is_not_read_right(mirror):
    """Left-handed or not, a mesh is one as long as its cells agree; if most do not, nothing is taken from it."""
    points, cells = grid([0, 0, 0], [1, 1, mirror], [3, 3, 3])
    few, most = cells.copy(), cells.copy()
    few[:13] = few[:13, [0, 1, 3, 2, 4, 5, 7, 6]]  # as VTK's voxels count them: inverted in either order
    most[:14] = most[:14, [0, 1, 3, 2, 4, 5, 7, 6]]
    assert len(cells) == 27
    TouchedCells.of(Mesh(points, (Cells("hexahedron", few),), ()), np.array([0])).check(allow=True)
    with pytest.raises(
        InputError, match=r"more than half of the cells \(14 of 27\) are inverted or flat: .*CGNS or SU2"
    ):
        TouchedCells.of(Mesh(points, (Cells("hexahedron", most),), ()), np.array([0])).check(allow=True)


def test_cells_with_a_node_that_may_move_are_touched():
    points, cells = grid([0, 0, 0], [1, 1, 1], [60, 60, 30])
    assert len(cells) * WEIGHT > SERIAL_PAIRS  # on several threads
    moved = np.array([5, len(points) - 1])
    expected = np.flatnonzero(np.isin(cells, moved).any(axis=1))
    for kind in ("<i4", ">i4", "<i8", ">i8"):
        mesh = Mesh(points, (Cells("hexahedron", cells.astype(kind)),), ())
        assert np.array_equal(TouchedCells.of(mesh, moved).rows[0], expected)
    assert TouchedCells.of(mesh, np.empty(0, dtype=np.intp)).count == 0


def test_polyhedra_are_touched_through_any_of_their_faces():
    mesh = block_with_body(4)
    nodes = mesh.cells[0].nodes
    faces = Polygons(nodes[:, FACES].ravel(), 4 * np.arange(6 * len(nodes) + 1))
    own = Polyhedra(faces, np.repeat(np.arange(len(nodes)), 6), np.empty(0, dtype=np.intp))
    for moved in (np.array([0]), np.array([17, 60]), np.arange(len(mesh.points))):
        one, other = (TouchedCells.of(Mesh(mesh.points, (cells,), ()), moved) for cells in (mesh.cells[0], own))
        assert np.array_equal(one.rows[0], other.rows[0])


def test_heights_of_the_first_layer_are_compared_edge_by_edge():
    """Layers stretched by a quarter: every edge off the wall is a quarter longer."""
    w = wing(cells=3)
    walls = w.mesh.on("wing_upper", "wing_lower", "flap_upper", "flap_lower")
    touched = TouchedCells.of(w.mesh, np.arange(len(w.mesh.points)))
    still = first_layer(touched, walls, w.mesh.points)
    assert (still.largest, still.p99) == (0.0, 0.0)
    assert still.lowest == pytest.approx(w.first_height, rel=0.05)
    points = w.mesh.points.copy()
    first, second = w.columns[:, 0], w.columns[:, 1]
    points[second] += 0.25 * (points[second] - points[first])
    changed = first_layer(touched, walls, points)
    assert changed.edges == still.edges
    assert changed.largest == pytest.approx(0.25, abs=1e-9)
    assert changed.p99 == pytest.approx(0.25, abs=1e-9)
    assert first_layer(touched, walls[:0], points) is None


@pytest.mark.parametrize("part", [slice(None), slice(0, None, 3)])
def test_layers_of_polyhedra_have_the_heights_of_the_shapes_that_they_are(part):
    w = wing(cells=3)
    walls = w.mesh.on("wing_upper", "wing_lower", "flap_upper", "flap_lower")
    other = replace(w.mesh, cells=(polyhedral_cells(w.mesh).cells,))
    points = w.mesh.points + np.random.default_rng(1).normal(0.0, 1e-5, w.mesh.points.shape)
    shapes, polyhedra = (TouchedCells.of(mesh, np.arange(len(points))[part]) for mesh in (w.mesh, other))
    found = first_layer(shapes, walls, points)
    assert found == first_layer(polyhedra, walls, points)
    assert (found.edges > 300, found.thick) == (True, False)
    for one, same in zip(layers(shapes, walls), layers(polyhedra, walls), strict=False):
        assert {*zip(one.starts.tolist(), one.ends.tolist(), strict=True)} <= {
            *zip(same.starts.tolist(), same.ends.tolist(), strict=True)
        }


def test_layers_over_polygons_are_found_and_what_is_no_prism_is_not():
    """A prism over a pentagon, a quarter as high as wide; then one with a node more at the top."""
    turn = 2.0 * np.pi * np.arange(5) / 5
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(5)])
    points = np.vstack([ring, np.add(ring, [0.0, 0.0, 0.25]), [[0.0, 0.0, 0.3]]])
    sides = [[i, (i + 1) % 5, 5 + (i + 1) % 5, 5 + i] for i in range(5)]
    tops = ([[5, 6, 7, 8, 9]], [[5 + i, 5 + (i + 1) % 5, 10] for i in range(5)])
    for top, found in ((tops[0], True), (tops[1], False)):
        faces = [[4, 3, 2, 1, 0], *sides, *top]
        offsets = np.cumsum([0, *map(len, faces)])
        polygons = Polygons(np.concatenate(faces), offsets)
        cells = Polyhedra(polygons, np.zeros(len(faces), dtype=int), np.empty(0, dtype=int))
        touched = TouchedCells.of(Mesh(points, (cells,), ()), np.arange(11))
        layer = first_layer(touched, np.arange(5), points * [1.0, 1.0, 1.1])
        assert (layer is not None) == found
        if layer:
            assert (layer.edges, layer.thick) == (5, True)
            assert layer.largest == pytest.approx(0.1)


@pytest.mark.parametrize(("rise", "thick", "fails"), [(0.02, False, True), (0.005, True, True), (0.005, True, False)])
def test_each_cell_of_the_first_layer_has_the_limit_of_its_own_height(rise, thick, fails):
    """A thin quad beside three thick ones: the kind that is nearer to its limit is reported."""
    x = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    height = np.array([0.05, 0.05, 0.3, 0.3, 0.3, 0.3])
    points = np.array([(a, y, 0.0) for a, y in zip(x, 0.0 * x, strict=True)] + [
        (a, y, 0.0) for a, y in zip(x, height, strict=True)])  # fmt: skip
    quads = np.array([[i, i + 1, 7 + i, 6 + i] for i in (0, 2, 3, 4)])
    touched = TouchedCells.of(Mesh(points, (Cells("quad", quads),), ()), np.arange(12))
    after = points.copy()
    after[6:8, 1] *= 1.0 + rise
    after[8:, 1] *= 1.2 if thick and fails else 1.06
    found = first_layer(touched, np.arange(6), after)
    assert (found.thick, found.largest > found.limit) == (thick, fails)
    assert found.edges == (6 if thick else 2)


def test_cells_as_high_as_wide_are_no_layer():
    block = block_with_body()
    assert first_layer(TouchedCells.of(block, np.arange(len(block.points))), block.on("body"), block.points) is None
