"""A wing between periodic sides: the same deflection, whoever says which nodes are images of which."""

import numpy as np
import pytest

from sdm_deflect.meshing.formats.registry import FORMATS, read
from sdm_deflect.meshing.mesh.images import PeriodicPatches
from sdm_deflect.meshing.mesh.images import pair_patches as with_pairs
from tests.calls import sdm
from tests.deform import paired

JOB = ["--surface", "flap", "--fixed", "wing", "--motion", "blended", "--hinge", "0.7,0,0", "0.7,0.4,0", "--angle", "8"]


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("formats")
    mesh = with_pairs(paired.airfoil(layers=2, around=32, outwards=10), [PeriodicPatches("side0", "side1")])
    for name in ("su2", "gmsh", "cgns"):
        FORMATS[name].write(mesh, folder / f"wing{FORMATS[name].suffixes[0]}")
    return folder


def deflected(source, out, *words):
    return sdm("deflect", source, *JOB, "--no-report", "-qv", "--out", out, *words)


def test_pairs_of_the_user_and_of_files_give_the_same_mesh(meshes, tmp_path, capsys):
    points = {}
    for suffix, words in ((".su2", ["--periodic", "side0", "side1"]), (".msh", []), (".cgns", [])):
        out = tmp_path / f"out{suffix}"
        assert deflected(meshes / f"wing{suffix}", out, *words) == 0
        assert "periodic_side0" in capsys.readouterr().out
        points[suffix] = read(out).points
    (pair,) = read(meshes / "wing.cgns").periodic
    here, there = (points[".su2"][side] for side in pair.nodes.T)
    assert np.abs(here + pair.shift - there).max() <= 1e-15
    assert np.abs(here - read(meshes / "wing.su2").points[pair.nodes[:, 0]]).max() > 0.01
    for suffix in (".msh", ".cgns"):
        np.testing.assert_allclose(points[suffix], points[".su2"], atol=1e-12)


def test_patches_that_are_no_images_end_the_command(meshes, tmp_path, capsys):
    assert deflected(meshes / "wing.su2", tmp_path / "out.su2", "--periodic", "side0", "far") == 2
    assert "they must match node by node" in capsys.readouterr().err
    assert not (tmp_path / "out.su2").exists()
