"""Cells after a motion by this package, by OpenFOAM and by one dense system: ``python -m benchmarks.peers_motion``.

All get the same boundary: nodes of patches go where this package puts them. OpenFOAM's `moveDynamicMesh` moves the
whole mesh, by Laplace's equation or by SBRStress, with a diffusivity of the squared inverse distance; nodes slip on
symmetry planes. A surface that turns as a whole goes by `rigidBodyMotion` as well: nodes turn with it up to an inner
distance, and less and less up to an outer one. Its joint has a speed and no force, so that it turns by the angle in one
step. The dense system has every boundary node as a centre, and SciPy evaluates it at every node. Quality is the mean
ratio of the cells that this package may change; inverted cells are counted in the whole mesh. Processor seconds are of
one run: OpenFOAM's with its start, ours with plan, repair and checks.

OpenFOAM is Debian's package openfoam.
"""

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.interpolate import RBFInterpolator

import sdm_deflect
from benchmarks.commands import make_meshes
from benchmarks.measure import FloatArray, processor_seconds
from sdm_deflect.base.arrays import IntArray
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.geometry.datum import hinge_line
from sdm_deflect.meshing.formats.openfoam import control, kind_of, write_files
from sdm_deflect.meshing.formats.openfoam_files import open_foam, vectors
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import quality_and_inverted
from studies.machine import machine

# Most centres of the dense system: 0.8 GB.
MOST = 10_000
LAPLACIAN, SBR, RIGID = "displacementLaplacian", "displacementSBRStress", "rigidBodyMotion"
# Outer distances (m) of rigidBodyMotion: the gap at the hinge, and more.
OUTER = (0.005, 0.02, 0.05, 0.1)
SCHEMES = "".join(
    f"{name}Schemes {{ default {scheme}; }}\n"
    for name, scheme in {
        "ddt": "Euler", "grad": "Gauss linear", "div": "Gauss linear", "laplacian": "Gauss linear corrected",
        "interpolation": "linear", "snGrad": "corrected",
    }.items()
)  # fmt: skip
SOLUTION = 'solvers { "cellDisplacement.*" { solver GAMG; smoother GaussSeidel; tolerance 1e-10; relTol 0; } }\n'
GIVEN = "type timeVaryingMappedFixedValue; mapMethod nearest; setAverage false; value uniform (0 0 0);"
FIXED = "type fixedValue; value uniform (0 0 0);"
# Places of OpenFOAM's programs, as Debian has them.
ENVIRONMENT = {"WM_PROJECT_DIR": "/usr/share/openfoam"}


@dataclass(frozen=True, slots=True)
class Work:
    """A surface that turns: its mesh, patch, hinge, angle, and further settings of `sdm_deflect.deflect`.

    The source of the mesh is a file of `make_meshes`, or a case of the SDM.
    """

    title: str
    source: str
    surface: str
    hinge: tuple[tuple[float, ...], ...]
    angle: float
    settings: dict[str, Any] = field(default_factory=dict)

    def mesh(self, folder: Path) -> Mesh:
        """Return the mesh."""
        if self.source.endswith(".su2"):
            return FORMATS["su2"].read(folder / self.source)
        from sdm_deflect.cases.aircraft.pipeline import mesh_of_case  # the CAD kernel

        return mesh_of_case(case_named(self.source), Stopwatch())[0]

    def deflected(self, mesh: Mesh, repair: Any) -> FloatArray:
        """Return the points (N, 3) to which this package moves the mesh."""
        result = sdm_deflect.deflect(mesh, self.surface, self.hinge, self.angle, repair=repair, **self.settings)
        return result.points


FREE = tuple(map(tuple, hinge_line(case_named("aileron-free").fighter, "aileron_left").tolist()))
# One motion that is hard for the cells, at the closed ends of a flap, one that is easy, and two of a rigid surface.
WORKS = (
    Work(
        "half wing, flap 25 degrees", "naca.su2", "flap", ((0.7, 0.6, 0.0), (0.7, 1.4, 0.0)), 25.0,
        {"motion": "blended", "fixed": "wing", "slide": "symmetry:plane"},
    ),
    Work(
        "fighter, aileron 40 degrees", "fighter.su2", "aileron_left",
        ((0.69181, -0.3048, 0.0), (0.6767, -0.11627, 0.0)), 40.0, {"motion": "blended", "fixed": "wing_left"},
    ),
    Work("free aileron, -12 degrees", "aileron-free", "aileron_left", FREE, -12.0, {"fixed": "wing_left"}),
    Work("free aileron, -30 degrees", "aileron-free", "aileron_left", FREE, -30.0, {"fixed": "wing_left"}),
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Boundary:
    """A mesh of tetrahedra, and the displacements (B, 3) of its boundary nodes (B,)."""

    mesh: Mesh
    nodes: IntArray
    displacement: FloatArray

    def by_dense_system(self) -> FloatArray:
        """Return the points (N, 3) that one dense system gives, with every boundary node as a centre."""
        points = self.mesh.points
        found = RBFInterpolator(points[self.nodes], self.displacement, kernel="thin_plate_spline", degree=1)
        out: FloatArray = points + found(points)
        out[self.nodes] = points[self.nodes] + self.displacement
        return out

    def by_openfoam(self, solver: str, steps: int, folder: Path) -> FloatArray:
        """Return the points (N, 3) by `moveDynamicMesh` in equal steps; raises as `_moved`."""
        self._write(solver, steps, folder)
        return self._moved(solver, steps, folder)

    def by_rigid_body(self, work: Work, outer: float, folder: Path) -> FloatArray:
        """Return the points (N, 3) that turn with the surface up to a distance; raises as `_moved`."""
        ends = np.array(work.hinge)
        axis = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        body = (
            "type rigidBody; parent root; centreOfMass (0 0 0); mass 1; inertia (1 0 0 1 0 1);\n"
            f"transform (1 0 0 0 1 0 0 0 1) {_vector(ends[0])}; joint {{ type Ra; axis {_vector(axis)}; }}\n"
            f"patches ({work.surface}); innerDistance 0; outerDistance {outer};"
        )
        words = (
            "dynamicFvMesh dynamicMotionSolverFvMesh; motionSolverLibs (rigidBodyMeshMotion);\n"
            f"motionSolver {RIGID}; rho rhoInf; rhoInf 1;\n{RIGID}Coeffs\n{{\ntest true; nIter 1;\n"
            f"solver {{ type Newmark; }}\nbodies {{ {work.surface} {{ {body} }} }}\n"
            f"q (0); qDot ({np.radians(work.angle):.17g}); qDdot (0);\n}}\n"
        )
        held = "".join(f"{patch.name} {{ {FIXED} }}\n" for patch in self.mesh.patches if patch.name != work.surface)
        self._write_case(1, folder, words, f"{held}{work.surface} {{ type calculated; value uniform (0 0 0); }}\n")
        return self._moved(RIGID, 1, folder)

    def _moved(self, solver: str, steps: int, folder: Path) -> FloatArray:
        """Run `moveDynamicMesh`; return the points (N, 3).

        Raises RuntimeError with the program's last words if it fails, or if a node is not where it shall be.
        """
        done = subprocess.run(
            ["moveDynamicMesh"], cwd=folder, env=os.environ | ENVIRONMENT, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise RuntimeError(f"moveDynamicMesh: {(done.stderr or done.stdout).strip()[-200:]}")
        points = vectors(open_foam(folder / str(steps) / "polyMesh", "points")).values
        off = np.abs(points[self.nodes] - self.mesh.points[self.nodes] - self.displacement)
        moved = self.displacement.any(axis=1)
        if off[moved].max() > 1e-6 * np.abs(self.displacement).max():
            raise RuntimeError(f"{solver}: a node is {off[moved].max():g} from where it shall be")
        return points

    def _write(self, solver: str, steps: int, folder: Path) -> None:
        """Write the case with the displacements of its patches; patches that do not move are pinned or slip."""
        whole = np.zeros_like(self.mesh.points)
        whole[self.nodes] = self.displacement
        moving = [patch.name for patch in self.mesh.patches if whole[patch.nodes].any()]
        conditions = ""
        for patch in self.mesh.patches:
            kind = kind_of(patch.name, True)
            own = GIVEN if patch.name in moving else f"type {kind};" if kind == "symmetryPlane" else FIXED
            conditions += f"{patch.name} {{ {own} }}\n"
        words = (
            f"dynamicFvMesh dynamicMotionSolverFvMesh; motionSolverLibs (fvMotionSolvers);\nmotionSolver {solver};\n"
        )
        diffusivity = f"diffusivity quadratic inverseDistance ({' '.join(moving)});"
        self._write_case(steps, folder, f"{words}{solver}Coeffs {{ {diffusivity} }}\n", conditions)
        for name in moving:
            nodes = self.mesh.patch(name).nodes
            data = folder / "constant" / "boundaryData" / name
            for time, share in ((0, 0.0), (steps, 1.0)):
                (data / str(time)).mkdir(parents=True)
                (data / str(time) / "pointDisplacement").write_text(_listed(share * whole[nodes]), encoding="utf-8")
            (data / "points").write_text(_listed(self.mesh.points[nodes]), encoding="utf-8")

    def _write_case(self, steps: int, folder: Path, motion: str, conditions: str) -> None:
        """Write the mesh, how it moves, and the conditions at its patches."""
        FORMATS["openfoam"].write(self.mesh, folder)
        start = {"startFrom": "startTime", "startTime": 0, "stopAt": "endTime", "endTime": steps, "deltaT": 1}
        files = {
            "system/controlDict": control(
                **start, writeControl="timeStep", writeInterval=steps, writeFormat="binary", application=None
            ),
            "system/fvSchemes": SCHEMES,
            "system/fvSolution": SOLUTION,
            "constant/dynamicMeshDict": motion,
            "0/pointDisplacement": "dimensions [0 1 0 0 0 0 0];\ninternalField uniform (0 0 0);\n"
            f"boundaryField\n{{\n{conditions}}}\n",
        }
        write_files(folder, files)


def _vector(values: FloatArray) -> str:
    """Return a vector (3,) as OpenFOAM reads it."""
    return "({:.17g} {:.17g} {:.17g})".format(*values)


def _listed(values: FloatArray) -> str:
    """Return vectors (K, 3) as OpenFOAM reads them."""
    rows = "".join(f"{_vector(row)}\n" for row in values)
    return f"{len(values)}\n(\n{rows})\n"


def compared(work: Work, folder: Path) -> Table:
    """Move a mesh by all that are installed; return a table of cells and seconds."""
    mesh = work.mesh(folder)
    (block,) = mesh.cells
    if not isinstance(block, Cells):
        raise TypeError(f"{work.source} must have tetrahedra alone")
    ours = work.deflected(mesh, "off")  # compiles, too
    changed = (ours != mesh.points).any(axis=1)[block.nodes].any(axis=1)
    nodes = mesh.on(*mesh.names)
    boundary = Boundary(mesh, nodes, (ours - mesh.points)[nodes])
    table = Table("moved by", "least quality", "1 %", "mean", "inverted", "processor s", title=work.title)
    for name, move in _movers(work, boundary, folder).items():
        start = processor_seconds()
        points = move()
        spent = processor_seconds() - start
        quality, inverted = quality_and_inverted(points, block)
        part = quality[changed]
        figures = (part.min(), np.percentile(part, 1.0), part.mean())
        table.add_row(name, *(f"{value:.3f}" for value in figures), f"{inverted.sum()}", f"{spent:.2f}")
    return table


def _movers(work: Work, boundary: Boundary, folder: Path) -> dict[str, Callable[[], FloatArray]]:
    """Return the methods that move the mesh, by name."""
    mesh = boundary.mesh
    movers: dict[str, Callable[[], FloatArray]] = {"nobody": lambda: mesh.points}
    movers["this package, without repair"] = lambda: work.deflected(mesh, "off")
    movers["this package, with repair"] = lambda: work.deflected(mesh, "auto")
    if len(boundary.nodes) <= MOST:
        movers["dense system, SciPy"] = boundary.by_dense_system
    if shutil.which("moveDynamicMesh"):
        for solver, steps in ((LAPLACIAN, 1), (LAPLACIAN, 10), (SBR, 10)):
            name = f"OpenFOAM, {solver}, {steps} step{'s' * (steps > 1)}"
            case = folder / f"{_stem(work)}-{solver}-{steps}"
            movers[name] = lambda solver=solver, steps=steps, case=case: boundary.by_openfoam(solver, steps, case)  # type: ignore[misc]
        for outer in OUTER if work.hinge == FREE else ():
            case = folder / f"{_stem(work)}-{outer}"
            name = f"OpenFOAM, {RIGID}, up to {outer:g} m"
            movers[name] = lambda outer=outer, case=case: boundary.by_rigid_body(work, outer, case)  # type: ignore[misc]
    return movers


def _stem(work: Work) -> str:
    """Return the name of a case's folder: OpenFOAM takes no blanks."""
    return re.sub(r"\W+", "-", work.title)


def tables(folder: Path) -> Iterator[Table]:
    """Yield a table for each work."""
    make_meshes(folder, " ".join(work.source for work in WORKS if work.source.endswith(".su2")))
    for work in WORKS:
        yield compared(work, folder)


def main() -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as folder:
        console = Console(width=120)
        console.print(machine())
        for table in tables(Path(folder)):
            console.print(table)


if __name__ == "__main__":
    main()
