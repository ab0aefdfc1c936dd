"""One case, from parameters to validated result: geometry, mesh, deformation, validation, output."""

import json
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, replace
from math import nan
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from sdm_deflect.base.compiled import default_folder
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.threads import Progress
from sdm_deflect.cases.report.folder import plan_around, written_plan
from sdm_deflect.cases.run.deflect_file import motion_within_ranges
from sdm_deflect.cases.run.limit import Search
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.checks import tally
from sdm_deflect.deform.loop import run as carried_out
from sdm_deflect.deform.options import RepairMode
from sdm_deflect.deform.volume.deflection import Deflection, deflect
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.geometry.parameters import LARGEST_TURN
from sdm_deflect.meshing.cache import MeshCache, cache_key
from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import Quality

from .case import Case, mesh_parameters
from .job import plan_of
from .metrics import MeshOrigin, Run, metrics
from .overset import finer_background
from .reference import reference
from .run_folder import write_deformation

if TYPE_CHECKING:
    from sdm_deflect.cases.report.data import ReportData
    from sdm_deflect.cases.report.pictures import Gallery
    from sdm_deflect.meshing.generate.generation import Generated


def run_case(case: Case, watch: Stopwatch, folder: Path, cache: bool = True, report: bool = True) -> Run:
    """Run a case and write its files into `folder`, with pictures and a page if a `report` is wanted."""
    with reference(case, cache) as deflected_cad:
        # Matplotlib, pyvista and trimesh load while the CAD is being built.
        from .validation import validate

        mesh, origin = mesh_of_case(case, watch, cache)
        background = background_mesh(case, watch, cache) if case.domain == "block" else None
        with watch.stage("deformation") as progress:
            plan = plan_of(case, mesh, progress=progress)
            motion = motion_within_ranges(plan, lambda _: nullcontext(progress))
            ((deflection, mesh_checks),) = carried_out(plan, lambda _: nullcontext(progress), "m", motion)
            moved = mesh.with_points(deflection.points)
            whole = whole_mesh_seconds(deflection)
            stiff = pinned_quality(case, mesh, progress) if case.domain == "block" else None
            progress(adaptation_text(deflection), 1.0)
        with watch.stage("plan") as progress:
            around = motion or plan_around(deflection, progress)
        if report:
            shown, gallery = draw_report(case, deflection, folder, watch)
        with watch.stage("files") as progress:
            write_deformation(folder, case, deflection, background)
            progress(f"{sum(path.stat().st_size for path in folder.glob('*.*')) / 1e6:.1f} MB", 1.0)
        with watch.stage("validation") as progress:
            progress("waiting for the deflected CAD", nan)
            checks = validate(case, deflection, mesh_checks, deflected_cad(), background)
            progress(f"{tally(checks)} checks passed", 1.0)
    run = Run(case, mesh, origin, moved, deflection, whole, checks, watch, background, stiff)
    planned = written_plan(folder, around)
    if report:
        from sdm_deflect.cases.report.page import write_report

        from .report import draw_distances

        with watch.stage("report") as progress:
            data = replace(shown, motion=around).with_verdict(checks, metrics(run) | planned)
            write_report(data, gallery.with_more(draw_distances(data, folder / "figures")), folder)
            progress(f"{(folder / 'report.html').stat().st_size / 1e6:.1f} MB", 1.0)
    (folder / "metrics.json").write_text(json.dumps(metrics(run) | planned, indent=2) + "\n", encoding="utf-8")
    return run


def draw_report(case: Case, deflection: Deflection, folder: Path, watch: Stopwatch) -> tuple["ReportData", "Gallery"]:
    """Return the content of the report, and its pictures, which are drawn into `folder`."""
    from sdm_deflect.cases.report.pictures import draw_pictures

    from .report import report_data_of

    with watch.stage("pictures") as progress:
        shown = report_data_of(case, deflection)
        gallery = draw_pictures(shown, folder / "figures")
        progress(f"{len(gallery.exhibits)} pictures", 1.0)
    return shown, gallery


def mesh_of_case(case: Case, watch: Stopwatch, cache: bool = True) -> tuple[Mesh, MeshOrigin]:
    """Return the undeflected mesh of the case, from the cache if it is there and whole."""

    def generate() -> "Generated":
        from .cad import generate_undeflected  # loads the CAD kernel: seconds that a cached mesh spares

        return generate_undeflected(case, watch)

    mesh, origin = cached_mesh(mesh_parameters(case), generate, watch, cache)
    return replace(mesh, name=case.name), origin


def background_mesh(case: Case, watch: Stopwatch, cache: bool = True) -> Mesh:
    """Return the mesh of the aircraft that surrounds the Chimera block of a case."""

    def generate() -> "Generated":
        from .cad import around_block

        return around_block(case, finer_background(case), watch)

    return cached_mesh(background_parameters(case), generate, watch, cache)[0]


def background_parameters(case: Case) -> dict[str, object]:
    """Return everything that the mesh around the Chimera block of a case depends on."""
    return {
        "fighter": case.fighter, "mesh": case.background, "domain": "background",
        "surface": case.deflections[0].surface, "finer": [array.tolist() for array in finer_background(case)],
    }  # fmt: skip


def cached_mesh(
    parts: dict[str, object], generate: "Callable[[], Generated]", watch: Stopwatch, cache: bool
) -> tuple[Mesh, MeshOrigin]:
    """Return the mesh of these parameters from the cache, or generate it and keep it."""
    store, key = MeshCache(default_folder()), cache_key(parts)
    with watch.stage("cache") as tell:
        try:
            entry = store.load(key) if cache else None
            tell(f"{len(tets_of(entry[0]))} cells" if entry else "no mesh of these parameters", 1.0)
        except MeshFileError as error:
            entry = None
            tell(f"meshing anew, the cached mesh cannot be used: {error}", 1.0)
    if entry is not None:
        return entry[0], MeshOrigin(**entry[1])  # type: ignore[arg-type]
    made = generate()
    report = made.report
    origin = MeshOrigin(report.verification.boundary_to_cad_max, report.attempts, report.seconds, report.unseeded)
    if cache:
        try:
            store.store(key, made.mesh, asdict(origin))
        except MeshFileError as error:
            with watch.stage("cache") as tell:
                tell(f"the mesh is not kept for other runs: {error}", 1.0)
    return made.mesh, origin


def adaptation_text(deflection: Deflection) -> str:
    """Return a text with the number of centres of all adaptations and the largest remaining residual."""
    fits = [fit for box in deflection.boxes for step in box.steps for fit in step.fits.adaptations]
    centres, residual = sum(len(fit.chosen) for fit in fits), max(fit.max_error for fit in fits)
    return f"{centres} centres, residual {residual:.1e} m"


def pinned_quality(case: Case, mesh: Mesh, progress: Progress) -> Quality:
    """Return the quality inside the box with a pinned Chimera face, to show the gain from sliding."""
    stiff = replace(case, repair="off", confinement=replace(case.confinement, slide=False))
    plan = plan_of(stiff, mesh, progress=progress)
    return deflect(plan, progress=progress).quality[0]


def case_search(case: Case, mesh: Mesh, threshold: float, resolution: float) -> Search:
    """Return how the largest angles of a case are found, given its mesh and the smallest acceptable mean ratio."""

    def plan(angle: float, repair: RepairMode) -> Plan:
        return plan_of(replace(case, angle=angle, repair=repair), mesh)

    largest = LARGEST_TURN / max(abs(turn.factor) for turn in case.deflections)
    return Search(case.name, "deg", plan, largest, resolution, threshold)


def whole_mesh_seconds(deflection: Deflection) -> float:
    """Return the time (s) to evaluate the first surface's interpolant at every node (section 5.1: saved by the box)."""
    interpolant, start = deflection.boxes[0].steps[0].fits.interpolant, perf_counter()
    interpolant(deflection.plan.mesh.points)
    return perf_counter() - start
