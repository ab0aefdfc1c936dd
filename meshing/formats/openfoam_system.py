"""Settings in the folder ``system`` with which checkMesh, potentialFoam and simpleFoam run: robust, of first order."""

from __future__ import annotations

from pathlib import Path

from sdm_deflect.meshing.formats.openfoam_write import header

CONTROL = """application     simpleFoam;
startFrom       startTime;
startTime       0;
stopAt          endTime;
endTime         500;
deltaT          1;
writeControl    timeStep;
writeInterval   500;
purgeWrite      1;
writeFormat     binary;
runTimeModifiable false;
"""
SCHEMES = """ddtSchemes
{
    default         steadyState;
}
gradSchemes
{
    default         cellLimited Gauss linear 1;
}
divSchemes
{
    default         none;
    div(phi,U)      Gauss upwind;
    div(div(phi,U)) Gauss linear;
    div((nuEff*dev2(T(grad(U))))) Gauss linear;
}
laplacianSchemes
{
    default         Gauss linear limited 0.5;
}
interpolationSchemes
{
    default         linear;
}
snGradSchemes
{
    default         limited 0.5;
}
"""
SOLUTION = """solvers
{
    Phi
    {
        solver          GAMG;
        smoother        DICGaussSeidel;
        tolerance       1e-9;
        relTol          0.01;
    }
    p
    {
        $Phi;
        tolerance       1e-7;
        relTol          0.05;
    }
    U
    {
        solver          smoothSolver;
        smoother        GaussSeidel;
        tolerance       1e-8;
        relTol          0.1;
    }
}
potentialFlow
{
    nNonOrthogonalCorrectors 10;
}
SIMPLE
{
    nNonOrthogonalCorrectors 1;
    pRefCell        0;
    pRefValue       0;
}
relaxationFactors
{
    equations
    {
        U               0.7;
    }
    fields
    {
        p               0.3;
    }
}
"""


def write_system(case: Path) -> None:
    """Write the folder ``system`` of a case."""
    folder = case / "system"
    folder.mkdir()
    for name, content in (("controlDict", CONTROL), ("fvSchemes", SCHEMES), ("fvSolution", SOLUTION)):
        (folder / name).write_text(header("dictionary", name, "system") + content, encoding="utf-8")
