"""Cases of OpenFOAM's rhoCentralFoam, inviscid and steady by local time steps, which start as they are."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from sdm_deflect.base.files import fresh_folder
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.formats.format import fitting_names
from sdm_deflect.meshing.formats.openfoam import UNFIT, control, is_planar, write_files, write_mesh
from sdm_deflect.meshing.formats.openfoam_files import MESH, open_foam, parse
from sdm_deflect.meshing.formats.shapes import refuse_plane
from sdm_deflect.meshing.mesh.mesh import Mesh
from studies.flow.setup import GAMMA, GAS, FreeStream, Kind, Setup

SOLVER = "rhoCentralFoam"
# Name under which the forces on all walls are reported; those of hinges bear the hinges' names.
WHOLE = "all"
# Names that no hinge may have.
RESERVED = (WHOLE, "settle")
# Iterations between two reports of forces, and two of all fields, from which a run that was stopped goes on.
EVERY, INTERVAL = 5, 250
# Gas constant (J/kmol/K).
UNIVERSAL = 8314.46
COURANT = 0.3
# Local time steps of neighbours differ by at most 1 + this factor; OpenFOAM's own .1 keeps those far away small.
SMOOTHING = 0.5
# Reconstruction while the flow settles, and afterwards.
FIRST, SECOND = "upwind", "vanLeer"
USE = f"// Run: {SOLVER}. In parallel: decomposePar; mpirun -np 2 {SOLVER} -parallel.\n"
FUNCTIONS = """OptimisationSwitches {{ fileModificationSkew 0; }}  // fvSchemes is read again however soon it changes
functions
{{
    settle  // of first order until the waves of the start have left
    {{
        type timeActivatedFileUpdate;
        libs (utilityFunctionObjects);
        fileToUpdate "$FOAM_CASE/system/fvSchemes";
        timeVsFile
        (
            (-1 "$FOAM_CASE/system/fvSchemes.first")
            ({settling} "$FOAM_CASE/system/fvSchemes.second")
        );
    }}
{functions}}}
"""
FORCES = """    {name}{comment}
    {{
        type forces;
        libs (forces);
        patches ({patches});
        rho rho;
        p p;
        U U;
        pRef {pressure:.17g};
        CofR ({point});
        writeControl timeStep;
        executeInterval {every};
        writeInterval {every};
    }}
"""
SCHEMES = """fluxScheme      Kurganov;
ddtSchemes {{ default localEuler; }}
gradSchemes {{ default Gauss linear; }}
divSchemes {{ default none; div(tauMC) Gauss linear; }}
laplacianSchemes {{ default Gauss linear corrected; }}
interpolationSchemes
{{
    default         linear;
    reconstruct(rho) {scheme};
    reconstruct(U)  {vector};
    reconstruct(T)  {scheme};
}}
snGradSchemes {{ default corrected; }}
"""
SOLUTION = """solvers
{
    "(rho|rhoU|rhoE)" { solver diagonal; }
    "(U|h|e)" { solver smoothSolver; smoother GaussSeidel; nSweeps 2; tolerance 1e-9; relTol 0.01; }
}
"""
GAS_MODEL = """thermoType
{{
    type            hePsiThermo;
    mixture         pureMixture;
    transport       const;
    thermo          hConst;
    equationOfState perfectGas;
    specie          specie;
    energy          sensibleInternalEnergy;
}}
mixture
{{
    specie {{ molWeight {weight:.10g}; }}
    thermodynamics {{ Cp {heat:.10g}; Hf 0; }}
    transport {{ mu 0; Pr 1; }}  // inviscid
}}
"""
PARTS = """numberOfSubdomains 2;
method          hierarchical;
hierarchicalCoeffs { n (1 2 1); delta 0.001; order xyz; }
"""
FIELD_ROW = "    {patch} {{ {condition} }}\n"
TYPES: Mapping[Kind, str] = {"wall": "wall", "far": "patch", "symmetry": "symmetryPlane"}


def write_case(mesh: Mesh, out: Path, setup: Setup, progress: Progress = silent) -> tuple[str, ...]:
    """Write the folders ``constant``, ``system`` and ``0`` of a case; return what OpenFOAM cannot hold.

    Walls slip; through the far field the free stream enters, and leaves, by the sign of the flow there; planes of
    symmetry are such. `Setup.settling` iterations are of first order, by a function object of the case.

    Raises InputError if no patch is a far field, or none a wall, MeshFileError for a plane mesh, and if `out` is there
    and not empty or cannot be written.
    """
    refuse_plane(mesh, "OpenFOAM")
    types = {name: TYPES[kind] for name, kind in setup.kinds_on(mesh).items()}
    for patch in mesh.patches:
        if types[patch.name] == "symmetryPlane" and not is_planar(mesh.points[patch.nodes]):
            types[patch.name] = "symmetry"
    with fresh_folder(out) as beside, about(out):
        progress(f"writing {out.name}", 0.0)
        lost = write_mesh(mesh, beside / MESH, types)
        names = fitting_names(mesh.names, UNFIT)
        write_settings(beside, replace(setup, hinges=tuple(hinge.renamed(names) for hinge in setup.hinges)))
        (beside / "case.foam").touch()
    return lost


def field_file(
    dimensions: str, inner: str, patches: Mapping[str, str], conditions: Mapping[str, str], row: str = FIELD_ROW
) -> str:
    """Return a field: its values inside, and a condition for each patch by its type, which else is its own."""
    boundary = "".join(
        row.format(patch=patch, condition=conditions.get(kind, f"type {kind};")) for patch, kind in patches.items()
    )
    return f"dimensions {dimensions};\ninternalField {inner};\nboundaryField\n{{\n{boundary}}}\n"


def patch_types(case: Path) -> dict[str, str]:
    """Return the type of each patch of a case by its name."""
    return {patch.name: patch.type for patch in parse(open_foam(case / MESH, "boundary").text())}


def write_settings(case: Path, setup: Setup, fields: bool = True) -> None:
    """Write all files of a case but its mesh, for the patches that this has; those of the start if `fields`."""
    patches = patch_types(case)
    start = dict(_fields(patches, setup.stream)) if fields else {}
    write_files(case, {**_system(patches, setup), **GAS_FILES, **start})


def _system(patches: Mapping[str, str], setup: Setup) -> dict[str, str]:
    walls = [name for name, kind in patches.items() if kind == "wall"]
    first, second = (SCHEMES.format(scheme=name, vector=vector_of(name)) for name in (FIRST, SECOND))
    values = control(
        application=SOLVER, startFrom="latestTime", endTime=setup.iterations,
        writeInterval=min(INTERVAL, setup.iterations), writePrecision=12, timePrecision=9, runTimeModifiable="true",
        adjustTimeStep="no", maxCo=COURANT, maxDeltaT=1, rDeltaTSmoothingCoeff=SMOOTHING,
    )  # fmt: skip
    functions = FUNCTIONS.format(settling=setup.settling, functions="".join(_monitors(walls, setup)))
    return {
        "system/controlDict": USE + values + functions,
        "system/fvSchemes": first,
        "system/fvSchemes.first": first,
        "system/fvSchemes.second": second,
        "system/fvSolution": SOLUTION,
        "system/decomposeParDict": PARTS,
    }


def vector_of(scheme: str) -> str:
    """Return the name of a scheme for vectors."""
    return scheme if scheme == FIRST else f"{scheme}V"


GAS_FILES = {
    "constant/thermophysicalProperties": GAS_MODEL.format(weight=UNIVERSAL / GAS, heat=GAMMA / (GAMMA - 1.0) * GAS),
    "constant/turbulenceProperties": "simulationType laminar;\n",
}


def _monitors(walls: list[str], setup: Setup) -> Iterator[str]:
    yield forces(WHOLE, walls, setup.point, setup)
    for hinge in setup.hinges:
        axis = " ".join(f"{value:.9g}" for value in hinge.axis)
        comment = f"  // hinge moment: its moment times ({axis})"
        yield forces(hinge.name, list(hinge.patches), hinge.point, setup, comment)


def forces(name: str, patches: list[str], point: tuple[float, float, float], setup: Setup, comment: str = "") -> str:
    """Return the function object that reports forces on patches and their moment about a point (m)."""
    about = " ".join(f"{value:.17g}" for value in point)
    return FORCES.format(
        name=name, patches=" ".join(patches), pressure=setup.stream.pressure, point=about, every=EVERY, comment=comment
    )


DIMENSIONS = {"U": "[0 1 -1 0 0 0 0]", "p": "[1 -1 -2 0 0 0 0]", "T": "[0 0 0 1 0 0 0]"}
WALL = {"U": "type slip;", "p": "type zeroGradient;", "T": "type zeroGradient;"}
FAR = {
    "U": "type freestreamVelocity; freestreamValue uniform {0}; value uniform {0};",
    "p": "type freestreamPressure; freestreamValue uniform {0}; value uniform {0};",
    "T": "type inletOutlet; inletValue uniform {0}; value uniform {0};",
}


def _fields(patches: Mapping[str, str], stream: FreeStream) -> Iterator[tuple[str, str]]:
    for name, value in initial_values(stream).items():
        conditions = {"wall": WALL[name], "patch": FAR[name].format(value)}
        yield f"0/{name}", field_file(DIMENSIONS[name], f"uniform {value}", patches, conditions)


def initial_values(stream: FreeStream) -> dict[str, str]:
    """Return the free stream's velocity, pressure and temperature as OpenFOAM has them."""
    velocity = stream.speed * stream.directions[0]
    return {
        "U": f"({' '.join(f'{value:.17g}' for value in velocity)})",
        "p": f"{stream.pressure:.17g}",
        "T": f"{stream.temperature:.17g}",
    }
