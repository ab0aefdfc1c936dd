"""The mesh of the guide, made by Gmsh, is what the guide says."""

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.meshing.formats.gmsh import Gmsh
from sdm_deflect.meshing.formats.su2 import Su2
from tests.meshing.formats.examples import grid

SCRIPT = Path(__file__).parents[1] / "examples" / "naca_wing.py"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("naca")
    subprocess.run([sys.executable, str(SCRIPT), str(made)], check=True, timeout=120)
    return made


def test_both_files_hold_the_same_wing(folder):
    one, other = Gmsh().read(folder / "naca.msh"), Su2().read(folder / "naca.su2")
    names = {"wing", "flap", "symmetry", "far_field"}
    for mesh in (one, other):
        assert {patch.name for patch in mesh.patches} == names
        assert 20_000 < len(mesh.cells[0]) < 80_000
        assert grid(mesh).compute_cell_sizes()["Volume"].min() > 0.0
    assert {p.name: len(p) for p in one.patches} == {p.name: len(p) for p in other.patches}


def test_the_flap_is_where_the_script_says(folder):
    constants = runpy.run_path(str(SCRIPT), run_name="naca_wing")
    mesh = Gmsh().read(folder / "naca.msh")
    flap = mesh.points[mesh.on("flap")]
    low, high = flap.min(axis=0), flap.max(axis=0)
    np.testing.assert_allclose(low[:2], [constants["HINGE"], constants["FLAP"][0]], atol=1e-9)
    np.testing.assert_allclose(high[:2], [1.0, constants["FLAP"][1]], atol=1e-9)
    np.testing.assert_array_equal(mesh.points[mesh.on("symmetry"), 1], 0.0)
