from dataclasses import replace

import numpy as np
import pytest

from benchmarks.before_after import block_with_flap
from benchmarks.foam_motion import LAPLACIAN, SBR, GivenBoundary, Motion
from benchmarks.mesh_formats import box_of_tets
from benchmarks.repair_peers import HEAD, PRISM, Judged, faced, failed_checks, left, optimized, row, untangled
from sdm_deflect.deform.mesh.cells import Patch
from sdm_deflect.deform.mesh.quality import mean_ratio
from sdm_deflect.meshing.formats.openfoam import OpenFoam


@pytest.fixture(scope="module")
def flap(tmp_path_factory):
    """A block with a flap; all its sides are one patch, whose faces look outwards."""
    mesh = block_with_flap(10)
    sides = [patch for patch in mesh.patches if patch.name != "flap"]
    whole = Patch("sides", tuple(faces for patch in sides for faces in patch.faces))
    case = tmp_path_factory.mktemp("flap") / "case"
    OpenFoam().write(
        replace(mesh, points=np.round(10.0 * mesh.points) / 10.0, patches=(whole, mesh.patch("flap"))), case
    )
    return OpenFoam().read(case)


def test_a_box_is_cut_into_its_plane_faces(flap):
    cut = faced(flap, "sides")
    assert cut.names == ("flap", *(f"sides_{k}" for k in range(6)))
    assert sum(len(patch) for patch in cut.patches) == sum(len(patch) for patch in flap.patches)
    for name in cut.names[1:]:
        assert np.ptp(cut.points[cut.patch(name).nodes], axis=0).min() == 0.0


@pytest.mark.parametrize("motion", [Motion(LAPLACIAN, 1, False), Motion(SBR, 2)])
def test_openfoam_moves_the_boundary_that_it_is_given(flap, motion, tmp_path):
    cut = faced(flap, "sides")
    OpenFoam().write(cut, tmp_path / "case")
    nodes = cut.patch("flap").nodes
    displacement = 0.04 * np.sin(5.0 * cut.points[nodes][:, [1, 2, 0]])
    given = GivenBoundary(tmp_path / "case", cut, "flap", displacement, cut.names[1:])
    points, seconds = given.moved(motion, tmp_path / "moved")
    np.testing.assert_allclose(points[nodes], cut.points[nodes] + displacement, rtol=0.0, atol=1e-12)
    assert max(left(cut, name, points) for name in given.box) < 1e-15
    slid = np.abs(points - cut.points)[cut.on(*given.box)].max()
    assert slid > 1e-3 if motion.slips else slid == 0.0
    assert 0.0 < given.moved(replace(motion, steps=0), tmp_path / "moved")[1] < seconds


def test_gmsh_untangles_tetrahedra_and_leaves_their_boundary():
    mesh = box_of_tets(4)
    outer = mesh.on(*mesh.names)
    points = mesh.points.copy()
    inner = np.setdiff1d(np.arange(len(points)), outer)
    points[inner] += np.random.default_rng(1).normal(scale=0.1, size=(len(inner), 3))
    tets = mesh.cells[0].nodes
    assert mean_ratio(points, tets).min() == 0.0
    found = untangled(mesh.with_points(points)).points
    assert mean_ratio(found, tets).min() > 0.0
    np.testing.assert_allclose(found[outer], points[outer], rtol=0.0, atol=1e-15)


def test_gmsh_refuses_prisms():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]], dtype=np.float64)
    with pytest.raises(Exception, match="prism not supported yet"):
        optimized(points, np.arange(6)[None], np.arange(6), PRISM)


def test_the_verdict_of_checkmesh_is_read():
    assert failed_checks("Mesh OK.\n\nEnd") == 0
    assert failed_checks("Failed 3 mesh checks.\n\nEnd") == 3
    with pytest.raises(ValueError, match="no verdict"):
        failed_checks("Create time")


def test_a_row_fits_the_head():
    found = Judged(-0.0312, 0.86321, 2, 106.0, 3.301, 2, 1.2e-8)
    text = row("ours", found, 0.07)
    assert text == "| ours | -0.031 | 0.8632 | 2 | 106.0 | 3.30 | 2 failed | 1e-08 | 0.07 |"
    assert {line.count("|") for line in (*HEAD, text, row("undeflected", found, None))} == {10}
