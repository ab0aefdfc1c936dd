"""A Chimera block and its background as one case of OpenFOAM's overRhoPimpleDyMFoam.

``python -m studies.flow.overset RUN OUT``: RUN is the folder of `sdm run aileron-chimera --angle -12`, OUT a new one.
The guide's page on the flow says how far it goes.
"""

import sys
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.geometry.datum import hinge_line
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.files import fresh_folder
from sdm_deflect.meshing.formats.format import about, fitting_names
from sdm_deflect.meshing.formats.openfoam import UNFIT, write_files, write_mesh
from sdm_deflect.meshing.formats.openfoam_files import MESH
from sdm_deflect.meshing.formats.vtu import read_vtu
from sdm_deflect.meshing.formats.zones import joined
from studies.flow.openfoam import DIMENSIONS, FAR, GAS_FILES, WALL, field_file, forces, initial_values, patch_types
from studies.flow.setup import FreeStream, Hinge, Setup

SOLVER = "overRhoPimpleDyMFoam"
ZONES = ("background", "block")
OVERSET, SHARED = "overset", "symmetry"
"""Types of the outer faces of a block, and of walls that both meshes have."""
MARGIN = 0.02
"""Room (m) around the block in which OpenFOAM looks for cells of the one mesh on walls of the other."""
VOXELS = (200, 200, 100)
COURANT, FIRST_STEP, END, INTERVAL = 0.3, 1e-7, 1e-3, 50
CONTROL = """// Run: {solver}. `{shared}` is a wall that slips: those are walls of both meshes, and a type that is no
// constraint would cut holes along them (markPatchesAsHoles of the method inverseDistance).
application     {solver};
libs            ("liboverset.so" "libfvMotionSolvers.so");
startFrom       latestTime;
startTime       0;
stopAt          endTime;
endTime         {end};
deltaT          {step};
adjustTimeStep  yes;
maxCo           {courant};
maxDeltaT       1e-5;
writeControl    timeStep;
writeInterval   {interval};
purgeWrite      2;
writeFormat     binary;
writePrecision  12;
timePrecision   9;
runTimeModifiable false;
functions
{{
{functions}}}
"""
SCHEMES = """ddtSchemes { default Euler; }
gradSchemes { default Gauss linear; }
divSchemes
{
    default         Gauss upwind;
    div(((rho*nuEff)*dev2(T(grad(U))))) Gauss linear;
    div((nuEff*dev2(T(grad(U))))) Gauss linear;
}
laplacianSchemes { default Gauss linear corrected; }
interpolationSchemes { default linear; }
snGradSchemes { default corrected; }
"""
OVERLAP = """oversetInterpolation
{{
    method          inverseDistance;
    searchBox       ({low})({high});
    searchBoxDivisions ({voxels});
}}
oversetInterpolationSuppressed {{ grad(p); surfaceIntegrate(phiHbyA); }}
fluxRequired {{ default no; p; pcorr; }}
"""
SOLUTION = """solvers
{
    "cellDisplacement.*" { solver PCG; preconditioner DIC; tolerance 1e-9; relTol 0; }
    "rho.*" { solver PBiCGStab; preconditioner DILU; tolerance 1e-12; relTol 0; }
    "(p|pcorr).*" { solver PBiCGStab; preconditioner DILU; tolerance 1e-10; relTol 0.01; }
    "(U|h|e|k).*" { solver PBiCGStab; preconditioner DILU; tolerance 1e-10; relTol 0.1; }
}
PIMPLE { nOuterCorrectors 1; nCorrectors 2; nNonOrthogonalCorrectors 0; ddtCorr false; oversetAdjustPhi no; }
relaxationFactors { equations { ".*" 1; } }
"""
MOTION = """motionSolverLibs ("libfvMotionSolvers.so");
dynamicFvMesh   dynamicOversetFvMesh;
dynamicOversetFvMeshCoeffs {}
solver          displacementLaplacian;  // of nothing: the mesh stands
displacementLaplacianCoeffs { diffusivity uniform 1; }
"""


def write_overset(block: Mesh, background: Mesh, outer: str, setup: Setup, out: Path) -> tuple[str, ...]:
    """Write a block and the mesh around it as one case; return what OpenFOAM cannot hold.

    OpenFOAM finds holes and donors by itself: the walls of the one mesh cut the hole out of the other. Walls that both
    have, those of patches of the same name, must not, and are written as symmetry, which for a flow without friction
    is the same as a wall that slips.

    Parameters
    ----------
    outer : the patch of the block that interpolates from the background.
    setup : free stream and hinges; names of hinges are those of patches of the block.

    Raises
    ------
    InputError
        If the background has no far field or no wall.
    MeshFileError
        If `out` is there and not empty or cannot be written.
    """
    shared = {*block.names} & {*background.names}
    called = {name: f"{ZONES[1]}/{name}" if name in shared else name for name in block.names}
    mesh = joined(ZONES, (background, block))
    mesh = replace(mesh, patches=tuple(sorted(mesh.patches, key=lambda patch: patch.name != called[outer])))
    far = [name for name, kind in setup.kinds_on(background).items() if kind == "far"]
    both = {f"{zone}/{name}" for name in shared for zone in ZONES}
    types = {name: SHARED if name in both else "patch" if name in far else "wall" for name in mesh.names}
    types[called[outer]] = OVERSET
    fit = fitting_names(mesh.names, UNFIT)
    renamed = {name: fit[called[name]] for name in block.names}
    with fresh_folder(out) as beside, about(out):
        lost = write_mesh(mesh, beside / MESH, types)
        zones = np.repeat([0, 1], [sum(len(cells) for cells in part.cells) for part in (background, block)])
        hinges = tuple(hinge.renamed(renamed) for hinge in setup.hinges)
        box = (block.points.min(axis=0) - MARGIN, block.points.max(axis=0) + MARGIN)
        _write_settings(beside, replace(setup, hinges=hinges), zones.tolist(), box)
        (beside / "case.foam").touch()
    return lost


def _write_settings(case: Path, setup: Setup, zones: Collection[int], box: tuple[FloatArray, FloatArray]) -> None:
    low, high = (" ".join(f"{value:.9g}" for value in corner) for corner in box)
    overlap = OVERLAP.format(low=low, high=high, voxels=" ".join(map(str, VOXELS)))
    control = CONTROL.format(
        solver=SOLVER, shared=SHARED, end=END, step=FIRST_STEP, courant=COURANT, interval=INTERVAL,
        functions="".join(forces(hinge.name, list(hinge.patches), hinge.point, setup) for hinge in setup.hinges),
    )  # fmt: skip
    files = {
        "system/controlDict": control, "system/fvSchemes": SCHEMES + overlap, "system/fvSolution": SOLUTION,
        "constant/dynamicMeshDict": MOTION, **GAS_FILES,
    }  # fmt: skip
    write_files(case, files | dict(_fields(patch_types(case), setup.stream, zones)))


def _fields(patches: dict[str, str], stream: FreeStream, zones: Collection[int]) -> Iterator[tuple[str, str]]:
    """Yield path and content of the fields of the start."""
    for name, value in initial_values(stream).items():
        conditions = {"wall": WALL[name], "patch": FAR[name].format(value)}
        yield f"0/{name}", field_file(DIMENSIONS[name], f"uniform {value}", patches, conditions)
    still = "type fixedValue; value uniform (0 0 0);"
    moving = {"wall": still, "patch": still, OVERSET: "patchType overset; type zeroGradient;"}
    yield "0/pointDisplacement", field_file("[0 1 0 0 0 0 0]", "uniform (0 0 0)", patches, moving)
    numbers = "\n".join(map(str, zones))
    inner = f"nonuniform List<scalar> {len(zones)}\n(\n{numbers}\n)"
    none = "type zeroGradient;"
    yield "0/zoneID", field_file("[0 0 0 0 0 0 0]", inner, patches, {"wall": none, "patch": none})


def main(run: Path, out: Path) -> None:
    """Write the case of a finished run in a Chimera block."""
    block, background = (read_vtu(run / f"{name}.vtu") for name in ("deflected", "background"))
    hinge = Hinge.through("aileron_left", ["aileron_left"], hinge_line(Fighter(), "aileron_left"))
    write_overset(block, background, "chimera", Setup(FreeStream(mach=0.6), (hinge,)), out)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
