"""A coupled loop of MPhys around a surface map: a wing that bends under loads which its mesh gives.

    pip install git+https://github.com/OpenMDAO/mphys mpi4py petsc4py
    python -m benchmarks.coupling
    mpirun -n 4 python -m benchmarks.coupling

`pip` compiles PETSc for petsc4py, which can fail. Debian's packages python3-mpi4py and python3-petsc4py are compiled,
for NumPy 1. Without both `mpirun` starts copies that do not share the work, and each says `1 processes`.

MPhys' `GeoDisp` adds displacements to the shape, `SurfaceWarp` makes the mesh, a pseudo flow reads loads from the nodes
beside the wall, and a structure of two bending modes turns loads into displacements. The shape has one variable, the
structure another. Total derivatives of the lift are compared with differences. Every process holds a share of the nodes
and of the surface. The coordinates' digest must be the same for any number of processes.
"""

import hashlib
import lzma
import tempfile
import time
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import openmdao.api as om
from mphys.core import MPhysVariables
from mphys.scenarios.geo_disp import GeoDisp
from scipy.spatial import cKDTree

import sdm_deflect as sdm
from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.openmdao import SurfaceWarp

SURFACE = MPhysVariables.Aerodynamics.Surface
# Step of the differences, a share of the variables.
STEP = 1e-4
# Load of a node at x = z = 0: it bends the tip by some tenths of a chord.
LOAD = 5e-4


class Shared(om.ExplicitComponent):
    """A component that holds a share of the rows of arrays, and of which each process sees all rows."""

    def gathered(self, own: FloatArray) -> FloatArray:
        """Join the rows (n, 3) of all processes."""
        rows = np.asarray(own).reshape(-1, 3)
        return np.asarray(np.concatenate(self.comm.allgather(rows)) if self.comm.size > 1 else rows)

    def share(self, whole: FloatArray) -> FloatArray:
        """Return this process's rows, flat."""
        return np.asarray(np.array_split(whole, self.comm.size)[self.comm.rank].ravel())

    def total(self, value: Any) -> Any:
        """Sum over the processes."""
        return self.comm.allreduce(value) if self.comm.size > 1 else value


class Shape(Shared):
    """A wing that bulges: one variable of a shape."""

    def initialize(self) -> None:
        self.options.declare("start")
        self.options.declare("direction")

    def setup(self) -> None:
        self.add_input("bulge", 0.0)
        self.add_output(SURFACE.COORDINATES_INITIAL, self.share(self.options["start"]), distributed=True)

    def compute(self, inputs: Any, outputs: Any) -> None:
        places = self.options["start"] + inputs["bulge"][0] * self.options["direction"]
        outputs[SURFACE.COORDINATES_INITIAL] = self.share(places)

    def compute_jacvec_product(self, inputs: Any, d_inputs: Any, d_outputs: Any, mode: str) -> None:
        own, name = self.share(self.options["direction"]), SURFACE.COORDINATES_INITIAL
        if mode == "fwd":
            d_outputs[name] += own * d_inputs["bulge"][0]
        else:
            d_inputs["bulge"] += self.total(float(own @ d_outputs[name]))


class Flow(Shared):
    """A pseudo flow: the load on a node of the surface is a smooth function of the place of the node beside it."""

    def initialize(self) -> None:
        self.options.declare("beside")

    def setup(self) -> None:
        count = len(np.array_split(self.options["beside"], self.comm.size)[self.comm.rank])
        self.add_input("aero_vol_coords", shape_by_conn=True, distributed=True, tags=["mphys_coupling"])
        self.add_output(SURFACE.LOADS, np.zeros(3 * count), distributed=True, tags=["mphys_coupling"])
        self.add_output("lift", 0.0)

    def loads(self, inputs: Any) -> tuple[FloatArray, FloatArray]:
        """Return the vertical loads (K,) and their derivatives (K, 3) by the places beside."""
        x, _, z = self.gathered(inputs["aero_vol_coords"])[self.options["beside"]].T
        loads = LOAD * (1.0 - 1.5 * z) * np.exp(-x)
        return loads, np.column_stack([-loads, 0.0 * x, -1.5 * LOAD * np.exp(-x)])

    def compute(self, inputs: Any, outputs: Any) -> None:
        loads, _ = self.loads(inputs)
        outputs[SURFACE.LOADS] = self.share(np.outer(loads, [0.0, 0.0, 1.0]))
        outputs["lift"] = loads.sum()

    def compute_jacvec_product(self, inputs: Any, d_inputs: Any, d_outputs: Any, mode: str) -> None:
        if "aero_vol_coords" not in d_inputs:
            return
        (_, by_place), beside = self.loads(inputs), self.options["beside"]
        if mode == "fwd":
            rates = np.sum(by_place * self.gathered(d_inputs["aero_vol_coords"])[beside], axis=1)
            if SURFACE.LOADS in d_outputs:
                d_outputs[SURFACE.LOADS] += self.share(np.outer(rates, [0.0, 0.0, 1.0]))
            if "lift" in d_outputs:
                d_outputs["lift"] += rates.sum()
            return
        weights = np.zeros(len(beside))
        if SURFACE.LOADS in d_outputs:
            weights += self.gathered(d_outputs[SURFACE.LOADS])[:, 2]
        if "lift" in d_outputs:
            weights += d_outputs["lift"][0]
        out = np.zeros_like(self.gathered(inputs["aero_vol_coords"]))
        np.add.at(out, beside, weights[:, None] * by_place)
        d_inputs["aero_vol_coords"] += self.share(out)


class Structure(Shared):
    """Two bending modes (2, K) with a stiffness each: loads to displacements."""

    def initialize(self) -> None:
        self.options.declare("modes")

    def setup(self) -> None:
        count = len(np.array_split(self.options["modes"].T, self.comm.size)[self.comm.rank])
        self.add_input("softness", 1.0)
        self.add_input(SURFACE.LOADS, shape_by_conn=True, distributed=True, tags=["mphys_coupling"])
        self.add_output(SURFACE.DISPLACEMENTS, np.zeros(3 * count), distributed=True, tags=["mphys_coupling"])

    def bent(self, vertical: FloatArray, softness: float) -> FloatArray:
        """Return vertical displacements (K,) under vertical loads (K,); the matrix is symmetric."""
        modes = self.options["modes"]
        return np.asarray(0.5 * softness * (modes @ vertical) @ modes)

    def compute(self, inputs: Any, outputs: Any) -> None:
        moved = self.bent(self.gathered(inputs[SURFACE.LOADS])[:, 2], inputs["softness"][0])
        outputs[SURFACE.DISPLACEMENTS] = self.share(np.outer(moved, [0.0, 0.0, 1.0]))

    def compute_jacvec_product(self, inputs: Any, d_inputs: Any, d_outputs: Any, mode: str) -> None:
        loads, softness = self.gathered(inputs[SURFACE.LOADS])[:, 2], inputs["softness"][0]
        if mode == "fwd":
            rates = np.zeros(len(loads))
            if SURFACE.LOADS in d_inputs:
                rates += self.bent(self.gathered(d_inputs[SURFACE.LOADS])[:, 2], softness)
            if "softness" in d_inputs:
                rates += self.bent(loads, d_inputs["softness"][0])
            d_outputs[SURFACE.DISPLACEMENTS] += self.share(np.outer(rates, [0.0, 0.0, 1.0]))
            return
        seeds = self.gathered(d_outputs[SURFACE.DISPLACEMENTS])[:, 2]
        if SURFACE.LOADS in d_inputs:
            d_inputs[SURFACE.LOADS] += self.share(np.outer(self.bent(seeds, softness), [0.0, 0.0, 1.0]))
        if "softness" in d_inputs:
            d_inputs["softness"] += seeds @ self.bent(loads, 1.0)


def coupled(comm: Any) -> tuple[om.Problem, Any]:
    """Return the problem, and the map."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "naca.su2"
        path.write_bytes(lzma.decompress(files("sdm_deflect.cases").joinpath("naca.su2.xz").read_bytes()))
        mesh = sdm.read(path)
    warp = sdm.surface_map(mesh, ["wing", "flap"], largest=0.4, slide="symmetry:plane")
    start, span = warp.start, warp.start[:, 1].max()
    y = start[:, 1] / span
    first, second = y**2 * (3.0 - y) / 2.0, y**2 * (6.0 - 4.0 * y + y**2) / 3.0
    others = np.setdiff1d(np.arange(len(mesh.points)), warp.nodes)
    beside = others[cKDTree(mesh.points[others]).query(start)[1]]
    points, surface = (np.array_split(rows, comm.size)[comm.rank] for rows in (mesh.points, start))
    problem = om.Problem(reports=False, comm=comm)
    bulge = np.outer(np.sin(3.0 * start[:, 0]) * y**2, [0.0, 0.0, 0.1])
    problem.model.add_subsystem("shape", Shape(start=start, direction=bulge), promotes=["*"])
    group = problem.model.add_subsystem("coupling", om.Group(), promotes=["*"])
    group.add_subsystem("geo_disp", GeoDisp(number_of_nodes=len(surface)), promotes=["*"])
    warper = SurfaceWarp(map=warp, points=points, start=surface, surface=SURFACE.COORDINATES, check=False)
    group.add_subsystem("warp", warper, promotes=["*"])
    group.add_subsystem("flow", Flow(beside=beside), promotes=["*"])
    group.add_subsystem("structure", Structure(modes=np.stack([first, second - first])), promotes=["*"])
    group.nonlinear_solver = om.NonlinearBlockGS(maxiter=40, rtol=1e-13, atol=1e-14, iprint=-1)
    group.linear_solver = om.LinearBlockGS(maxiter=40, rtol=1e-13, atol=1e-15, iprint=-1)
    problem.setup(mode="rev")
    problem.set_val("bulge", 0.5)
    return problem, warp


def main() -> None:
    """Run the loop, and print what it gives."""
    from openmdao.utils.mpi import MPI, FakeComm

    comm = MPI.COMM_WORLD if MPI else FakeComm()
    problem, warp = coupled(comm)
    begin = time.perf_counter()
    problem.run_model()
    ran = time.perf_counter() - begin
    points = problem.get_val("aero_vol_coords", get_remote=True).reshape(-1, 3)
    surface = problem.get_val(SURFACE.COORDINATES, get_remote=True).reshape(-1, 3)
    tip = float(problem.get_val(SURFACE.DISPLACEMENTS, get_remote=True).max())
    begin = time.perf_counter()
    totals = problem.compute_totals(["lift"], ["bulge", "softness"], return_format="flat_dict")
    derived = time.perf_counter() - begin
    iterations = problem.model.coupling.nonlinear_solver._iter_count
    lines = [
        f"{comm.size} processes: {iterations} iterations, {ran:.2f} s; totals {derived:.2f} s; tip moves by {tip:.3f}",
        f"surface off by {np.abs(points[warp.nodes] - surface).max():.1e}",
        f"coordinates {hashlib.sha256(points.tobytes()).hexdigest()[:16]}",
    ]
    for name in ("bulge", "softness"):
        at, ends = float(problem.get_val(name)[0]), []
        for sign in (-1.0, 1.0):
            problem.set_val(name, at + sign * STEP * at)
            problem.run_model()
            ends.append(float(problem.get_val("lift")[0]))
        problem.set_val(name, at)
        total, difference = float(totals["lift", name].ravel()[0]), (ends[1] - ends[0]) / (2.0 * STEP * at)
        lines.append(
            f"d lift / d {name} = {total:.10e}, differences {difference:.10e}: {abs(total / difference - 1.0):.1e}"
        )
    if comm.rank == 0:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
