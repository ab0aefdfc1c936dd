"""Types of cells that are given by their faces: those of the cells they were, in any order and any hand."""

import numpy as np
import pytest

from sdm_deflect.meshing.mesh.cells import CORNERS, VOLUMES, Cells, Polygons, Polyhedra
from sdm_deflect.meshing.mesh.faces import FACES
from sdm_deflect.meshing.mesh.quality import inverted_of, quality_of
from sdm_deflect.meshing.mesh.standard import POLYHEDRON, parts_of, type_of
from tests.meshing.mesh.test_quality import IDEAL

RNG = np.random.default_rng(26)


def by_faces(shape, turned=False, shuffled=True):
    """A cell of a shape by its faces, each beginning anywhere, in any order; with `turned` it is their neighbour."""
    faces = [list(np.roll(face, RNG.integers(4))) for face in FACES[shape]]
    faces = [faces[i] for i in RNG.permutation(len(faces))] if shuffled else faces
    faces = [face[::-1] for face in faces] if turned else faces
    offsets = np.cumsum([0, *map(len, faces)])
    cell = np.zeros(len(faces), dtype=int)
    if turned:
        return Polyhedra(Polygons(np.concatenate(faces), offsets), cell + 1, cell)
    return Polyhedra(Polygons(np.concatenate(faces), offsets), cell, cell[:0])


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("shape", VOLUMES)
def test_a_cell_is_what_it_was_whatever_the_order_of_its_faces(shape, turned):
    for _ in range(20):
        cells = by_faces(shape, turned)
        points = IDEAL[shape] + RNG.normal(0.0, 0.1, IDEAL[shape].shape)
        rows = np.array([0])
        assert type_of(cells, 0) == shape
        (name, found, _, _), *_ = parts_of(cells, rows)
        assert (name, sorted(found.nodes[0])) == (shape, list(range(CORNERS[shape])))
        expected = quality_of(points, Cells(shape, np.arange(CORNERS[shape])[None]))
        np.testing.assert_allclose(quality_of(points, cells, rows), expected, atol=1e-13)
        assert not inverted_of(IDEAL[shape], cells, rows).any()


@pytest.mark.parametrize("shape", VOLUMES)
def test_a_cell_of_other_nodes_than_its_type_has_is_a_polyhedron(shape):
    """Such as those that damaged connectivity leaves: the numbers of their triangles and quadrilaterals fit."""
    for _ in range(20):
        cells = by_faces(shape)
        nodes = cells.faces.nodes.copy()
        nodes[RNG.integers(len(nodes))] = RNG.choice([CORNERS[shape], nodes[0], nodes[-1]])
        other = Polyhedra(Polygons(nodes, cells.faces.offsets), cells.owner, cells.neighbour)
        changed = not np.array_equal(nodes, cells.faces.nodes)
        assert type_of(other, 0) == (POLYHEDRON if changed else shape)


def test_each_cell_of_a_block_has_its_own_type():
    blocks = [by_faces(shape) for shape in (*VOLUMES, "hexahedron", "tetra")]
    nodes, sizes, owner, first = [], [], [], 0
    for i, block in enumerate(blocks):
        nodes.append(block.faces.nodes + first)
        sizes.append(np.diff(block.faces.offsets))
        owner.append(np.full(len(block.faces), i))
        first += int(block.faces.nodes.max()) + 1
    offsets = np.concatenate([[0], np.cumsum(np.concatenate(sizes))])
    order = RNG.permutation(len(offsets) - 1)
    every = Polygons(np.concatenate(nodes), offsets)
    faces = [every.nodes[every.offsets[i] : every.offsets[i + 1]] for i in order]
    faces = Polygons(np.concatenate(faces), np.cumsum([0, *map(len, faces)]))
    block = Polyhedra(faces, np.concatenate(owner)[order], np.empty(0, dtype=int))
    found = {name: (rows.tolist(), at.tolist()) for name, _, rows, at in parts_of(block, np.array([5, 2, 3, 4]))}
    assert found == {"tetra": ([5], [0]), "wedge": ([2], [1]), "hexahedron": ([3, 4], [2, 3])}
    assert [type_of(block, i) for i in range(6)] == [*VOLUMES, "hexahedron", "tetra"]
