"""A mesh of polyhedra with layers, made by snappyHexMesh around half the aircraft, as its users bring it."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest

from sdm_deflect.cases.api import deflect
from sdm_deflect.cases.inspection import inspected
from sdm_deflect.deform.polyhedra import pyramids_of
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.geometry.aircraft import build
from sdm_deflect.geometry.datum import hinge_line
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from tests.cases import foam

pytestmark = pytest.mark.mesher

SURFACE, ANGLE = "aileron_left", -12.0
LEVELS = {SURFACE: 6}
"""How often cells of 0.1 m are halved at a patch; elsewhere 4 times."""
BOX = """vertices ((-0.6 -0.8 -0.6) (1.6 -0.8 -0.6) (1.6 0 -0.6) (-0.6 0 -0.6)
          (-0.6 -0.8 0.6) (1.6 -0.8 0.6) (1.6 0 0.6) (-0.6 0 0.6));
blocks (hex (0 1 2 3 4 5 6 7) (22 8 12) simpleGrading (1 1 1));
boundary
(
    symmetry { type symmetryPlane; faces ((3 7 6 2)); }
    far_field { type patch; faces ((0 4 7 3) (2 6 5 1) (1 5 4 0) (0 3 2 1) (4 5 6 7)); }
);
"""
SNAPPY = """castellatedMesh true; snap true; addLayers true; mergeTolerance 1e-6;
geometry { sdm.stl { type triSurfaceMesh; name sdm; regions { %(names)s } } }
castellatedMeshControls
{
    maxLocalCells 1000000; maxGlobalCells 2000000; minRefinementCells 0; nCellsBetweenLevels 2;
    resolveFeatureAngle 30; locationInMesh (-0.3333 -0.4111 0.3777); allowFreeStandingZoneFaces true;
    features ({ file "sdm.eMesh"; level 4; });
    refinementRegions { }
    refinementSurfaces { sdm { level (4 4); regions { %(levels)s } } }
}
snapControls
{
    nSmoothPatch 3; tolerance 2; nSolveIter 30; nRelaxIter 5; nFeatureSnapIter 10;
    implicitFeatureSnap false; explicitFeatureSnap true; multiRegionFeatureSnap true;
}
addLayersControls
{
    relativeSizes true; expansionRatio 1.2; finalLayerThickness 0.3; minThickness 0.05;
    layers { "(wing|aileron)_left" { nSurfaceLayers 2; } }
    nGrow 0; featureAngle 100; nRelaxIter 3; nSmoothSurfaceNormals 1; nSmoothNormals 3; nSmoothThickness 10;
    maxFaceThicknessRatio 0.5; maxThicknessToMedialRatio 0.3; minMedialAxisAngle 90;
    nBufferCellsNoExtrude 0; nLayerIter 20;
}
meshQualityControls
{
    maxNonOrtho 65; maxBoundarySkewness 3; maxInternalSkewness 2.5; maxConcave 80; minVol 1e-15;
    minTetQuality 1e-15; minArea -1; minTwist 0.02; minDeterminant 0.001; minFaceWeight 0.05; minVolRatio 0.01;
    minTriangleTwist -1; nSmoothScale 4; errorReduction 0.75;
}
"""
EXTRACT = "sdm.stl { extractionMethod extractFromSurface; extractFromSurfaceCoeffs { includedAngle 150; } }\n"
CONTROL = "startFrom startTime; startTime 0; stopAt endTime; endTime 1; deltaT 1; writeInterval 1; writePrecision 12;\n"


def write_stl(path):
    """Write the aircraft, one solid for each patch, and return the patches' names."""
    model = build(Fighter())
    with path.open("w", encoding="ascii") as out:
        for patch in model.patches:
            out.write(f"solid {patch}\n")
            for face in model.faces_of(patch):
                points, triangles = face.tessellation(3e-4)
                for corners in points[triangles]:
                    loop = "".join("vertex {:.9g} {:.9g} {:.9g}\n".format(*corner) for corner in corners)
                    out.write(f"facet normal 0 0 0\nouter loop\n{loop}endloop\nendfacet\n")
            out.write(f"endsolid {patch}\n")
    return model.patches


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A case folder whose mesh is that of snappyHexMesh."""
    folder = tmp_path_factory.mktemp("snappy") / "sdm"
    for name in ("constant/triSurface", "system"):
        (folder / name).mkdir(parents=True)
    names = write_stl(folder / "constant/triSurface/sdm.stl")
    levels = ((name, LEVELS.get(name, 4)) for name in names if not name.endswith("_right"))
    regions = {
        "names": " ".join(f"{name} {{ name {name}; }}" for name in names),
        "levels": " ".join(f"{name} {{ level ({n} {n}); patchInfo {{ type wall; }} }}" for name, n in levels),
    }
    schemes = ("ddt", "grad", "div", "laplacian", "interpolation", "snGrad")
    files = {
        "blockMeshDict": BOX,
        "surfaceFeatureExtractDict": EXTRACT,
        "snappyHexMeshDict": SNAPPY % regions,
        "controlDict": CONTROL,
        "fvSchemes": "".join(f"{name}Schemes {{ }}\n" for name in schemes),
        "fvSolution": "",
    }
    for name, text in files.items():
        head = f"FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n"
        (folder / "system" / name).write_text(head + text)
    for program in ("blockMesh", "surfaceFeatureExtract", "snappyHexMesh"):
        foam.run(program, folder, *(["-overwrite"] if program == "snappyHexMesh" else []))
    return folder


def number(name, text):
    return float(re.search(rf"{name}\s*[:=]\s*([\d.e+-]+\d)", text)[1])


def wrong_faces(folder):
    """Faces that checkMesh found to be turned the wrong way."""
    text = (folder / "constant/polyMesh/sets/wrongOrientedFaces").read_text()
    count, listed = re.search(r"\n(\d+)\n\(([\d\s]+)\)", text).groups()
    faces = np.array(listed.split(), dtype=int)
    assert len(faces) == int(count)
    return faces


def test_layers_and_polyhedra_are_read_with_the_verdict_of_checkmesh(case):
    text, mesh = foam.run("checkMesh", case), OpenFoam().read(case)
    assert "Mesh OK." in text
    assert number("polyhedra", text) > 5000
    assert number("prisms", text) > 500
    found = inspected(case)
    assert found["cells"] == number("cells", text) > 20_000
    assert found["quality"][0]["inverted"] == 0
    volume = pyramids_of(mesh.points, mesh.cells[0]).volume
    assert volume.min() == pytest.approx(number("Min volume", text), rel=1e-6)
    assert volume.sum() == pytest.approx(number("Total volume", text), rel=1e-10)


def test_the_cells_found_inverted_are_those_of_the_faces_that_checkmesh_finds_wrong(case, tmp_path):
    mesh = OpenFoam().read(case)
    inner = np.setdiff1d(np.arange(len(mesh.points)), mesh.on(*mesh.names))
    some = np.random.default_rng(5).choice(inner, 200, replace=False)
    points = mesh.points.copy()
    points[some] += 2e-3 * np.random.default_rng(6).normal(size=(200, 3))
    OpenFoam().rewrite(case, points, tmp_path / "bent")
    text = foam.run("checkMesh", tmp_path / "bent")
    cells = mesh.cells[0]
    wrong = wrong_faces(tmp_path / "bent")
    pyramids = pyramids_of(points, cells)
    inverted = np.flatnonzero(pyramids.inverted)
    assert number("Number of negative volume cells", text) == np.count_nonzero(pyramids.volume <= 0.0) > 10
    assert pyramids.volume.min() == pytest.approx(number("Minimum negative volume", text), rel=1e-6)
    assert len(wrong) > len(inverted) > 50
    inside = wrong[wrong < len(cells.neighbour)]
    sides = np.concatenate([cells.owner[wrong], cells.neighbour[inside]])
    assert set(inverted) <= set(sides)
    at_face = np.isin(cells.owner[wrong], inverted)
    at_face[wrong < len(cells.neighbour)] |= np.isin(cells.neighbour[inside], inverted)
    assert at_face.all()
    assert inspected(tmp_path / "bent")["quality"][0]["inverted"] == len(inverted)


def test_the_aileron_deflects_and_checkmesh_finds_no_fault(case):
    """The command is run inside the case folder, and does what the function does."""
    mesh, hinge = OpenFoam().read(case), hinge_line(Fighter(), SURFACE)
    fixed = [name for name in mesh.names if name not in (SURFACE, "far_field")]
    result = deflect(mesh, [SURFACE], hinge, ANGLE, motion=Blended(Rotation.about(*hinge)), fixed=fixed)
    assert result.passed, result.checks
    moved = np.linalg.norm(result.points - mesh.points, axis=1)[mesh.on(SURFACE)]
    assert moved.max() > 3e-3
    ends = [",".join(map(repr, map(float, end))) for end in hinge]
    words = ["--surface", SURFACE, "--hinge", *ends, "--angle", str(ANGLE), "--motion", "blended"]
    words += ["--fixed", ",".join(fixed), "--quiet"]
    done = subprocess.run(
        [sys.executable, "-m", "sdm_deflect", "deflect", ".", *words],
        cwd=case,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    out = case.with_name("sdm-deflected")
    written = OpenFoam().read(out)
    np.testing.assert_allclose(written.points, result.points, rtol=0.0, atol=1e-10)
    assert "Mesh OK." in foam.run("checkMesh", out)


def test_a_missing_program_fails_under_ci_and_skips_elsewhere(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    for ci, outcome in (("1", pytest.fail.Exception), ("", pytest.skip.Exception)):
        monkeypatch.setenv("CI", ci)
        with pytest.raises(outcome, match="checkMesh is not installed"):
            foam.run("checkMesh", tmp_path)
