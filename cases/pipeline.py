"""One case, from parameters to validated result: geometry, mesh, deformation, validation, output."""

from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np

from cases.cad import background_cad, undeflected_cad
from cases.case import Case
from cases.deflect import Deflected, carried_out, deflect, inside_quality
from cases.hole import finer_background
from cases.output import write_run
from cases.overlap import check_disjoint
from cases.progress import Report, Stopwatch
from cases.report.page import write_report
from cases.run import MeshOrigin, Run
from cases.validate import validate
from deform.sites import pinned
from deform.volume import fused
from geometry.model import CadModel
from meshing.cache import MeshCache, cache_key, default_folder
from meshing.generate import Generated, generate
from meshing.mesh import TetMesh
from meshing.quality import QualitySummary


def run_case(case: Case, watch: Stopwatch, folder: Path, cache: bool = True) -> Run:
    """Run a case and write its files into `folder`."""
    mesh, origin = meshed(case, watch, cache)
    background = background_mesh(case, watch, cache) if case.domain == "block" else None
    with watch.stage("deformation") as tell:
        results = tuple(deflect(mesh, case, one, tell) for one in case.deflections)
        check_disjoint([result.turn.region for result in results])
        deflected = combined(mesh, results)
        whole = whole_mesh_seconds(mesh, results[0])
        stiff = pinned_quality(case, mesh, results[0], tell) if case.domain == "block" else None
        tell(adapted(results), 1.0)
    with watch.stage("validation") as tell:
        checks = validate(case, mesh, deflected, [result.turn for result in results], background)
        tell(f"{sum(check.passed for check in checks)} of {len(checks)} checks passed", 1.0)
    run = Run(case, mesh, origin, deflected, results, whole, checks, watch.seconds, background, stiff)
    with watch.stage("report") as tell:
        write_report(run, folder)
        tell(f"{(folder / 'report.html').stat().st_size / 1e6:.1f} MB", 1.0)
    write_run(run, folder)
    return run


def meshed(case: Case, watch: Stopwatch, cache: bool = True) -> tuple[TetMesh, MeshOrigin]:
    """Return the undeflected mesh of the case, from the cache if it is there and whole."""
    parts = {"fighter": case.fighter, "mesh": case.mesh, "domain": case.domain}
    if case.domain == "block":
        parts |= {"block": case.block, "surface": case.deflections[0].surface}
    return _cached(parts, partial(undeflected_cad, case), partial(generate, parameters=case.mesh), watch, cache)


def background_mesh(case: Case, watch: Stopwatch, cache: bool = True) -> TetMesh:
    """Return the mesh of the aircraft that surrounds the Chimera block of a case."""
    finer = finer_background(case)
    parts = {
        "fighter": case.fighter, "mesh": case.background, "domain": "background",
        "surface": case.deflections[0].surface, "finer": [array.tolist() for array in finer],
    }  # fmt: skip
    mesher = partial(generate, parameters=case.background, finer=finer)
    return _cached(parts, partial(background_cad, case), mesher, watch, cache)[0]


def _cached(
    parts: dict[str, object],
    build: Callable[[], CadModel],
    mesher: Callable[..., Generated],
    watch: Stopwatch,
    cache: bool,
) -> tuple[TetMesh, MeshOrigin]:
    """Return the mesh of these parameters from the cache, or build and mesh the CAD and keep the result."""
    store, key = MeshCache(default_folder()), cache_key(parts)
    with watch.stage("cache") as tell:
        found = store.load(key) if cache else None
        tell(f"{len(found[0].tets)} cells" if found else "no mesh of these parameters", 1.0)
    if found is not None:
        return found[0], MeshOrigin(**found[1])  # type: ignore[arg-type]
    with watch.stage("geometry") as tell:
        model = build()
        tell(f"{len(model.faces)} CAD faces", 1.0)
    with watch.stage("mesh") as tell:
        generated = mesher(model, progress=tell)
        tell(f"{len(generated.mesh.tets)} cells in attempt {generated.report.attempts}", 1.0)
    report = generated.report
    origin = MeshOrigin(report.verification.boundary_to_cad_max, report.attempts, report.seconds)
    if cache:
        store.store(key, generated.mesh, asdict(origin))
    return generated.mesh, origin


def adapted(results: tuple[Deflected, ...]) -> str:
    """Say how many centres all adaptations took and the largest residual that is left."""
    fits = [fit for one in results for step in one.steps for fit in step.fits]
    centres, residual = sum(len(fit.chosen) for fit in fits), max(fit.max_error for fit in fits)
    return f"{centres} centres, residual {residual:.1e} m"


def pinned_quality(case: Case, mesh: TetMesh, sliding: Deflected, tell: Report) -> QualitySummary:
    """Quality inside the hexahedron if the Chimera face were pinned instead of sliding: what sliding is worth."""
    region = sliding.turn.region
    zero, held = tuple(pinned(part.points) for part in region.zero), np.ones_like(region.held_components)
    stiff = replace(sliding.turn, region=replace(region, zero=zero, held_components=held))
    return inside_quality(mesh, region, carried_out(mesh, case, stiff, tell).points)


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
