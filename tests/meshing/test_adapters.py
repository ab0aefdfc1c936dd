"""Meshes of other libraries and plain arrays."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.api import deflect
from sdm_deflect.meshing.formats.adapters import accept
from sdm_deflect.meshing.mesh.labelled import Skin, tetrahedral
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.extras import Library
from tests.meshing.formats.examples import KINDS

meshio = Library("meshio")
pv = Library("pyvista")

HINGE = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


@pytest.fixture(scope="module")
def expected(block):
    return deflect(block, ("body",), HINGE, 10.0).points


def test_arrays(block, expected):
    patches = {patch.name: patch.nodes for patch in block.patches}
    result = deflect((block.points, patches), ("body",), HINGE, 10.0)
    points, same = result.mesh
    assert same is patches
    assert np.array_equal(points, result.points)
    body = block.on("body")
    assert np.array_equal(result.points[body], expected[body])
    asked = {"outside_moved", "fixed_surfaces_moved", "left_behind", "site_error", "surfaces_crossed"}
    assert {check.name for check in result.checks} == asked


def test_meshio_with_cell_sets(block, expected):
    faces = [(patch.name, patch.faces[0].nodes) for patch in block.patches]
    blocks = [("hexahedron", block.cells[0].nodes), ("quad", np.vstack([nodes for _, nodes in faces]))]
    ends = np.cumsum([0, *(len(nodes) for _, nodes in faces)])
    none = np.empty(0, dtype=int)
    sets = {name: [none, np.arange(*ends[i : i + 2])] for i, (name, _) in enumerate(faces)}
    result = deflect(meshio.Mesh(block.points, blocks, cell_sets=sets), ("body",), HINGE, 10.0)
    assert isinstance(result.mesh, meshio.Mesh)
    assert np.array_equal(result.mesh.points, expected)


def test_meshio_with_physical_groups_of_gmsh(block, expected):
    blocks = [("hexahedron", block.cells[0].nodes), *(("quad", patch.faces[0].nodes) for patch in block.patches)]
    tags = [np.zeros(len(block.cells[0]), dtype=int), *(np.full(len(p), i + 1) for i, p in enumerate(block.patches))]
    names = {patch.name: np.array([i + 1, 2]) for i, patch in enumerate(block.patches)}
    mesh = meshio.Mesh(block.points, blocks, cell_data={"gmsh:physical": tags}, field_data=names)
    assert np.array_equal(deflect(mesh, ("body",), HINGE, 10.0).points, expected)


def test_pyvista(block, expected):
    quads = np.vstack([patch.faces[0].nodes for patch in block.patches])
    grid = pv.UnstructuredGrid({KINDS["hexahedron"]: block.cells[0].nodes, pv.CellType.QUAD: quads}, block.points)
    label = np.zeros(grid.n_cells, dtype=int)
    label[grid.celltypes == pv.CellType.QUAD] = np.repeat(
        np.arange(1, len(block.patches) + 1), [len(patch) for patch in block.patches]
    )
    grid.cell_data["patch"] = label
    grid.field_data["patch_names"] = ["volume", *(patch.name for patch in block.patches)]
    result = deflect(grid, ("body",), HINGE, 10.0)
    assert isinstance(result.mesh, pv.UnstructuredGrid)
    assert np.array_equal(result.mesh.points, expected)
    assert np.array_equal(grid.points, block.points)


def test_a_tet_mesh():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
    tets, triangles = np.array([[0, 1, 2, 3], [1, 2, 3, 4]]), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 4]])
    mesh = tetrahedral(points, tets, Skin(triangles, np.array([0, 0, 1]), np.full(3, -1)), ("flap", "rest"))
    found, with_points = accept(mesh)
    assert found.patch("flap").nodes.tolist() == [0, 1, 2, 3]
    assert isinstance(with_points(points + 1.0), Mesh)


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: meshio.Mesh(np.eye(4, 3), [("tetra", [[0, 1, 2, 3]])]), "meshio mesh has no named patch"),
        (lambda: meshio.Mesh(np.eye(10, 3), [("tetra10", [list(range(10))])]), "of type tetra10 are not supported"),
        (lambda: pv.ImageData(dimensions=(2, 2, 2)), "cells of type 11 are not supported"),
        (lambda: (np.zeros((3, 2)), {"a": [0]}), r"points \(3, 2\) must be \(N, 3\)"),
        (lambda: (np.zeros((3, 3)), {"a": [0, 9]}), "patch a: nodes 0 to 9, but there are 3 points"),
    ],
)
def test_what_cannot_be_taken_is_said(made, words):
    mesh = made()
    with pytest.raises(InputError, match=words):
        accept(mesh)
