"""Layers on walls: which cells they are, the columns of their nodes, and how their heights changed."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.meshing.formats.polyhedra import polyhedral_cells
from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import Cells, Polygons, Polyhedra
from sdm_deflect.meshing.mesh.layers import MEASURED, LayerChange, LayerColumns
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import block_with_body
from tests.meshing.formats.blunt_wing import blunt_wing
from tests.meshing.formats.wing import wing

WALLS = ("wing_upper", "wing_lower", "flap_upper", "flap_lower")


def layers_of(mesh, walls, part=slice(None)):
    return LayerColumns.of(AffectedCells.of(mesh, np.arange(len(mesh.points))[part]), walls)


def change(columns, before, after, walls, normal=None):
    on = np.zeros(len(before), dtype=np.bool_)
    on[walls] = True
    return LayerChange.of(columns, before, after, on, normal)


@pytest.fixture(scope="module")
def small():
    return wing(cells=3)


def test_columns_are_those_that_the_wing_was_built_of(hybrid_wing):
    """Beyond the layers cells are still flat in part."""
    mesh, columns = hybrid_wing.mesh, hybrid_wing.columns
    found = layers_of(mesh, mesh.on(*(name for name in mesh.names if name.startswith(("wing", "flap")))))
    for level, pairs in enumerate(found.levels[: columns.shape[1] - 1]):
        assert {tuple(pair) for pair in pairs} == {tuple(pair) for pair in columns[:, [level + 1, level]]}
    assert len(found.levels) < columns.shape[1] + 3


def test_a_rigid_turn_changes_neither_height_nor_tilt(small):
    walls = small.mesh.on(*WALLS)
    after = Axis(np.array([0.3, 0.1, 0.2]), np.array([1.0, 2.0, -1.0])).rotated(small.mesh.points, 70.0)
    found = change(layers_of(small.mesh, walls), small.mesh.points, after, walls)
    assert found.layers == MEASURED
    assert len(found.faces) > 50
    assert found.changes.max() < 1e-10
    assert found.tilts.max() < 1e-5


@pytest.mark.parametrize("layer", [1, 3, 5])
def test_the_height_of_each_of_five_layers_counts(small, layer):
    """One layer stretched by a quarter, those above shifted with it."""
    points, walls = small.mesh.points.copy(), small.mesh.on(*WALLS)
    low, high = points[small.columns[:, layer - 1]], points[small.columns[:, layer]]
    for above in range(layer, small.columns.shape[1]):
        points[small.columns[:, above]] += 0.25 * (high - low)
    found = change(layers_of(small.mesh, walls), small.mesh.points, points, walls)
    np.testing.assert_allclose(found.changes, 0.25, atol=0.01)  # faces bend a little


def test_layers_that_lie_down_lose_their_height_and_tilt(small):
    """Nodes of the first layer go sideways: the edges are longer, the heights the same; turned, they are lower."""
    points, walls = small.mesh.points, small.mesh.on(*WALLS)
    columns, first = layers_of(small.mesh, walls), small.columns[:, 1]
    aside, lying = points.copy(), points.copy()
    aside[small.columns[:, 1:]] += [0.0, 2.0 * small.first_height, 0.0]
    found = change(columns, points, aside, walls)
    assert np.median(found.changes) < 0.01
    assert np.median(found.tilts) == pytest.approx(np.degrees(np.arctan(2.0)), abs=0.5)
    up = points[first] - points[small.columns[:, 0]]
    lying[first] = points[small.columns[:, 0]] + 0.5 * up + [0.0, 0.75**0.5 * small.first_height, 0.0]
    found = change(columns, points, lying, walls)
    assert np.median(found.changes) >= 0.49


def test_columns_that_lean_at_a_blunt_edge_are_measured():
    """At the corners of the base columns lean by 70 degrees; their heights are those along each face's own normal."""
    mesh = blunt_wing()
    walls, base = mesh.on("wing", "flap"), np.flatnonzero(np.abs(mesh.points[:, 0] - 1.0) < 1e-9)
    columns = layers_of(mesh, walls)
    above = columns.levels[0][np.isin(columns.levels[0][:, 1], base)]
    lean = mesh.points[above[:, 0]] - mesh.points[above[:, 1]]
    assert np.degrees(np.arccos(lean[:, 0] / np.linalg.norm(lean, axis=1))).max() > 40.0
    points = mesh.points.copy()
    points[above[:, 0]] += 0.5 * lean
    found = change(columns, mesh.points, points, walls)
    changed = [bool(np.isin(columns.faces.rows(row, row + 1).nodes, base).all()) for row in found.faces]
    np.testing.assert_allclose(found.changes[changed], 0.5, atol=1e-9)
    assert sum(changed) > 5


def test_only_faces_that_are_wholly_on_the_walls_count(small):
    columns = layers_of(small.mesh, small.mesh.on(*WALLS))
    upper = small.mesh.on("wing_upper")
    found = change(columns, small.mesh.points, small.mesh.points, upper)
    assert 0 < len(found.faces) < len(columns.faces)
    assert all(np.isin(columns.faces.rows(row, row + 1).nodes, upper).all() for row in found.faces)
    assert not len(change(columns, small.mesh.points, small.mesh.points, upper[:0]).faces)
    none = layers_of(small.mesh, upper[:0])
    assert not len(change(none, small.mesh.points, small.mesh.points, upper).faces)


@pytest.mark.parametrize("part", [slice(None), slice(0, None, 3)])
def test_layers_of_polyhedra_are_those_of_the_shapes_that_they_are(part, small):
    walls, points = small.mesh.on(*WALLS), small.mesh.points
    other = replace(small.mesh, cells=(polyhedral_cells(small.mesh).cells,))
    after = points + np.random.default_rng(1).normal(0.0, 1e-5, points.shape)
    found = []
    for mesh in (small.mesh, other):
        columns = layers_of(mesh, walls, part)
        one = change(columns, points, after, walls)
        nodes = [tuple(sorted(columns.faces.rows(row, row + 1).nodes.tolist())) for row in one.faces]
        found.append(dict(zip(nodes, one.changes, strict=True)))
    assert len(found[0]) > 30
    for face, height in found[0].items():
        assert found[1][face] == pytest.approx(height, rel=1e-9)


def test_layers_over_polygons_are_found_and_what_is_no_prism_is_not():
    """A prism over a pentagon, a quarter as high as wide; then one with a node more at the top."""
    turn = 2.0 * np.pi * np.arange(5) / 5
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(5)])
    points = np.vstack([ring, np.add(ring, [0.0, 0.0, 0.25]), [[0.0, 0.0, 0.3]]])
    sides = [[i, (i + 1) % 5, 5 + (i + 1) % 5, 5 + i] for i in range(5)]
    tops = ([[5, 6, 7, 8, 9]], [[5 + i, 5 + (i + 1) % 5, 10] for i in range(5)])
    for top, found in ((tops[0], True), (tops[1], False)):
        faces = [[4, 3, 2, 1, 0], *sides, *top]
        polygons = Polygons(np.concatenate(faces), np.cumsum([0, *map(len, faces)]))
        cells = Polyhedra(polygons, np.zeros(len(faces), dtype=int), np.empty(0, dtype=int))
        columns = layers_of(Mesh(points, (cells,), ()), np.arange(5))
        assert len(columns.levels) == found
        assert len(columns.faces) == found
        if found:
            measured = change(columns, points, points * [1.0, 1.0, 1.1], np.arange(5))
            np.testing.assert_allclose(measured.changes, 0.1)


def test_the_lines_of_a_plane_mesh_have_layers_too():
    x = np.arange(4.0)
    points = np.array([(a, y, 0.0) for y in (0.0, 0.05, 0.12) for a in x])
    quads = np.array([[4 * k + i, 4 * k + i + 1, 4 * k + i + 5, 4 * k + i + 4] for k in range(2) for i in range(3)])
    columns = layers_of(Mesh(points, (Cells("quad", quads),), ()), np.arange(4))
    after = points + np.where(points[:, 1:2] > 0.1, [[0.0, 0.014, 0.0]], 0.0)
    found = change(columns, points, after, np.arange(4), np.array([0.0, 0.0, 1.0]))
    assert found.layers == 2
    np.testing.assert_allclose(found.changes, 0.2)
    turned = Axis(np.zeros(3), np.array([0.0, 0.0, 1.0])).rotated(points, 40.0)
    assert change(columns, points, turned, np.arange(4), np.array([0.0, 0.0, 1.0])).tilts.max() < 1e-5


@pytest.mark.parametrize("kind", ["<i4", "<i8"])
def test_nodes_of_32_bits_are_counted_as_those_of_64(kind):
    """The product of two node numbers of a large mesh has more than 32 bits."""
    mesh = blunt_wing(around=60, along=60, layers=12)
    assert len(mesh.points) ** 2 > 2**32
    cells = tuple(Cells(block.shape, block.nodes.astype(kind)) for block in mesh.cells)
    found = layers_of(replace(mesh, cells=cells), mesh.on("wing", "flap"))
    size = len(mesh.points) // 13
    assert all((pairs[:, 0] - pairs[:, 1] == size).all() for pairs in found.levels)
    assert len(found.levels[0]) == size


def test_cells_as_high_as_wide_are_no_layer():
    block = block_with_body()
    assert not layers_of(block, block.on("body")).levels
