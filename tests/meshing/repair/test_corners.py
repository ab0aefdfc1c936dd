"""Corner tetrahedra are cut near spoiled cells only, and are those of the whole mesh."""

import numpy as np
import pytest

from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.repair.elements import CellCorners, Tetrahedra
from tests.deform.blocks import grid
from tests.meshing.formats.examples import polyhedral
from tests.meshing.repair.meshes import lattice


def hexahedra():
    points, cells = grid([0, 0, 0], [9, 8, 7], [9, 8, 7])
    return Mesh(points, (Cells("hexahedron", cells),), ())


MESHES = {
    "tetrahedra": lambda: lattice(counts=(9, 8, 7)),
    "hexahedra": hexahedra,
    "polyhedra": lambda: polyhedral(hexahedra()),
}


@pytest.fixture(params=MESHES)
def parts(request):
    """Points of a mesh, its block in two parts, and which cells take part."""
    mesh = MESHES[request.param]()
    rows = np.arange(len(mesh.cells[0]))
    taken = rows % 7 > 0
    return mesh.points, [(mesh.cells[0], rows[::2], 1.0), (mesh.cells[0], rows[1::2], 1.0)], taken


def every(points, parts, taken):
    """All tetrahedra at once."""
    return Tetrahedra.of(points, parts).of_cells(taken)


def test_nodes_around_spoiled_cells_are_those_of_all_tetrahedra(parts):
    points, _, taken = parts
    whole, corners, movable = every(*parts), CellCorners(*parts), np.arange(len(points)) % 5 > 0
    for cell, rings in ((40, 1), (41, 2), (300, 3), (0, 2), (7, 12), (41, 3)):
        spoiled = np.arange(len(taken)) == cell
        near = np.zeros(len(points), dtype=np.bool_)
        near[whole.nodes[whole.cells == cell]] = True
        for _ in range(rings - 1):
            near[whole.nodes[near[whole.nodes].any(axis=1)]] = True
        assert np.array_equal(corners.around(spoiled, movable, rings), np.flatnonzero(near & movable)), (cell, rings)


def test_tetrahedra_at_nodes_keep_their_order(parts):
    points, whole = parts[0], every(*parts)
    for nodes in ([60], [61, 200], np.arange(len(points)), [3]):
        own, at = CellCorners(*parts), np.isin(np.arange(len(points)), nodes)
        for found in (own.at_nodes(np.flatnonzero(at)), own.at_nodes(np.flatnonzero(at))):
            some, other = (np.flatnonzero(at[tetrahedra.nodes].any(axis=1)) for tetrahedra in (whole, found))
            assert len(some)
            for name in ("nodes", "cells", "regular"):
                assert np.array_equal(getattr(whole, name)[some], getattr(found, name)[other])


def test_few_cells_are_cut_for_a_small_region(parts):
    _, _, taken = parts
    found = CellCorners(*parts).of_cells(np.arange(len(taken)) == 40)
    assert set(found.cells.tolist()) == {40}
