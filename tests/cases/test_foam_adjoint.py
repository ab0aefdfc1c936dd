"""Derivatives of lift and drag: the adjoint of OpenFOAM through `sdm gradient`, beside differences of flows."""

import json
import shutil

import numpy as np
import pytest

from sdm_deflect import plan
from sdm_deflect.meshing.formats.openfoam import OpenFoam, write_files, write_list
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.cases import foam

# Of the chord; degrees of the stream, of the section, and of differences.
REYNOLDS, INCIDENCE, ANGLE, STEP = 200, 3.0, 1.0, 0.25
# Share by which a continuous adjoint may differ from differences on this mesh; found: lift .009, drag .001.
AGREED = 0.03
STREAM, ACROSS = (
    np.array([np.cos(np.radians(INCIDENCE)), np.sin(np.radians(INCIDENCE)), 0.0]),
    np.array([-np.sin(np.radians(INCIDENCE)), np.cos(np.radians(INCIDENCE)), 0.0]),
)
SCHEMES = (
    "ddtSchemes { default steadyState; } gradSchemes { default Gauss linear; }\n"
    "interpolationSchemes { default linear; }\n"
    "divSchemes { default Gauss linear; div(phi,U) bounded Gauss linear; div(-phi,Ua) bounded Gauss linear; }\n"
    "laplacianSchemes { default Gauss linear corrected; } snGradSchemes { default corrected; }\n"
)
SOLVERS = """SIMPLE { nNonOrthogonalCorrectors 0; }
solvers
{
    "p.*|pa.*|m|ma" { solver GAMG; smoother GaussSeidel; tolerance 1e-11; relTol 0.01; }
    "U.*|Ua.*" { solver PBiCGStab; preconditioner DILU; tolerance 1e-12; relTol 0.01; }
}
relaxationFactors { fields { "p.*" 0.3; "pa.*" 0.3; } equations { "U.*" 0.7; "Ua.*" 0.7; } }
"""
OPTIMISATION = """optimisationManager singleRun;
primalSolvers { op1 { active true; type incompressible; solver simple;
    solutionControls { nIters 4000; residualControl { "p.*" 1e-9; "U.*" 1e-9; } } } }
adjointManagers { m1 { primalSolver op1; adjointSolvers { adjoint { active true; type incompressible;
    solver adjointSimple; ATCModel { ATCModel standard; }
    objectives { type incompressible; objectiveNames { force { weight 1; type force; patches (section);
        direction %s; Aref 0.1; rhoInf 1; UInf 1; } } }
    solutionControls { nIters 4000; residualControl { "pa.*" 1e-9; "Ua.*" 1e-9; } } } } } }
optimisation { sensitivities { type surfacePoints; patches (section); includeSurfaceArea true;
    writeAllSurfaceFiles true; } }
"""
pytestmark = pytest.mark.nightly


def ellipse(around=96, outwards=40):
    """An ellipse, 12 % thick, in a mesh one cell thick, whose lines are confocal ellipses and hyperbolas."""
    focus, low = (0.25 - 0.06**2) ** 0.5, np.arctanh(0.12)
    growth = (np.exp(2.5 * np.linspace(0.0, 1.0, outwards + 1)) - 1.0) / (np.exp(2.5) - 1.0)
    levels, angles = low + 3.6 * growth[:, None], 2.0 * np.pi * np.arange(around) / around
    x, y = focus * np.cosh(levels) * np.cos(angles), focus * np.sinh(levels) * np.sin(angles)
    points = np.concatenate([np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)]) for z in (0.0, 0.1)])
    node = np.arange(x.size).reshape(x.shape)
    right = np.roll(node, -1, axis=1)
    quads = np.stack([node[:-1], node[1:], right[1:], right[:-1]], axis=-1).reshape(-1, 4)
    rings = [np.stack([node[i], right[i], right[i] + x.size, node[i] + x.size], axis=-1) for i in (0, -1)]
    faces = {"section": rings[0], "far_field": rings[1], "sides": np.concatenate([quads, quads + x.size])}
    kinds = {"sides": "empty"}
    patches = (Patch(name, (Cells("quad", own),), constraint=kinds.get(name, "")) for name, own in faces.items())
    return Mesh(points, (Cells("hexahedron", np.hstack([quads, quads + x.size])),), tuple(patches))


def written(vector):
    return "({:.15g} {:.15g} {:.15g})".format(*vector)


def fields():
    """The fields of flow and adjoint at the start."""
    stream = written(STREAM)
    kinds = {
        "U": ("1 -1", stream, "fixedValue; value uniform (0 0 0)", f"freestream; freestreamValue uniform {stream}"),
        "p": ("2 -2", "0", "zeroGradient", "outletInlet; outletValue uniform 0; value uniform 0"),
        "Ua": ("1 -1", "(0 0 0)", "adjointWallVelocity; value uniform (0 0 0)",
               "adjointFarFieldVelocity; value uniform (0 0 0)"),
        "pa": ("2 -2", "0", "zeroGradient", "adjointFarFieldPressure; value uniform 0"),
    }  # fmt: skip
    out = {}
    for name, (dimensions, value, wall, far) in kinds.items():
        patches = f"sides {{ type empty; }} section {{ type {wall}; }} far_field {{ type {far}; }}"
        text = f"dimensions [0 {dimensions} 0 0 0 0];\ninternalField uniform {value};\nboundaryField {{ {patches} }}\n"
        kind = "volVectorField" if name.startswith("U") else "volScalarField"
        out[name] = text, kind
    return out


def flow(base, folder, points, direction):
    """Solve flow and adjoint on points of a case; return the force, and the file of its sensitivities."""
    shutil.copytree(base, folder)
    write_list(folder / "constant/polyMesh/points", "vectorField", [points.astype("<f8")])
    control = "application adjointOptimisationFoam; startFrom startTime; startTime 0; stopAt endTime; endTime 9000;\n"
    control += "deltaT 1; writeControl timeStep; writeInterval 9000; writeFormat binary; runTimeModifiable false;\n"
    files = {
        "constant/transportProperties": f"transportModel Newtonian; nu [0 2 -1 0 0 0 0] {1 / REYNOLDS};\n",
        "constant/turbulenceProperties": "simulationType laminar;\n",
        "constant/adjointRASProperties": "adjointRASModel adjointLaminar; adjointTurbulence on; printCoeffs off;\n",
        "system/controlDict": control,
        "system/fvSchemes": SCHEMES,
        "system/fvSolution": SOLVERS,
        "system/optimisationDict": OPTIMISATION % written(direction),
    }
    write_files(folder, files)
    (folder / "0").mkdir()
    for name, (text, kind) in fields().items():
        head = f"FoamFile {{ version 2.0; format ascii; class {kind}; object {name}; }}\n"
        (folder / "0" / name).write_text(head + text)
    told = foam.run("adjointOptimisationFoam", folder)
    assert told.count("solution converged in") == 2
    force = float((folder / "optimisation/objective/0/forceadjoint").read_text().split()[-1])
    (sensitivities,) = folder.glob("*/pointSensVecadjointESI")
    return force, sensitivities


@pytest.mark.parametrize("direction", [ACROSS, STREAM], ids=["lift", "drag"])
def test_the_derivative_by_the_angle_is_that_of_differences(direction, tmp_path, sdm):
    base = tmp_path / "base"
    OpenFoam().write(ellipse(), base)
    held = plan(base, "section", [[-0.25, 0, 0], [-0.25, 0, 0.1]], range=(-4, 4))
    held.save(tmp_path / "plan.npz")
    modes = held
    _, sensitivities = flow(base, tmp_path / "adjoint", modes.at((ANGLE,)), direction)
    words = ["--plan", tmp_path / "plan.npz", "--mesh", base, "--at", str(ANGLE), "--json"]
    code, out, err = sdm("gradient", sensitivities, *words)
    assert code == 0, err
    high, low = (flow(base, tmp_path / f"{s:+}", modes.at((ANGLE + s * STEP,)), direction)[0] for s in (1, -1))
    found, difference = json.loads(out)["gradient"]["section"], (high - low) / (2.0 * STEP)
    assert found == pytest.approx(difference, rel=AGREED)
