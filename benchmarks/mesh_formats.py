"""Seconds and peak memory of reading and writing a large mesh of tetrahedra: ``python -m benchmarks.mesh_formats``."""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from sdm_deflect.base.arrays import IntArray
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh

SUFFIXES = {"su2": ".su2", "cgns": ".cgns", "ugrid": ".b8.ugrid"}


def box_of_tets(cells: int) -> Mesh:
    """The unit cube of cells^3 boxes of six tetrahedra each, its six sides a patch each."""
    n = cells + 1
    points = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    points += 0.2 / n * np.sin(np.arange(points.size)).reshape(-1, 3)
    index = np.arange(n**3).reshape(n, n, n)
    corner = index[:-1, :-1, :-1].ravel()
    steps = np.array([n * n, n, 1])
    tets = np.empty((6, len(corner), 4), dtype=np.intp)
    for out, order in zip(tets, itertools.permutations(range(3)), strict=True):
        path = np.cumsum([0, *steps[list(order)]])
        odd = np.linalg.det(np.eye(3)[list(order)]) < 0.0
        out[:] = corner[:, None] + path[[0, 2, 1, 3] if odd else [0, 1, 2, 3]]
    sides = {f"side {axis}{end}": np.take(index, end, axis) for axis in range(3) for end in (0, -1)}
    patches = tuple(Patch(name, (Cells("triangle", triangles(side)),)) for name, side in sides.items())
    return Mesh(points, (Cells("tetra", tets.reshape(-1, 4)),), patches)


def measure(cells: int, folder: Path) -> None:
    """Print the seconds, alone and over those of a copy of the file, and the peak memory of each operation (Linux).

    Each is a process of its own, and copies the file thrice; the peak is told over the size of the arrays, too.
    """
    mesh = box_of_tets(cells)
    size = (mesh.points.nbytes + mesh.cells[0].nodes.nbytes) / 1e6  # type: ignore[union-attr]
    print(f"{len(mesh.points)} points, {len(mesh.cells[0])} tetrahedra, arrays of {size:.0f} MB")
    context = multiprocessing.get_context("spawn")
    for name, what in itertools.product(SUFFIXES, ("write", "read", "rewrite")):
        process = context.Process(target=_operate, args=(name, what, cells, folder, size))
        process.start()
        process.join()


def _operate(name: str, what: str, cells: int, folder: Path, size: float) -> None:
    known = FORMATS[name]
    path, copy = (folder / f"{stem}{SUFFIXES[name]}" for stem in ("mesh", "copy"))
    mesh = box_of_tets(cells) if what == "write" else None
    points = box_of_tets(cells).points * 1.5 if what == "rewrite" else None
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak starts from the memory in use
    begin = time.perf_counter()
    if mesh is not None:
        known.write(mesh, path)
    elif points is not None:
        known.rewrite(path, points, copy)
    else:
        mesh = known.read(path)
    seconds = time.perf_counter() - begin
    status = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    peak = next(1024 * int(line.split()[1]) for line in status if line.startswith("VmHWM"))
    print(
        f"{name:5} {what:8} {seconds:5.1f} s, {seconds / _copying(path):5.1f} copies, peak {peak / 1e6:4.0f} MB, "
        f"{peak / 1e6 / size:3.1f} arrays, file {path.stat().st_size / 1e6:4.0f} MB"
    )


def _copying(path: Path) -> float:
    """Seconds of a copy of a file, the least of three."""
    spent = []
    for _ in range(3):
        begin = time.perf_counter()
        shutil.copyfile(path, path.with_name("plain"))
        spent.append(time.perf_counter() - begin)
    return min(spent)


def triangles(side: IntArray) -> IntArray:
    """Split the squares of a side (n, n) along the diagonal from their lowest corner, as the tetrahedra do."""
    a, b, c, d = side[:-1, :-1].ravel(), side[1:, :-1].ravel(), side[1:, 1:].ravel(), side[:-1, 1:].ravel()
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=94, help="boxes along each edge; 94 are 5 million tetrahedra")
    with tempfile.TemporaryDirectory() as scratch:
        measure(parser.parse_args().cells, Path(scratch))
