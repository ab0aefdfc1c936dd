"""One case, from parameters to validated result: geometry, mesh, deformation, validation, output."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np

from cases.cad import undeflected_cad
from cases.case import Case, Deflection
from cases.deflect import Deflected, Move, deflect
from cases.motion import wedge_motion
from cases.output import write_run
from cases.progress import Stopwatch
from cases.report.page import write_report
from cases.run import Run
from cases.validate import validate
from meshing.cache import MeshCache, cache_key, default_folder
from meshing.generate import MeshReport, generate
from meshing.mesh import TetMesh


def run_case(case: Case, watch: Stopwatch, folder: Path, cache: bool = True) -> Run:
    """Run a case and write its files into `folder`."""
    mesh, report = meshed(case, watch, cache)
    with watch.stage("deformation") as tell:
        results = tuple(deflect(mesh, case, one, mover(case, mesh, one), tell) for one in case.deflections)
        deflected = combined(mesh, results)
        whole = whole_mesh_seconds(mesh, results[0])
    with watch.stage("validation"):
        checks = validate(case, mesh, deflected, results)
    run = Run(case, mesh, report, deflected, results, whole, checks, watch.seconds)
    with watch.stage("report"):
        write_report(run, folder)
    write_run(run, folder)
    return run


def meshed(case: Case, watch: Stopwatch, cache: bool = True) -> tuple[TetMesh, MeshReport]:
    """Return the undeflected mesh of the case, from the cache if it is there and whole."""
    store, key = MeshCache(default_folder()), cache_key({"fighter": case.fighter, "mesh": case.mesh})
    found = store.load(key) if cache else None
    if found is not None:
        return found[0], MeshReport.from_note(found[1])
    with watch.stage("geometry"):
        model = undeflected_cad(case)
    with watch.stage("mesh") as tell:
        generated = generate(model, case.mesh, tell)
    if cache:
        store.store(key, generated.mesh, generated.report.note())
    return generated.mesh, generated.report


def mover(case: Case, mesh: TetMesh, deflection: Deflection) -> Move:
    """Return the surface motion of one control surface as a function of its angle."""
    kind = MOTIONS[deflection.surface.partition("_")[0]]
    return partial(kind, mesh, case, deflection.surface)


MOTIONS: dict[str, Callable[..., object]] = {"aileron": wedge_motion, "rudder": wedge_motion}


def combined(mesh: TetMesh, results: tuple[Deflected, ...]) -> TetMesh:
    """Return the mesh with every control surface deflected; their hexahedra are disjoint."""
    points = mesh.points.copy()
    for one in results:
        changed = np.concatenate([one.region.inside, one.motion.nodes])
        points[changed] = one.points[changed]
    return mesh.with_points(points)


def whole_mesh_seconds(mesh: TetMesh, result: Deflected) -> float:
    """Time (s) to evaluate the first interpolant at every node: what confinement saves (section 5.1)."""
    start = perf_counter()
    for fit in result.steps[0].fits:
        fit.interpolant(mesh.points)
    return perf_counter() - start
