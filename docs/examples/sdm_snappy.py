"""The SDM meshed by snappyHexMesh, from the triangles that `sdm geometry --out sdm.stl` writes.

    python sdm_snappy.py [sdm.stl [FOLDER]]

writes an OpenFOAM case into a new folder. The solids of the file become patches of their names.
"""

import re
import shutil
import sys
from pathlib import Path

BLOCK = """scale 1;
vertices ((-1 -1.2 -1) (2 -1.2 -1) (2 1.2 -1) (-1 1.2 -1) (-1 -1.2 1) (2 -1.2 1) (2 1.2 1) (-1 1.2 1));
blocks (hex (0 1 2 3 4 5 6 7) (30 24 20) simpleGrading (1 1 1));
boundary (far_field { type patch; faces ((0 4 7 3) (2 6 5 1) (1 5 4 0) (3 7 6 2) (0 3 2 1) (4 5 6 7)); });
"""
SNAPPY = """castellatedMesh true; snap true; addLayers false; mergeTolerance 1e-6;
geometry { sdm.stl { type triSurfaceMesh; name sdm; regions { %(names)s } } }
castellatedMeshControls
{
    maxLocalCells 1000000; maxGlobalCells 2000000; minRefinementCells 0; nCellsBetweenLevels 2;
    resolveFeatureAngle 30; locationInMesh (-0.3333 -0.4111 0.3777); allowFreeStandingZoneFaces true;
    features ({ file "sdm.eMesh"; level %(level)d; });
    refinementRegions { }
    refinementSurfaces { sdm { level (%(level)d %(level)d); patchInfo { type wall; } } }
}
snapControls { nSmoothPatch 3; tolerance 2; nSolveIter 30; nRelaxIter 5; nFeatureSnapIter 10; }
addLayersControls { }
meshQualityControls
{
    maxNonOrtho 65; maxBoundarySkewness 4; maxInternalSkewness 4; maxConcave 80; minVol 1e-15; minTetQuality 1e-15;
    minArea -1; minTwist 0.02; minDeterminant 0.001; minFaceWeight 0.05; minVolRatio 0.01; minTriangleTwist -1;
    nSmoothScale 4; errorReduction 0.75;
}
"""
EXTRACT = "sdm.stl { extractionMethod extractFromSurface; extractFromSurfaceCoeffs { includedAngle 150; } }\n"
CONTROL = "startFrom startTime; startTime 0; stopAt endTime; endTime 1; deltaT 1; writeInterval 1; writePrecision 12;\n"


def write_case(stl: Path, folder: Path, level: int = 3) -> tuple[str, ...]:
    """Write what blockMesh, surfaceFeatureExtract and snappyHexMesh read; return the names of the patches.

    Cells of 0.1 m are halved `level` times at the aircraft.
    """
    for name in ("constant/triSurface", "system"):
        (folder / name).mkdir(parents=True)
    shutil.copy(stl, folder / "constant/triSurface/sdm.stl")
    names = tuple(re.findall(r"^solid (\S+)", stl.read_text(), re.MULTILINE))
    regions = {"names": " ".join(f"{name} {{ name {name}; }}" for name in names), "level": level}
    files = {
        "blockMeshDict": BLOCK,
        "surfaceFeatureExtractDict": EXTRACT,
        "snappyHexMeshDict": SNAPPY % regions,
        "controlDict": CONTROL,
        "fvSchemes": "".join(f"{name}Schemes {{ }}\n" for name in ("ddt", "grad", "div", "laplacian", "snGrad")),
        "fvSolution": "",
    }
    for name, text in files.items():
        head = f"FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n"
        (folder / "system" / name).write_text(head + text)
    return names


if __name__ == "__main__":
    words = [*sys.argv[1:], *("sdm.stl", "sdm-case")[len(sys.argv) - 1 :]]
    write_case(Path(words[0]), Path(words[1]))
