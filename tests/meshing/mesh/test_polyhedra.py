"""Polyhedra measured in parts, and parts of them put together: the bits and the cells of the whole."""

import numpy as np
import pytest

from sdm_deflect.meshing.formats.polyhedra import polyhedral_cells
from sdm_deflect.meshing.mesh import polyhedra
from sdm_deflect.meshing.mesh.cells import Polyhedra
from sdm_deflect.meshing.mesh.polyhedra import SomePolyhedra, join_polyhedra, pyramids_of
from tests.meshing.repair.meshes import lattice


@pytest.fixture(scope="module")
def mesh():
    """Points that are moved at random, and tetrahedra between them in random order."""
    mesh = lattice((1.0, 1.0, 1.0), (5, 4, 3))
    rng = np.random.default_rng(2)
    cells = polyhedral_cells(mesh).cells
    number = rng.permutation(len(cells))
    return mesh.points + rng.normal(0.0, 0.02, mesh.points.shape), Polyhedra(
        cells.faces, number[cells.owner], number[cells.neighbour]
    )


def part(cells, start, stop):
    """Some cells with all their faces."""
    whole = SomePolyhedra(np.arange(len(cells.owner)), cells)
    own = (cells.owner >= start) & (cells.owner < stop)
    own[: len(cells.neighbour)] |= (cells.neighbour >= start) & (cells.neighbour < stop)
    return whole.some(own)


@pytest.mark.parametrize(("rows", "parts"), [(1, 1000), (37, 1000), (1, 3)])
def test_measured_in_parts_they_have_the_bits_of_the_whole(rows, parts, mesh, monkeypatch):
    whole = pyramids_of(*mesh)
    monkeypatch.setattr(polyhedra, "ROWS", rows)
    monkeypatch.setattr(polyhedra, "PARTS", parts)
    found, some = pyramids_of(*mesh), pyramids_of(*mesh, np.array([7, 3, 100]))
    for name in ("smallest", "volume"):
        assert getattr(found, name).tobytes() == getattr(whole, name).tobytes()
        assert getattr(some, name).tobytes() == getattr(whole, name)[[7, 3, 100]].tobytes()


@pytest.mark.parametrize(("start", "stop"), [(0, 1), (50, 120), (0, 360), (359, 360)])
def test_some_of_them_counted_anew_have_the_same_bits(start, stop, mesh):
    points, cells = mesh
    own = part(cells, start, stop)
    counted = own.renumbered(own.nodes, start, stop)
    found, whole = pyramids_of(points, counted, np.arange(stop - start)), pyramids_of(points, cells)
    assert found.smallest.tobytes() == whole.smallest[start:stop].tobytes()
    assert found.volume.tobytes() == whole.volume[start:stop].tobytes()


def test_parts_that_share_faces_have_each_once_when_joined(mesh):
    _, cells = mesh
    found = join_polyhedra([part(cells, start, start + 60) for start in (120, 0, 60)])
    expected = part(cells, 0, 180)
    for one, other in zip(
        (found.numbers, found.nodes, found.sides.faces.offsets, found.sides.owner, found.sides.neighbour),
        (
            expected.numbers,
            expected.nodes,
            expected.sides.faces.offsets,
            expected.sides.owner,
            expected.sides.neighbour,
        ),
        strict=True,
    ):
        np.testing.assert_array_equal(one, other)


def test_a_mesh_of_some_of_them_keeps_their_order(mesh):
    points, cells = mesh
    own = part(cells, 100, 130)
    nodes = np.unique(own.nodes)
    found, numbers = own.within(nodes)
    assert (np.diff(numbers) > 0).all()
    assert set(range(100, 130)) < set(numbers.tolist())
    rows = np.searchsorted(numbers, np.arange(100, 130))
    assert (
        pyramids_of(points[nodes], found, rows).volume.tobytes() == pyramids_of(points, cells).volume[100:130].tobytes()
    )
