"""Ours beside other interpolations of the same sites: ``python -m benchmarks.peers_interpolation > peers.md``.

All take the paper's sites of the aileron, and some of the tail's, as centres of a thin plate spline with a linear
polynomial, and are evaluated at the same points. Each runs in a process of its own, on one thread, and seconds are the
processor's: of the fit, of the evaluation. What is not installed is named with the reason. Peers:
``pip install treverhines-rbf ferreus-rbf``, in an environment of their own.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np

from benchmarks.measure import FloatArray
from benchmarks.memory import UNIT
from benchmarks.results import machine
from benchmarks.workloads import Workload, aileron, points_around, tail

Evaluated = Callable[[FloatArray], FloatArray]
Fit = Callable[[FloatArray, FloatArray], Evaluated]
"""From sites (N, 3) and values (N, 3) to a function of points (P, 3)."""
THREADS = ("OMP", "OPENBLAS", "NUMBA", "RAYON", "MKL")
OURS, TOLERANCE = "ours, all sites", 8e-5
"""The paper's tolerance (m) for the greedy choice of centres."""
POINTS = 80_261
"""The paper's points in the hexahedron of the tail."""
SITES = 4_000
ABSENT = {
    "PyGeM": (
        "not on PyPI: the name `pygem` there is a model of glaciers; its README says to clone the repository. Its "
        "`rbf.py` solves for all sites as centres by numpy.linalg.solve, the dense system that SciPy's row stands for"
    ),
    "IDWarp": "not on PyPI; built from Fortran with MPI and PETSc",
    "SU2": "among neither PyPI's nor Debian's packages; built from source",
    "RBF Morph": "sold with Ansys",
}


def ours(sites: FloatArray, values: FloatArray) -> Evaluated:
    """Fit with all sites as centres."""
    from sdm_deflect.deform.rbf.interpolant import fit
    from sdm_deflect.deform.rbf.kernels import ThinPlateSpline

    return fit(ThinPlateSpline(), sites, values)


def greedy(sites: FloatArray, values: FloatArray) -> Evaluated:
    """Choose centres greedily, common ones for all directions, to the paper's tolerance."""
    from sdm_deflect.deform.base.arrays import farthest
    from sdm_deflect.deform.rbf.greedy import GreedyOptions, adapt
    from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
    from sdm_deflect.deform.rbf.problem import DataSites

    options = GreedyOptions(n_add=1, tol_add=TOLERANCE, tol_stop=TOLERANCE)
    return adapt(DataSites(sites, values), ThinPlateSpline(), farthest(sites, 10), options).interpolant


def scipy(sites: FloatArray, values: FloatArray) -> Evaluated:
    """SciPy's RBFInterpolator, dense."""
    found: Evaluated = import_module("scipy.interpolate").RBFInterpolator(
        sites, values, kernel="thin_plate_spline", degree=1
    )
    return found


def treverhines(sites: FloatArray, values: FloatArray) -> Evaluated:
    """RBFInterpolant of treverhines-rbf, dense."""
    found: Evaluated = import_module("rbf.interpolate").RBFInterpolant(sites, values, phi="phs2", order=1)
    return found


def ferreus(sites: FloatArray, values: FloatArray) -> Evaluated:
    """RBFInterpolator of ferreus-rbf: domain decomposition and fast multipoles where there are many sites."""
    module = import_module("ferreus_rbf")
    config = module.interpolant_config
    accuracy = config.FittingAccuracy(1e-12, config.FittingAccuracyType.Absolute)
    settings = config.InterpolantSettings(
        config.RBFKernelType.ThinPlateSpline, drift=config.Drift.Linear, fitting_accuracy=accuracy
    )
    found = module.RBFInterpolator(sites, values, settings)
    return lambda points: np.asarray(found.evaluate(points))


METHODS: dict[str, tuple[Fit, str]] = {
    OURS: (ours, "sdm-deflect"),
    "ours, greedy": (greedy, "sdm-deflect"),
    "SciPy": (scipy, "scipy"),
    "treverhines-rbf": (treverhines, "treverhines-rbf"),
    "ferreus-rbf": (ferreus, "ferreus-rbf"),
}
"""The fit, and the package that must be installed."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """Processor seconds of the fit and of the evaluation, peak of the process in bytes, values at sites and points."""

    fit: float
    evaluation: float
    peak: float
    at_sites: FloatArray
    at_points: FloatArray


def carried_out(name: str, file: Path, folder: Path) -> Measured:
    """Run a method on the arrays of a file, in a process of its own on one thread."""
    one = os.environ | {f"{prefix}_NUM_THREADS": "1" for prefix in THREADS}
    out = folder / "result.npz"
    command = [sys.executable, "-m", "benchmarks.peers_interpolation", "--one", name, str(file), str(out)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=one)
    found = json.loads(done.stdout.splitlines()[-1])
    with np.load(out, allow_pickle=False) as stored:
        return Measured(**found, at_sites=stored["sites"], at_points=stored["points"])


def one(name: str, file: Path, out: Path) -> dict[str, float]:
    """Fit and evaluate here; write the values, return seconds and peak."""
    fit = METHODS[name][0]
    with np.load(file, allow_pickle=False) as stored:
        sites, values, points = (stored[key] for key in ("sites", "values", "points"))
    fit(sites[:200], values[:200])(points[:200])  # loads libraries and machine code
    begin = process_time()
    found = fit(sites, values)
    middle = process_time()
    at_points = found(points)
    end = process_time()
    peak = float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * UNIT)
    np.savez(out, sites=np.asarray(found(sites)), points=np.asarray(at_points))
    return {"fit": middle - begin, "evaluation": end - middle, "peak": peak}


def installed() -> tuple[dict[str, str], dict[str, str]]:
    """Return the versions of the methods that can run here, and why the others cannot."""
    found, missing = {}, dict(ABSENT)
    for name, (_, package) in METHODS.items():
        try:
            found[name] = version(package)
        except PackageNotFoundError:
            missing[name] = f"`{package}` is not installed"
    return found, missing


def table(work: Workload, names: list[str], points: int, rounds: int) -> Iterator[str]:
    """Yield the lines of a case's table; all methods take turns."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "given.npz")
        values = work.sites.values
        np.savez(file, sites=work.sites.points, values=values, points=points_around(work.region, points))
        turns = [{name: carried_out(name, file, Path(folder)) for name in names} for _ in range(rounds)]
    yield f"## {work.name.capitalize()}: {len(values):,} sites, {points:,} points\n"
    yield "| | fit | evaluation | peak memory, MB | off at a site, m | from ours at a point, m |"
    yield f"{'| --- ' * 6}|"
    for name in names:
        ratios = [median(getattr(t[name], part) / getattr(t[OURS], part) for t in turns) for part in FIGURES]
        last, reference = turns[-1][name], turns[-1][OURS]
        off = np.abs(last.at_sites - values).max()
        apart = np.abs(last.at_points - reference.at_points).max()
        times = " | ".join(f"{ratio:.2f}" for ratio in ratios)
        yield f"| {name} | {times} | {last.peak / 1e6:.0f} | {off:.0e} | {apart:.0e} |"
    lighter = [name for name in names if turns[-1][name].peak < 0.95 * turns[-1][OURS].peak]
    yield f"\nAt least 5 % less memory than {OURS}: {', '.join(lighter) or 'none'}."
    seconds = f"{turns[-1][OURS].fit:.2f} and {turns[-1][OURS].evaluation:.2f} s"
    yield f"Fit and evaluation are times those of {OURS}, which take {seconds}.\n"


FIGURES = ("fit", "evaluation")


def page(points: int, rounds: int, sites: int) -> Iterator[str]:
    """Yield the lines of the page."""
    found, missing = installed()
    versions = ", ".join(f"{name} {number}" for name, number in found.items() if "ours" not in name)
    yield "# Interpolations side by side\n"
    yield f"Made by `python -m benchmarks.peers_interpolation`. {machine()}; {versions}.\n"
    yield "Thin plate splines with a linear polynomial, the same sites, values and points. One thread each, processor"
    yield f"seconds, medians of {rounds} turns; each in a process of its own, whose peak includes Python and libraries."
    yield f"'Greedy' chooses some of the sites as centres, to the paper's tolerance of {TOLERANCE:g} m at sites, not"
    yield "between them; all others take all, which is what peers are compared by."
    yield "ferreus-rbf decomposes and approximates where sites are many; a deflection has thousands.\n"
    for work in (aileron(), tail(sites)):
        yield from table(work, list(found), points, rounds)
    yield "## Not run here\n"
    yield from (f"- {name}: {reason}." for name, reason in missing.items())
    yield "\nMotions of whole meshes, ours beside OpenFOAM's and gmsh's, are in `repair_peers.md`."


def main(words: list[str] | None = None) -> Any:
    """Print the page, or carry out one method."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers_interpolation", description=__doc__)
    parser.add_argument("--one", nargs=3, help="a method, the file of its arrays, the file of its values")
    parser.add_argument("--points", type=int, default=POINTS)
    parser.add_argument("--sites", type=int, default=SITES, help="of the tail")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args(words)
    if given.one:
        name, file, out = given.one
        print(json.dumps(one(name, Path(file), Path(out))))
        return
    print("\n".join(page(given.points, given.rounds, given.sites)))


if __name__ == "__main__":
    main()
