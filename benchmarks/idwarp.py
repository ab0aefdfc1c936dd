"""Cells of a wing tip after IDWarp and after this package: ``python -m benchmarks.idwarp PYTHON``.

PYTHON is an interpreter that imports IDWarp, which is not on PyPI. On Debian 12 its revision a86e9d9 was built with
the packages gfortran, make, petsc-dev, libopenmpi-dev, python3-petsc4py, python3-mpi4py and python3-dev. Debian's CGNS
lacks the Fortran functions, so CGNS 4 (d7bada4) came from its source, by CMake with ``-DCGNS_ENABLE_FORTRAN=ON
-DCGNS_ENABLE_64BIT=OFF -DCGNS_ENABLE_HDF5=OFF``. IDWarp's ``config.LINUX_GFORTRAN.mk`` names it, ``PETSC_DIR`` is that
of Debian's real PETSc, and ``make`` does the rest. So it reads ADF, and of boundary conditions those with an
ElementRange alone; the mesh is written so here. ``cgnsconvert`` is Debian's package cgns-convert.

Both get the nodes of wing and flap where `sdm_deflect.deflect` puts them. IDWarp has its usual options: aExp 3, bExp 5,
LdefFact 1, alpha .25, rotations. Quality is the scaled Jacobian of the cells that `deflect` changes.
"""

import os
import pickle
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import h5py
import numpy as np
from rich.console import Console
from rich.table import Table

import sdm_deflect
from benchmarks.layers import Example, examples
from benchmarks.measure import FloatArray
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import quality_and_inverted
from studies.machine import machine

# Patches whose nodes IDWarp gets; the others stay, or lie on its plane of symmetry.
WALLS = ("wing", "flap")
# Run by the other interpreter: the warped coordinates of every shape, in the order of the undeflected points.
WARP = """
import pickle, sys, time
import numpy as np
from idwarp import USMesh
from mpi4py import MPI
from scipy.spatial import cKDTree
with open("given.pkl", "rb") as file:
    points, nodes, faces, sizes, shapes = pickle.load(file)
plane = [[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]
mesh = USMesh(comm=MPI.COMM_WORLD, options={"gridFile": "mesh.cgns", "symmetryPlanes": plane})
mesh.setSurfaceDefinition(points[nodes], faces.astype("intc"), sizes.astype("intc"))
rows = cKDTree(points).query(mesh.getSurfaceCoordinates())[1]
order = cKDTree(points).query(np.reshape(mesh.getCommonGrid(), (-1, 3)))[1]
found = []
for shape in shapes:
    start, moved = time.perf_counter(), points.copy()
    mesh.setSurfaceCoordinates(shape[rows])
    mesh.warpMesh()
    moved[order] = np.reshape(mesh.getCommonGrid(), (-1, 3))
    found.append((moved, time.perf_counter() - start))
with open("found.pkl", "wb") as file:
    pickle.dump(found, file)
"""


def warped(python: str, mesh: Mesh, shapes: list[FloatArray], folder: Path) -> list[tuple[FloatArray, float]]:
    """Return the points (N, 3) that IDWarp gives for each shape, and its seconds."""
    _write(mesh, folder)
    blocks = [block.nodes for name in WALLS for block in mesh.patch(name).faces]
    nodes = mesh.on(*WALLS)
    faces = np.concatenate([np.searchsorted(nodes, block).ravel() for block in blocks])
    sizes = np.concatenate([np.full(len(block), block.shape[1]) for block in blocks])
    (folder / "given.pkl").write_bytes(pickle.dumps((mesh.points, nodes, faces, sizes, shapes)))
    allowed = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    subprocess.run([python, "-c", WARP], cwd=folder, env=os.environ | allowed, stdout=subprocess.DEVNULL, check=True)
    found: list[tuple[FloatArray, float]] = pickle.loads((folder / "found.pkl").read_bytes())
    return found


def _write(mesh: Mesh, folder: Path) -> None:
    """Write ``mesh.cgns`` as IDWarp reads it."""
    path = folder / "hdf5.cgns"
    FORMATS["cgns"].write(mesh, path)
    with h5py.File(path, "r+") as file:
        for condition in file["Base/Zone/ZoneBC"].values():
            if "PointRange" in condition:
                condition.move("PointRange", "ElementRange")
                condition["ElementRange"].attrs["name"] = np.bytes_(b"ElementRange".ljust(33, b"\0"))
                del condition["GridLocation"]
    subprocess.run(["cgnsconvert", "-a", path, folder / "mesh.cgns"], stdout=subprocess.DEVNULL, check=True)


def compared(python: str, example: Example, folder: Path) -> Table:
    """Return a table of cells and seconds at each angle."""
    mesh = example.mesh()
    shapes = [_deflected(mesh, example, angle, repair="off") for angle in example.angles]
    warp = sdm_deflect.surface_map(mesh, WALLS, largest=0.12, slide="symmetry:plane")
    table = Table("degrees", "moved by", "least", "1 %", "mean", "inverted", "s", title=example.title)
    for angle, shape, (theirs, spent) in zip(example.angles, shapes, warped(python, mesh, shapes, folder), strict=True):
        moved = (shape != mesh.points).any(axis=1)
        rows = [moved[block.nodes].any(axis=1) for block in mesh.cells if isinstance(block, Cells)]
        table.add_row(f"{angle:+g}", "nobody", *_figures(mesh, mesh.points, rows), "")
        table.add_row("", "IDWarp, one process", *_figures(mesh, theirs, rows), f"{spent:.2f}")
        movers = {
            "surface map": partial(warp.at, shape[warp.nodes]),
            "deflect, without repair": partial(_deflected, mesh, example, angle, repair="off"),
            "deflect": partial(_deflected, mesh, example, angle, repair="auto"),
        }
        for words, move in movers.items():
            start = perf_counter()
            points = move()
            table.add_row("", words, *_figures(mesh, points, rows), f"{perf_counter() - start:.2f}")
    return table


def _deflected(mesh: Mesh, example: Example, angle: float, **settings: Any) -> FloatArray:
    return sdm_deflect.deflect(mesh, angle=angle, **example.settings, **settings).points


def _figures(mesh: Mesh, points: FloatArray, rows: list[Any]) -> tuple[str, ...]:
    found = [quality_and_inverted(points, block) for block in mesh.cells]
    quality = np.concatenate([own[some] for (own, _), some in zip(found, rows, strict=True)])
    figures = (quality.min(), np.percentile(quality, 1.0), quality.mean())
    return *(f"{value:.3f}" for value in figures), f"{sum(int(one.sum()) for _, one in found)}"


def main(python: str) -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as folder:
        tip = next(one for one in examples(Path(folder)) if one.key == "tip")
        console = Console(width=120)
        console.print(machine())
        console.print(compared(python, tip, Path(folder)))


if __name__ == "__main__":
    main(sys.argv[1])
