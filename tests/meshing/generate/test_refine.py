import numpy as np
import pytest

from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.generate.attachment import boundary_failures
from sdm_deflect.meshing.generate.generation import Generated, refine, split_cells
from sdm_deflect.meshing.generate.parameters import MeshParameters
from sdm_deflect.meshing.generate.verify import verify
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import mean_ratio, signed_volumes


def test_eight_positive_children_fill_each_parent(cube: Mesh) -> None:
    sheared = cube.with_points(cube.points @ np.array([[1.0, 0.3, 0], [0, 0.8, 0.2], [0.1, 0, 1.1]]))
    finer = split_cells(sheared)
    volumes = signed_volumes(finer.points, tets_of(finer)).reshape(-1, 8)
    assert (volumes > 0.0).all()
    parents = signed_volumes(sheared.points, tets_of(sheared))
    assert volumes == pytest.approx(np.tile(parents[:, None] / 8.0, 8))


def test_meshes_are_nested_and_keep_their_boundary(cube: Mesh) -> None:
    finer = split_cells(cube)
    assert np.array_equal(finer.points[: len(cube.points)], cube.points)
    assert boundary_failures(finer) == []
    assert len(skin(finer).triangles) == 4 * len(skin(cube).triangles)
    assert (finer.points[finer.on("low"), 0] == 0.0).all()
    assert len(finer.on("low")) == 7 * 7
    assert len(finer.points) == 7**3


def test_children_have_few_shapes_however_often_they_are_split(cube: Mesh) -> None:
    once = split_cells(cube)
    twice = split_cells(once)
    assert mean_ratio(twice.points, tets_of(twice)).min() == pytest.approx(mean_ratio(once.points, tets_of(once)).min())


def test_new_boundary_nodes_lie_on_the_cad(made: Generated, body: CadModel, coarse: MeshParameters) -> None:
    finer = refine(made.mesh, body)
    checked = verify(finer, body, coarse)
    assert checked.failures == ()
    assert np.array_equal(finer.points[: len(made.mesh.points)], made.mesh.points)
    assert len(tets_of(finer)) == 8 * len(tets_of(made.mesh))
