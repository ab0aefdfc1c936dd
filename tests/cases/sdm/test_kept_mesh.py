"""A cache that is damaged, or cannot be written, is told, and the run goes on."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from sdm_deflect.cases.aircraft import cad, pipeline
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.meshing.mesh.labelled import Skin, tetrahedral, tets_of


@pytest.fixture
def told(monkeypatch):
    """What is told while a mesh of one cell is taken from the cache or generated."""
    skin = Skin(np.array([[0, 2, 1]]), np.array([0]), np.array([0]))
    mesh = tetrahedral(np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3]]), skin, ("wing",))
    measured = SimpleNamespace(boundary_to_cad_max=0.0)
    report = SimpleNamespace(verification=measured, attempts=1, seconds=1.0, unseeded="")
    monkeypatch.setattr(cad, "generate_undeflected", lambda case, watch: SimpleNamespace(mesh=mesh, report=report))

    def run():
        texts = []
        watch = Stopwatch(lambda _: nullcontext(lambda text, _: texts.append(text)))
        found, _ = pipeline.mesh_of_case(case_named("aileron", "small"), watch)
        np.testing.assert_array_equal(tets_of(found), tets_of(mesh))
        return texts

    return run


def test_a_damaged_mesh_is_told_and_replaced(told, tmp_path, monkeypatch):
    monkeypatch.setenv("SDM_DEFLECT_CACHE", str(tmp_path))
    assert told() == ["no mesh of these parameters"]
    assert told() == ["1 cells"]
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:-1])
    assert told() == [f"meshing anew, the cached mesh cannot be used: {path}: is damaged, or of an earlier version"]
    assert told() == ["1 cells"]


def test_a_cache_that_cannot_be_written_is_told(told, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("SDM_DEFLECT_CACHE", str(tmp_path / "file"))
    first, second = told()
    assert first == "no mesh of these parameters"
    assert second.startswith(f"the mesh is not kept for other runs: {tmp_path / 'file'}/")
