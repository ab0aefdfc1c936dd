"""The kept meshes are those of today's geometry and mesher's settings, so that no test waits for the mesher."""

import json
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.cad import around_block, generate_undeflected
from sdm_deflect.cases.aircraft.guide_meshes import GUIDE, VERSIONS, KnownMesh, guide_text, mesh_name, points_hash
from sdm_deflect.cases.aircraft.overset import finer_background
from sdm_deflect.cases.aircraft.registry import case_named, resolve
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.meshing.cache import MeshCache, cache_key
from sdm_deflect.meshing.mesh.labelled import tets_of
from tests.kept_meshes import FOLDER, NAMES, digest, parameters

OTHERS = {name: own for name, own in VERSIONS.items() if version(name) != own}


def kept_mesh(cache, name):
    return MeshCache(cache).load(cache_key(parameters(name)))[0]


@pytest.mark.parametrize("name", NAMES)
def test_a_kept_mesh_has_the_parameters_of_its_case(name):
    with np.load(FOLDER / f"{name}.npz", allow_pickle=False) as kept:
        assert json.loads(str(kept["text"]))["digest"] == digest(name), "python -m tests.kept_meshes writes it again"


@pytest.mark.parametrize("name", ["aileron", "aileron-free", "aileron-chimera"])
def test_a_kept_mesh_is_that_of_the_guide(name, mesh_cache):
    case, mesh = case_named(name), kept_mesh(mesh_cache, name)
    found = KnownMesh(len(mesh.points), len(tets_of(mesh)), points_hash(mesh))
    assert found == GUIDE[mesh_name(case), "small"]
    assert guide_text(case, mesh, "") == "the mesh of the guide"


def test_another_mesh_says_why_it_is_not_that_of_the_guide(mesh_cache, monkeypatch):
    case, mesh = case_named("tail"), kept_mesh(mesh_cache, "aileron")
    other = mesh.with_points(np.nextafter(mesh.points, 1.0))
    unlike = "not the mesh of the guide: "
    probably = "probably this processor or its C library rounds coordinates otherwise"
    assert guide_text(case, other, "") == f"{unlike}it has as many nodes and cells; {probably}"
    fewer = replace(
        other, points=other.points[:-1], cells=(replace(other.cells[0], nodes=other.cells[0].nodes[:1]),), patches=()
    )
    assert guide_text(case, fewer, "") == f"{unlike}it has 24,472 nodes for 24,473; {probably}"
    assert guide_text(case, other, "the processor lacks fma") == f"{unlike}the processor lacks fma"
    assert guide_text(resolve("tail", assignments=["mesh.wing=0.02"]), other, "") == f"{unlike}its settings are others"
    assert guide_text(resolve("tail", assignments=["mesh.seed=2"]), other, "") == f"{unlike}its settings are others"
    assert guide_text(resolve("tail", assignments=["angle=-3"]), mesh, "") == "the mesh of the guide"
    assert guide_text(case_named("aileron-free", "paper"), other, "").startswith(f"{unlike}the guide has none of this")
    monkeypatch.setitem(VERSIONS, "gmsh", "4.0")
    assert guide_text(case, other, "") == f"{unlike}made by gmsh {version('gmsh')} for 4.0"


@pytest.mark.nightly
@pytest.mark.skipif(bool(OTHERS), reason=f"the guide's meshes are of {OTHERS}")
@pytest.mark.parametrize("name", NAMES)
def test_a_kept_mesh_is_made_again_to_the_bit(name, mesh_cache):
    """Where the mesher can be seeded."""
    case = case_named("aileron-chimera" if name == "background" else name)
    background = name == "background"
    made = (
        around_block(case, finer_background(case), Stopwatch())
        if background
        else generate_undeflected(case, Stopwatch())
    )
    if made.report.unseeded:
        pytest.skip(made.report.unseeded)
    kept = kept_mesh(mesh_cache, name)
    assert made.mesh.points.tobytes() == kept.points.tobytes()
    assert np.array_equal(tets_of(made.mesh), tets_of(kept))
