"""A mesh of polyhedra with layers around half the aircraft, made by snappyHexMesh as its users do."""

from pathlib import Path

from sdm_deflect.geometry.aircraft import build
from sdm_deflect.geometry.parameters import Fighter
from tests.cases import foam

SURFACE = "aileron_left"
# How often cells of 0.1 m are halved at a patch; elsewhere 4 times.
LEVELS = {SURFACE: 6}
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
    layers { "(wing|aileron)_left" { nSurfaceLayers %(layers)d; } }
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


def make(folder: Path, layers: int = 2) -> None:
    """Make the mesh of a case, with so many layers on the wing, in a folder that does not exist yet."""
    for name in ("constant/triSurface", "system"):
        (folder / name).mkdir(parents=True)
    model = build(Fighter())
    model.write(folder / "constant/triSurface/sdm.stl")
    levels = ((name, LEVELS.get(name, 4)) for name in model.patches if not name.endswith("_right"))
    regions = {
        "names": " ".join(f"{name} {{ name {name}; }}" for name in model.patches),
        "levels": " ".join(f"{name} {{ level ({n} {n}); patchInfo {{ type wall; }} }}" for name, n in levels),
    }
    schemes = ("ddt", "grad", "div", "laplacian", "interpolation", "snGrad")
    files = {
        "blockMeshDict": BOX,
        "surfaceFeatureExtractDict": EXTRACT,
        "snappyHexMeshDict": SNAPPY % {**regions, "layers": layers},
        "controlDict": CONTROL,
        "fvSchemes": "".join(f"{name}Schemes {{ }}\n" for name in schemes),
        "fvSolution": "",
    }
    for name, text in files.items():
        head = f"FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n"
        (folder / "system" / name).write_text(head + text)
    for program in ("blockMesh", "surfaceFeatureExtract", "snappyHexMesh"):
        foam.run(program, folder, *(["-overwrite"] if program == "snappyHexMesh" else []))
