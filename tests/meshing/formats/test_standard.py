"""Polyhedra that are usual cells are found again, and others are refused."""

import numpy as np
import pytest

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.formats.gmsh import Gmsh
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.polyhedra import standard_cells
from sdm_deflect.meshing.formats.su2 import Su2
from sdm_deflect.meshing.mesh.cells import Polygons, Polyhedra
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.meshing.formats.alike import content
from tests.meshing.formats.examples import grid, hybrid
from tests.meshing.formats.wing import wing


@pytest.mark.parametrize("mesh", [hybrid(), wing(cells=3).mesh], ids=["hybrid", "wing"])
def test_cells_of_an_openfoam_case_are_the_cells_that_were_written(mesh, tmp_path):
    OpenFoam().write(mesh, tmp_path / "case")
    source = OpenFoam().read(tmp_path / "case")
    found = Mesh(source.points, standard_cells(source), ())
    for expected in mesh.cells:
        block = next(block for block in found.cells if block.shape == expected.shape)
        np.testing.assert_array_equal(np.sort(block.nodes, axis=1), np.sort(expected.nodes, axis=1))
    volumes, before = (grid(m).compute_cell_sizes()["Volume"] for m in (found, mesh))
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(before.sum(), rel=1e-3)


@pytest.mark.parametrize("form", [Gmsh(), Su2()])
def test_an_openfoam_case_becomes_a_file_of_usual_cells(form, tmp_path):
    mesh = hybrid()
    OpenFoam().write(mesh, tmp_path / "case")
    form.write(OpenFoam().read(tmp_path / "case"), tmp_path / "mesh")
    again = form.read(tmp_path / "mesh")
    assert {p.name.replace(" ", "_"): len(p) for p in mesh.patches} == {p.name: len(p) for p in again.patches}
    assert {shape: len(rows) for shape, rows in content(again)["cells"].items()} == {
        block.shape: len(block) for block in mesh.cells
    }


def test_other_polyhedra_are_counted():
    faces = [[0, 4, 3, 2, 1], [5, 6, 7, 8, 9], *([i, (i + 1) % 5, 5 + (i + 1) % 5, 5 + i] for i in range(5))]
    sizes = [len(face) for face in faces]
    prism = Polyhedra(
        Polygons(np.concatenate(faces), np.concatenate([[0], np.cumsum(sizes)])), np.zeros(7, int), np.zeros(0, int)
    )
    with pytest.raises(MeshFileError, match="1 of 1 polyhedra are no tetrahedra"):
        standard_cells(Mesh(np.random.default_rng(0).random((10, 3)), (prism,), ()))
