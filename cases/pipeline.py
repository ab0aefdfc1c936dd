"""One case, from parameters to validated result: geometry, mesh, deformation, validation, output."""

from collections.abc import Callable
from dataclasses import asdict, replace
from math import nan
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.deflect import Deflected, carried_out, deflect, inside_quality
from sdm_deflect.cases.metrics import metrics
from sdm_deflect.cases.output import write_deformation, write_metrics
from sdm_deflect.cases.overlap import check_disjoint
from sdm_deflect.cases.progress import Report, Stopwatch
from sdm_deflect.cases.reference import reference
from sdm_deflect.cases.run import MeshOrigin, Run
from sdm_deflect.cases.sdm.overset import finer_background
from sdm_deflect.deform.quality import Quality
from sdm_deflect.deform.rbf.sites import pinned
from sdm_deflect.deform.volume.fused import fused
from sdm_deflect.meshing.cache import MeshCache, cache_key, default_folder
from sdm_deflect.meshing.mesh import TetMesh

if TYPE_CHECKING:
    from sdm_deflect.meshing.generate.generation import Generated


def run_case(case: Case, watch: Stopwatch, folder: Path, cache: bool = True, report: bool = True) -> Run:
    """Run a case and write its files into `folder`; without a report neither page nor pictures."""
    with reference(case) as deflected_cad:
        # Matplotlib, pyvista and trimesh load while the CAD is being built.
        from sdm_deflect.cases.validate import validate

        if report:
            from sdm_deflect.cases.report.data import report_data_of
            from sdm_deflect.cases.report.page import write_report
            from sdm_deflect.cases.report.pictures import drawn

        mesh, origin = meshed(case, watch, cache)
        background = background_mesh(case, watch, cache) if case.domain == "block" else None
        with watch.stage("deformation") as tell:
            results = tuple(deflect(mesh, case, one, tell) for one in case.deflections)
            check_disjoint([result.turn.region for result in results])
            deflected = combined(mesh, results)
            whole = whole_mesh_seconds(mesh, results[0])
            stiff = pinned_quality(case, mesh, results[0], tell) if case.domain == "block" else None
            tell(adapted(results), 1.0)
        if report:
            with watch.stage("pictures") as tell:
                shown = report_data_of(case, mesh, deflected, results)
                gallery = drawn(shown, folder / "figures")
                tell(f"{len(gallery.exhibits)} pictures", 1.0)
        with watch.stage("files") as tell:
            write_deformation(folder, case, mesh, deflected, results, background)
            tell(f"{sum(path.stat().st_size for path in folder.glob('*.*')) / 1e6:.1f} MB", 1.0)
        with watch.stage("validation") as tell:
            tell("waiting for the deflected CAD", nan)
            checks = validate(case, mesh, deflected, [one.turn for one in results], deflected_cad(), background)
            tell(f"{sum(check.passed for check in checks)} of {len(checks)} checks passed", 1.0)
    run = Run(case, mesh, origin, deflected, results, whole, checks, watch.seconds, background, stiff)
    if report:
        with watch.stage("report") as tell:
            write_report(shown.judged(checks, metrics(run)), gallery, folder)
            tell(f"{(folder / 'report.html').stat().st_size / 1e6:.1f} MB", 1.0)
    write_metrics(run, folder)
    return run


def meshed(case: Case, watch: Stopwatch, cache: bool = True) -> tuple[TetMesh, MeshOrigin]:
    """Return the undeflected mesh of the case, from the cache if it is there and whole."""
    parts = {"fighter": case.fighter, "mesh": case.mesh, "domain": case.domain}
    if case.domain == "block":
        parts |= {"block": case.block, "surface": case.deflections[0].surface}

    def generate() -> "Generated":
        from sdm_deflect.cases.generated import undeflected  # loads the CAD kernel: seconds that a cached mesh spares

        return undeflected(case, watch)

    return _cached(parts, generate, watch, cache)


def background_mesh(case: Case, watch: Stopwatch, cache: bool = True) -> TetMesh:
    """Return the mesh of the aircraft that surrounds the Chimera block of a case."""
    finer = finer_background(case)
    parts = {
        "fighter": case.fighter, "mesh": case.background, "domain": "background",
        "surface": case.deflections[0].surface, "finer": [array.tolist() for array in finer],
    }  # fmt: skip

    def generate() -> "Generated":
        from sdm_deflect.cases.generated import around_block

        return around_block(case, finer, watch)

    return _cached(parts, generate, watch, cache)[0]


def _cached(
    parts: dict[str, object], generate: "Callable[[], Generated]", watch: Stopwatch, cache: bool
) -> tuple[TetMesh, MeshOrigin]:
    """Return the mesh of these parameters from the cache, or generate it and keep it."""
    store, key = MeshCache(default_folder()), cache_key(parts)
    with watch.stage("cache") as tell:
        found = store.load(key) if cache else None
        tell(f"{len(found[0].tets)} cells" if found else "no mesh of these parameters", 1.0)
    if found is not None:
        return found[0], MeshOrigin(**found[1])  # type: ignore[arg-type]
    made = generate()
    origin = MeshOrigin(made.report.verification.boundary_to_cad_max, made.report.attempts, made.report.seconds)
    if cache:
        store.store(key, made.mesh, asdict(origin))
    return made.mesh, origin


def adapted(results: tuple[Deflected, ...]) -> str:
    """Say how many centres all adaptations took and the largest residual that is left."""
    fits = [fit for one in results for step in one.steps for fit in step.fits]
    centres, residual = sum(len(fit.chosen) for fit in fits), max(fit.max_error for fit in fits)
    return f"{centres} centres, residual {residual:.1e} m"


def pinned_quality(case: Case, mesh: TetMesh, sliding: Deflected, tell: Report) -> Quality:
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
