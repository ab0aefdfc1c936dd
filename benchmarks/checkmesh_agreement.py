"""Whether the verdict agrees with OpenFOAM's checkMesh: 22 meshes, their flap at 10, 20 and 30 degrees either way.

``python -m benchmarks.checkmesh_agreement --folder FOLDER > checkmesh_agreement.md`` makes small meshes around the
guide's half wing: tetrahedra of Gmsh, their polyhedral duals, and snappyHexMesh with and without layers. Each is
deflected with and without repair, and checkMesh is asked before and after. Meshes and figures are kept in FOLDER, and a
run goes on where another was stopped. It needs OpenFOAM (``apt-get install --no-install-recommends openfoam``).
"""

import argparse
import json
import os
import re
import runpy
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from benchmarks.results import machine
from sdm_deflect.cases.api import Result, deflect
from sdm_deflect.deform.mesh.orthogonality import face_quality
from sdm_deflect.meshing.formats.openfoam import OpenFoam

WING = runpy.run_path(str(Path(__file__).parents[1] / "docs" / "examples" / "naca_wing.py"))
HINGE, ANGLES = [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]], (-30.0, -20.0, -10.0, 10.0, 20.0, 30.0)
MODES = ("off", "auto")
GMSH = {f"tetrahedra {fineness:g}, {name}": (fineness, code) for fineness, name, code in (
    (0.35, "Delaunay", 1), (0.5, "Delaunay", 1), (0.65, "Delaunay", 1), (0.5, "HXT", 10), (0.4, "frontal", 4),
    (0.6, "frontal", 4), (0.35, "HXT", 10), (0.3, "frontal", 4),
)}  # fmt: skip
"""Fineness of the guide's wing, and Gmsh's algorithm."""
DUAL = {f"dual of {name}": name for name in list(GMSH)[:2]}
SNAPPY = {f"snappyHexMesh, wing {wing}, flap {flap}, {layers} layers": (wing, flap, layers) for wing, flap, layers in (
    (3, 3, 0), (3, 4, 0), (4, 4, 0), (3, 3, 1), (3, 4, 1), (3, 3, 2), (3, 4, 2), (4, 4, 2), (3, 3, 3), (3, 4, 3),
    (2, 3, 1), (2, 3, 2),
)}  # fmt: skip
"""How often cells of 0.25 are halved at wing and flap, and the layers there."""
BY_CHECKMESH = ("inverted_cells", "skewness_max")
"""Checks that fail where checkMesh finds fault; so does non-orthogonality from 90 degrees on."""
SHOWN = ("non_orthogonality_max", "skewness_max", "first_layer")
HEAD = "FoamFile { version 2.0; format ascii; class dictionary; object %s; }\n"
CONTROL = "startFrom startTime; startTime 0; stopAt endTime; endTime 1; deltaT 1; writeInterval 1; writePrecision 12;\n"
BLOCK = """vertices ((-1 0 -1) (2 0 -1) (2 3 -1) (-1 3 -1) (-1 0 1) (2 0 1) (2 3 1) (-1 3 1));
blocks (hex (0 1 2 3 4 5 6 7) (12 12 8) simpleGrading (1 1 1));
boundary
(
    symmetry { type symmetryPlane; faces ((0 1 5 4)); }
    far_field { type patch; faces ((0 4 7 3) (2 6 5 1) (3 7 6 2) (0 3 2 1) (4 5 6 7)); }
);
"""
EDGES = "wing.stl { extractionMethod extractFromSurface; extractFromSurfaceCoeffs { includedAngle 150; } }\n"
SNAP = """castellatedMesh true; snap true; addLayers %(add)s; mergeTolerance 1e-6;
geometry { wing.stl { type triSurfaceMesh; name body; regions { wing { name wing; } flap { name flap; } } } }
castellatedMeshControls
{
    maxLocalCells 1000000; maxGlobalCells 2000000; minRefinementCells 0; nCellsBetweenLevels 2;
    resolveFeatureAngle 30; locationInMesh (-0.51 1.03 0.47); allowFreeStandingZoneFaces true;
    features ({ file "wing.eMesh"; level %(wing)d; });
    refinementRegions { }
    refinementSurfaces { body { level (%(wing)d %(wing)d); regions { flap { level (%(flap)d %(flap)d); } } } }
}
snapControls
{
    nSmoothPatch 3; tolerance 2; nSolveIter 30; nRelaxIter 5; nFeatureSnapIter 10;
    implicitFeatureSnap false; explicitFeatureSnap true; multiRegionFeatureSnap true;
}
addLayersControls
{
    relativeSizes true; expansionRatio 1.2; finalLayerThickness 0.3; minThickness 0.05;
    layers { "(wing|flap)" { nSurfaceLayers %(layers)d; } }
    nGrow 0; featureAngle 100; nRelaxIter 3; nSmoothSurfaceNormals 1; nSmoothNormals 3; nSmoothThickness 10;
    maxFaceThicknessRatio 0.5; maxThicknessToMedialRatio 0.3; minMedialAxisAngle 90;
    nBufferCellsNoExtrude 0; nLayerIter 20;
}
meshQualityControls
{
    maxNonOrtho 65; maxBoundarySkewness 4; maxInternalSkewness 4; maxConcave 80; minVol 1e-15;
    minTetQuality 1e-15; minArea -1; minTwist 0.02; minDeterminant 0.001; minFaceWeight 0.05; minVolRatio 0.01;
    minTriangleTwist -1; nSmoothScale 4; errorReduction 0.75;
}
"""


def run(program: str, case: Path, *words: str) -> str:
    """Return what a program of OpenFOAM prints on a case."""
    command = [program, "-case", str(case.resolve()), *words]
    environment = {"WM_PROJECT_DIR": "/usr/share/openfoam"} | os.environ
    done = subprocess.run(command, cwd=case, env=environment, capture_output=True, text=True, check=False)
    if "FOAM FATAL" in done.stdout + done.stderr:
        raise RuntimeError(f"{program} failed: {done.stdout[-500:]}{done.stderr[-500:]}")
    return done.stdout


def new_case(case: Path, **files: str) -> Path:
    """Make the folder of a case with its settings."""
    (case / "system").mkdir(parents=True)
    (case / "constant" / "triSurface").mkdir(parents=True)
    schemes = ("ddt", "grad", "div", "laplacian", "interpolation", "snGrad")
    files |= {"controlDict": CONTROL, "fvSchemes": "".join(f"{one}Schemes {{ }}\n" for one in schemes)}
    for name, text in (files | {"fvSolution": ""}).items():
        (case / "system" / name).write_text(HEAD % name + text)
    return case


def tetrahedra(case: Path, fineness: float, algorithm: int) -> None:
    """Mesh the guide's wing by Gmsh, for OpenFOAM to convert."""
    new_case(case)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 2)
        _named_wing(fineness)
        gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
        gmsh.model.mesh.generate(3)
        gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
        gmsh.write(str(case / "naca.msh"))
    finally:
        gmsh.finalize()
    run("gmshToFoam", case, "naca.msh")


def _named_wing(fineness: float) -> dict[str, list[int]]:
    WING["fluid"]()
    surfaces: dict[str, list[int]] = {}
    for _, tag in gmsh.model.getEntities(2):
        surfaces.setdefault(WING["name_of"](tag), []).append(tag)
    for name, tags in surfaces.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="fluid")
    WING["sizes"](fineness)
    return surfaces


def snapped(case: Path, wing: int, flap: int, layers: int) -> None:
    """Mesh the guide's wing by snappyHexMesh."""
    words = {"wing": wing, "flap": flap, "layers": layers, "add": "true" if layers else "false"}
    new_case(case, blockMeshDict=BLOCK, surfaceFeatureExtractDict=EDGES, snappyHexMeshDict=SNAP % words)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 2)
        surfaces = _named_wing(4.0)
        gmsh.model.mesh.generate(2)
        text = "".join(_solid(name, surfaces[name]) for name in ("wing", "flap"))
    finally:
        gmsh.finalize()
    (case / "constant" / "triSurface" / "wing.stl").write_text(text)
    run("blockMesh", case)
    run("surfaceFeatureExtract", case)
    run("snappyHexMesh", case, "-overwrite")


def _solid(name: str, surfaces: list[int]) -> str:
    """Return the triangles of some surfaces as a solid of an STL file."""
    lines = [f"solid {name}"]
    for surface in surfaces:
        _, nodes = gmsh.model.mesh.getElementsByType(2, surface)
        tags, places, _ = gmsh.model.mesh.getNodes(2, surface, includeBoundary=True)
        at = dict(zip(tags.tolist(), places.reshape(-1, 3).tolist(), strict=True))
        for corners in nodes.reshape(-1, 3).tolist():
            rows = "".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in (at[node] for node in corners))
            lines.append(f"facet normal 0 0 0\nouter loop\n{rows}endloop\nendfacet")
    return "\n".join([*lines, f"endsolid {name}", ""])


def made(folder: Path, name: str) -> Path:
    """Return the case of a mesh, which is made if it is not there."""
    case = folder / re.sub(r"\W+", "-", name)
    if (case / "made").exists():
        return case
    shutil.rmtree(case, ignore_errors=True)
    if name in GMSH:
        tetrahedra(case, *GMSH[name])
    elif name in DUAL:
        tetrahedra(case, *GMSH[DUAL[name]])
        run("polyDualMesh", case, "75", "-overwrite")
    else:
        snapped(case, *SNAPPY[name])
    (case / "made").touch()
    return case


def asked(case: Path) -> dict[str, Any]:
    """Return what checkMesh says of a case."""
    text = run("checkMesh", case)
    number = r"(-?[\d.]+(?:e[+-]?\d+)?)"
    angles = re.search(rf"non-orthogonality Max: {number} average: {number}", text)
    skew, cells = (re.search(pattern, text) for pattern in (rf"Max skewness = {number}", r"cells: +(\d+)"))
    severe = re.search(r"severely non-orthogonal.*faces: (\d+)", text)
    assert angles
    assert skew
    assert cells
    return {
        "ok": "Mesh OK." in text,
        "said": [re.sub(r"\s+", " ", line.strip(" *"))[:60] for line in text.splitlines() if "***" in line],
        "cells": int(cells[1]),
        "largest": float(angles[1]),
        "mean": float(angles[2]),
        "severe": int(severe[1]) if severe else 0,
        "skewness": float(skew[1]),
    }


def measured(case: Path, angle: float, mode: Any) -> dict[str, Any]:
    """Deflect the flap of a case, and return both verdicts."""
    result = deflect(
        case, "flap", HINGE, angle, motion="blended", fixed="wing", slide="symmetry:plane", repair=mode,
        allow_inverted=True,
    )  # fmt: skip
    out = case.with_name(f"{case.name}-out")
    shutil.rmtree(out, ignore_errors=True)
    OpenFoam().rewrite(case, result.points, out)
    found = asked(out)
    ours = _ours(result)
    off = max(abs(found[key] - ours[key]) / max(abs(found[key]), 1.0) for key in ("largest", "mean", "skewness"))
    failed = {check.name: check.value for check in result.checks if not check.passed}
    values = {check.name: check.value for check in result.checks if check.name in SHOWN}
    alike = found["severe"] == ours["severe"]
    return {"checkmesh": found, "failed": failed, "values": values, "off": off, "alike": alike}


def _ours(result: Result) -> dict[str, float]:
    whole = face_quality(result.plan.mesh.with_points(result.points))
    assert whole
    return {
        "largest": whole.non_orthogonality_max,
        "mean": whole.non_orthogonality_mean,
        "skewness": whole.skewness_max,
        "severe": whole.severe,
    }


def finds_fault(row: dict[str, Any]) -> bool:
    """Whether a check fails that stands for one of checkMesh's."""
    failed = row["failed"]
    return any(name in failed for name in BY_CHECKMESH) or failed.get("non_orthogonality_max", 0.0) >= 90.0


def tried(folder: Path) -> dict[str, Any]:
    """Return of each mesh what checkMesh says of it, and both verdicts by angle and mode."""
    store = folder / "found.json"
    found = json.loads(store.read_text()) if store.exists() else {}
    for mode in MODES:
        for name in (*GMSH, *DUAL, *SNAPPY):
            case = made(folder, name)
            own = found.setdefault(name, {"before": asked(case), "rows": {}})
            for angle in ANGLES:
                if (key := f"{angle:+g} {mode}") not in own["rows"]:
                    own["rows"][key] = measured(case, angle, mode)
                    store.write_text(json.dumps(found, indent=1))
    return dict(found)


def page(found: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of the page."""
    rows: list[tuple[bool, dict[str, Any]]] = []
    yield "| mesh | cells | before: deg, skewness | runs | checkMesh OK | ours finds a fault | agree | passed |"
    yield f"|{' --- |' * 8}"
    for name, one in found.items():
        before, own = one["before"], list(one["rows"].values())
        rows += [(before["ok"], one) for one in own]
        good = sum(one["checkmesh"]["ok"] for one in own)
        alike = sum(one["checkmesh"]["ok"] != finds_fault(one) for one in own)
        state = f"{before['largest']:.1f}, {before['skewness']:.2f}" + ("" if before["ok"] else ", not OK")
        passed = sum(not one["failed"] for one in own)
        faults = sum(map(finds_fault, own))
        yield f"| {name} | {before['cells']} | {state} | {len(own)} | {good} | {faults} | {alike} | {passed} |"
    alike = sum(one["checkmesh"]["ok"] != finds_fault(one) for ok, one in rows if ok)
    lenient = sum(not one["checkmesh"]["ok"] and not one["failed"] for ok, one in rows if ok)
    sound = sum(ok for ok, _ in rows)
    off = max(one["off"] for _, one in rows)
    yield ""
    yield f"Of {sound} deflected meshes that were OK to checkMesh before, {alike} have the same verdict from both."
    yield f"{lenient} are passed by ours and not OK to checkMesh. Largest difference of a figure, relative: {off:.1e}."
    others: dict[str, int] = {}
    for _, one in rows:
        if one["checkmesh"]["ok"]:
            for check in one["failed"]:
                others[check] = others.get(check, 0) + 1
    yield f"Checks that fail where checkMesh is content: {others or 'none'}."
    for kind in ("tetrahedra", "snappyHexMesh"):
        own = [row["values"] for name, one in found.items() if name.startswith(kind) for row in one["rows"].values()]
        angles = np.array([row["non_orthogonality_max"] for row in own])
        counts = ", ".join(f"{np.count_nonzero(angles > limit)} above {limit}" for limit in (70, 75, 80, 85))
        yield f"Largest non-orthogonality of faces up to 85 degrees before, {len(own)} runs of {kind}: {counts}."
    layers = [row["values"].get("first_layer", 0.0) for one in found.values() for row in one["rows"].values()]
    yield f"Largest change of a first layer: {max(layers):.1%}."


def main() -> None:
    """Print the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True, help="where meshes and figures are kept")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    print(f"# The verdict beside checkMesh's\n\n{machine()}\n")
    for line in page(tried(folder)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
