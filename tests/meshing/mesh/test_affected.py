"""The cells that a deformation may change."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import SERIAL_PAIRS
from sdm_deflect.meshing.mesh.affected import WEIGHT, AffectedCells
from sdm_deflect.meshing.mesh.cells import Cells, Polygons, Polyhedra
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import mean_ratio
from tests.deform.blocks import FACES, block_with_body, grid
from tests.meshing.formats.examples import hybrid

REGULAR = np.array([[1.0, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]])


def test_touched_cells_have_one_quality_for_each_type():
    mesh = hybrid(2)
    affected = AffectedCells.of(mesh, np.arange(14))
    assert affected.count == 7
    found = {quality.shape: quality for quality in affected.quality(mesh.points)}
    assert {shape: quality.cells for shape, quality in found.items()} == {
        "hexahedron": 1,
        "pyramid": 1,
        "tetra": 4,
        "wedge": 1,
    }
    tets = next(block for block in mesh.cells if block.shape == "tetra")
    assert found["tetra"].min == mean_ratio(mesh.points, tets.nodes).min()
    flat = mesh.points * [1.0, 1.0, 0.0]
    assert affected.newly_inverted(mesh.points).sum() == 0
    assert affected.newly_inverted(flat).sum() == 7


def test_left_handed_files_are_judged_accordingly():
    mesh = hybrid()
    mirror = mesh.with_points(mesh.points * [1.0, 1.0, -1.0])
    affected, plain = AffectedCells.of(mirror, np.arange(14)), AffectedCells.of(mesh, np.arange(14))
    assert set(affected.orientation) == {-1.0}
    assert sum(affected.inverted) == affected.newly_inverted(mirror.points).sum() == 0
    for one, other in zip(affected.quality(mirror.points), plain.quality(mesh.points), strict=True):
        assert one.min == pytest.approx(other.min)
        assert one.inverted == 0


def test_cells_inverted_before_are_refused_unless_allowed():
    tets = np.array([[0, 1, 2, 3], [1, 0, 2, 3], [0, 1, 2, 3]])
    affected = AffectedCells.of(Mesh(REGULAR, (Cells("tetra", tets),), ()), np.array([0]))
    assert affected.inverted == (1,)
    affected.check(allow=True)
    with pytest.raises(InputError, match=r"1 of 3 cells \(tetra\) are inverted in the file already"):
        affected.check()


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_a_mesh_most_of_whose_cells_are_inverted_is_not_read_right(mirror):
    """Left-handed or not, a mesh is one as long as its cells agree; if most do not, nothing is taken from it."""
    points, cells = grid([0, 0, 0], [1, 1, mirror], [3, 3, 3])
    few, most = cells.copy(), cells.copy()
    few[:13] = few[:13, [0, 1, 3, 2, 4, 5, 7, 6]]  # as VTK's voxels count them: inverted in either order
    most[:14] = most[:14, [0, 1, 3, 2, 4, 5, 7, 6]]
    assert len(cells) == 27
    AffectedCells.of(Mesh(points, (Cells("hexahedron", few),), ()), np.array([0])).check(allow=True)
    with pytest.raises(
        InputError, match=r"more than half of the cells \(14 of 27\) are inverted or flat: .*CGNS or SU2"
    ):
        AffectedCells.of(Mesh(points, (Cells("hexahedron", most),), ()), np.array([0])).check(allow=True)


def test_cells_with_a_node_that_may_move_are_touched():
    points, cells = grid([0, 0, 0], [1, 1, 1], [60, 60, 30])
    assert len(cells) * WEIGHT > SERIAL_PAIRS  # on several threads
    moved = np.array([5, len(points) - 1])
    expected = np.flatnonzero(np.isin(cells, moved).any(axis=1))
    for kind in ("<i4", ">i4", "<i8", ">i8"):
        mesh = Mesh(points, (Cells("hexahedron", cells.astype(kind)),), ())
        assert np.array_equal(AffectedCells.of(mesh, moved).rows[0], expected)
    assert AffectedCells.of(mesh, np.empty(0, dtype=np.intp)).count == 0


def test_polyhedra_are_touched_through_any_of_their_faces():
    mesh = block_with_body(4)
    nodes = mesh.cells[0].nodes
    faces = Polygons(nodes[:, FACES].ravel(), 4 * np.arange(6 * len(nodes) + 1))
    own = Polyhedra(faces, np.repeat(np.arange(len(nodes)), 6), np.empty(0, dtype=np.intp))
    for moved in (np.array([0]), np.array([17, 60]), np.arange(len(mesh.points))):
        one, other = (AffectedCells.of(Mesh(mesh.points, (cells,), ()), moved) for cells in (mesh.cells[0], own))
        assert np.array_equal(one.rows[0], other.rows[0])
