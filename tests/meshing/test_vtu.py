from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.meshing.formats.vtu import write_vtu
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import mean_ratio
from tests.extras import Library

pv = Library("pyvista")


def test_arrays_and_layout_are_those_of_the_contract(cube: Mesh, tmp_path: Path) -> None:
    path = tmp_path / "mesh.vtu"
    displacement = np.arange(3.0 * len(cube.points)).reshape(-1, 3)
    quality = mean_ratio(cube.points, tets_of(cube))
    write_vtu(path, cube, {"displacement": displacement}, {"quality": quality})
    grid = pv.read(path)
    arrays = {**grid.point_data, **grid.cell_data}
    assert np.array_equal(arrays["displacement"], displacement)
    assert arrays["displacement"].dtype == np.float64
    assert np.array_equal(arrays["quality"][: len(tets_of(cube))], quality)
    assert (arrays["patch"][: len(tets_of(cube))] == 0).all()
    assert np.array_equal(arrays["patch"][len(tets_of(cube)) :], skin(cube).patch + 1)


def test_the_same_mesh_gives_the_same_bytes(cube: Mesh, tmp_path: Path) -> None:
    for name in ("a.vtu", "b.vtu"):
        write_vtu(tmp_path / name, cube)
    assert (tmp_path / "a.vtu").read_bytes() == (tmp_path / "b.vtu").read_bytes()


def test_arrays_of_the_wrong_length_are_refused_and_nothing_written(cube: Mesh, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="a has 2 rows, expected 64 nodes"):
        write_vtu(tmp_path / "mesh.vtu", cube, {"a": np.zeros(2)})
    with pytest.raises(ValueError, match="b has 2 rows, expected 162 cells"):
        write_vtu(tmp_path / "mesh.vtu", cube, None, {"b": np.zeros(2)})
    assert not list(tmp_path.iterdir())
