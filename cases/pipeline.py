"""One case, from parameters to validated result: geometry, mesh, deformation, validation, output."""

from dataclasses import asdict
from pathlib import Path
from time import perf_counter

import numpy as np

from cases.cad import undeflected_cad
from cases.case import Case
from cases.deflect import Deflected, deflect
from cases.output import write_run
from cases.overlap import check_disjoint
from cases.progress import Stopwatch
from cases.report.page import write_report
from cases.run import MeshOrigin, Run
from cases.validate import validate
from deform.volume import fused
from meshing.cache import MeshCache, cache_key, default_folder
from meshing.generate import generate
from meshing.mesh import TetMesh


def run_case(case: Case, watch: Stopwatch, folder: Path, cache: bool = True) -> Run:
    """Run a case and write its files into `folder`."""
    mesh, origin = meshed(case, watch, cache)
    with watch.stage("deformation") as tell:
        results = tuple(deflect(mesh, case, one, tell) for one in case.deflections)
        check_disjoint([result.turn.region for result in results])
        deflected = combined(mesh, results)
        whole = whole_mesh_seconds(mesh, results[0])
    with watch.stage("validation"):
        checks = validate(case, mesh, deflected, [result.turn for result in results])
    run = Run(case, mesh, origin, deflected, results, whole, checks, watch.seconds)
    with watch.stage("report"):
        write_report(run, folder)
    write_run(run, folder)
    return run


def meshed(case: Case, watch: Stopwatch, cache: bool = True) -> tuple[TetMesh, MeshOrigin]:
    """Return the undeflected mesh of the case, from the cache if it is there and whole."""
    store, key = MeshCache(default_folder()), cache_key({"fighter": case.fighter, "mesh": case.mesh})
    found = store.load(key) if cache else None
    if found is not None:
        return found[0], MeshOrigin(**found[1])  # type: ignore[arg-type]
    with watch.stage("geometry"):
        model = undeflected_cad(case)
    with watch.stage("mesh") as tell:
        generated = generate(model, case.mesh, tell)
    report = generated.report
    origin = MeshOrigin(report.verification.boundary_to_cad_max, report.attempts, report.seconds)
    if cache:
        store.store(key, generated.mesh, asdict(origin))
    return generated.mesh, origin


def combined(mesh: TetMesh, results: tuple[Deflected, ...]) -> TetMesh:
    """Return the mesh with every control surface deflected; their hexahedra are disjoint."""
    points = mesh.points.copy()
    for one in results:
        changed = np.concatenate([one.turn.region.inside, one.turn.motion.nodes])
        points[changed] = one.points[changed]
    return mesh.with_points(points)


def whole_mesh_seconds(mesh: TetMesh, result: Deflected) -> float:
    """Time (s) to evaluate the first surface's interpolant at every node: what confinement saves (section 5.1)."""
    start = perf_counter()
    fused(result.steps[0].fits)(mesh.points)
    return perf_counter() - start
