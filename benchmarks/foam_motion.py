"""OpenFOAM's moveDynamicMesh on a boundary whose motion is given."""

import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.measure import FloatArray, processor_seconds
from sdm_deflect.deform.base.arrays import IntArray
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.meshing.formats.openfoam import header, kind_of
from sdm_deflect.meshing.formats.openfoam_files import open_foam, vectors
from tests.cases import foam

LAPLACIAN, SBR = "displacementLaplacian", "displacementSBRStress"
SAME = 1e-9
"""Largest distance (m) of a moving node from where it shall be."""
SCHEMES = "".join(
    f"{name}Schemes {{ default {scheme}; }}\n"
    for name, scheme in {
        "ddt": "Euler", "grad": "Gauss linear", "div": "Gauss linear", "laplacian": "Gauss linear corrected",
        "interpolation": "linear", "snGrad": "corrected",
    }.items()
)  # fmt: skip
SOLUTION = 'solvers { "cellDisplacement.*" { solver GAMG; smoother GaussSeidel; tolerance 1e-10; relTol 0; } }\n'
CONTROL = """startFrom startTime; startTime 0; stopAt endTime; endTime %(steps)d; deltaT 1;
writeControl timeStep; writeInterval %(last)d; writeFormat binary;
"""
DYNAMIC = """dynamicFvMesh dynamicMotionSolverFvMesh; motionSolverLibs ("libfvMotionSolvers.so");
motionSolver %(solver)s; solver %(solver)s;
%(solver)sCoeffs { diffusivity quadratic inverseDistance (%(moving)s); }
"""
FIXED, SLIP = "type fixedValue; value uniform (0 0 0);", "type slip;"
GIVEN = "type timeVaryingMappedFixedValue; mapMethod nearest; setAverage false; value uniform (0 0 0);"


@dataclass(frozen=True, slots=True)
class Motion:
    """How moveDynamicMesh shall move a mesh.

    Attributes
    ----------
    solver : `LAPLACIAN` or `SBR`; with both the diffusivity is that of the squared inverse distance.
    steps : equal steps in which the boundary moves; in none the program starts, reads the mesh and ends.
    slips : whether the faces of the box slip; else they are pinned.
    """

    solver: str
    steps: int
    slips: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class GivenBoundary:
    """A mesh, and how its boundary moves; patches that are not named stay.

    Attributes
    ----------
    case : folder of the mesh as a case of OpenFOAM.
    mesh : the same, with the same names of patches.
    moving : the patch that moves.
    displacement : (K, 3) that of its nodes.
    box : the plane faces of the box.
    """

    case: Path
    mesh: Mesh
    moving: str
    displacement: FloatArray = field(repr=False)
    box: tuple[str, ...]

    @property
    def nodes(self) -> IntArray:
        """Nodes (K,) of the moving patch."""
        return self.mesh.patch(self.moving).nodes

    def moved(self, motion: Motion, folder: Path) -> tuple[FloatArray, float]:
        """Run moveDynamicMesh in a fresh folder; return the points (N, 3), and the program's processor seconds.

        Raises RuntimeError if a moving node is not where it shall be.
        """
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(self.case, folder)
        self.write(motion, folder)
        begin = processor_seconds()
        foam.run("moveDynamicMesh", folder)
        seconds = processor_seconds() - begin
        if not motion.steps:
            return self.mesh.points, seconds
        points = vectors(open_foam(folder / str(motion.steps) / "polyMesh", "points")).values
        off = np.abs(points[self.nodes] - self.mesh.points[self.nodes] - self.displacement).max()
        if off > SAME:
            raise RuntimeError(f"{motion.solver}: a node of {self.moving} is {off:g} m from where it shall be")
        return points, seconds

    def write(self, motion: Motion, folder: Path) -> None:
        """Write the program's settings, and the displacements of the boundary, into a copy of the case."""
        last = max(motion.steps, 1)
        words = {"steps": motion.steps, "last": last, "solver": motion.solver, "moving": self.moving}
        for place, text in {
            "system/controlDict": CONTROL % words,
            "system/fvSchemes": SCHEMES,
            "system/fvSolution": SOLUTION,
            "constant/dynamicMeshDict": DYNAMIC % words,
        }.items():
            kind, name = place.split("/")
            (folder / place).write_text(header("dictionary", name, kind) + text)
        conditions = "".join(f"{name} {{ {self.condition_of(name, motion.slips)} }}\n" for name in self.mesh.names)
        (folder / "0").mkdir()
        (folder / "0" / "pointDisplacement").write_text(
            header("pointVectorField", "pointDisplacement", "0")
            + "dimensions [0 1 0 0 0 0 0];\ninternalField uniform (0 0 0);\n"
            + f"boundaryField\n{{\n{conditions}}}\n"
        )
        data = folder / "constant" / "boundaryData" / self.moving
        for time, share in ((0, 0.0), (last, 1.0)):
            (data / str(time)).mkdir(parents=True)
            (data / str(time) / "pointDisplacement").write_text(listed(share * self.displacement))
        (data / "points").write_text(listed(self.mesh.points[self.nodes]))

    def condition_of(self, patch: str, slips: bool) -> str:
        """Return the condition of a patch on the displacement."""
        if patch == self.moving:
            return GIVEN
        if patch in self.box:
            return SLIP if slips else FIXED
        kind = kind_of(patch, True)
        return f"type {kind};" if kind == "symmetryPlane" else FIXED


def listed(values: FloatArray) -> str:
    """Return vectors (K, 3) as OpenFOAM reads them."""
    rows = "".join("({:.17g} {:.17g} {:.17g})\n".format(*row) for row in values)
    return f"{len(values)}\n(\n{rows})\n"
