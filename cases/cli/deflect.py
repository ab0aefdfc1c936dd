"""Commands on any mesh file: example, quality, deflect, limit, apply, gradient."""

import lzma
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sdm_deflect.base.errors import InputError, short_list
from sdm_deflect.cases.settings.job_settings import (
    BY_NAME,
    JobSettings,
    check_swept,
    job_settings,
    read_job,
    with_options,
)
from sdm_deflect.cases.settings.spellings import selections_of

from . import options

if TYPE_CHECKING:
    from sdm_deflect.base.arrays import FloatArray
    from sdm_deflect.base.threads import Runner
    from sdm_deflect.cases.run.limit import Search
    from sdm_deflect.cases.run.mesh_files import OutputFiles
    from sdm_deflect.cases.run.progress import Stopwatch
    from sdm_deflect.deform.options import RepairMode
    from sdm_deflect.deform.volume.plan import Plan
    from sdm_deflect.meshing.mesh.mesh import Mesh

# What each mesh of `sdm example` is, and how to deflect it.
EXAMPLES = {
    "naca.su2": (
        "a half wing of 37,000 cells with a flap",
        ("--surface flap --fixed wing --hinge 0.7,0.6,0 0.7,1.4,0 --angle 15 --motion blended",),
    ),
    "layers.su2": (
        "a half wing of 5,200 cells with a blunt trailing edge, under 16 layers of hexahedra",
        ("--surface flap --fixed wing --hinge 0.7,0.3,0 0.7,0.7,0 --angle 10 --motion blended",),
    ),
    "fighter.su2": (
        "the SDM, a fighter, in 128,000 cells, and settings that turn all its control surfaces",
        (
            "--surface aileron_left --fixed wing_left --hinge 0.69181,-0.3048,0 0.6767,-0.11627,0 "
            "--angle 12 --motion blended",
            "--surface rudder --fixed fin --fixed pedestal --hinge 0.94642,0,0.2133 0.87672,0,0.0955 "
            "--angle 15 --motion blended",
            "--surface tail_left --motion root --on fuselage_panel_left --fixed fuselage --fixed fuselage_rear "
            "--fixed ventral_left "
            "--hinge 0.86842,-0.2228,-0.01163 0.86842,-0.06598,-0.01163 --angle 12",
            "--surface tail_right --motion root --on fuselage_panel_right --fixed fuselage --fixed fuselage_rear "
            "--fixed ventral_right "
            "--hinge 0.86842,0.06598,-0.01163 0.86842,0.2228,-0.01163 --angle 12",
        ),
    ),
}
"""Options of work that others do."""
moved = partial(click.option, cls=options.Grouped, group="What moves")
# What is tried, how cells are repaired, where the files go, and figures of it.
Found = tuple["Search", "RepairMode", Path, dict[str, Any]]


@click.command(cls=options.DeflectCommand, params=options.settings_options(BY_NAME.values()))
@click.argument("mesh", type=options.FILE)
@moved(
    "--angles",
    metavar="A:B:STEP|FILE",
    help="Many angles, a file for each; a list with commas; or a .csv, a column per surface.",
)
@options.output_option(
    "--out", type=options.FILE, help="File to write (default: MESH-deflected); its suffix is the format."
)
@options.output_option("--sensitivity", is_flag=True, help="Also write d(points)/d(angle), as .npz and .vtu.")
@options.output_option("--plan", type=options.FILE, help="Also save the plan, for `sdm apply`.")
@options.output_option("--mesh/--no-mesh", "meshes", default=True, help="Whether to write meshes, beside a --plan.")
@options.report_option
@options.output_option("--dry-run", is_flag=True, help="Print what would be done, and write nothing.")
@options.json_option
@options.progress_options
@options.cluster_option(
    "--workers", "count", type=click.IntRange(0), default=0, metavar="N", help="Dask processes to start here."
)
@options.cluster_option("--scheduler", default="", metavar="ADDRESS|FILE", help="Dask scheduler to join.")
@options.cluster_option(
    "--worker-memory", "memory", default="", metavar="SIZE", help="Memory of each of the --workers, such as 2GB."
)
@click.option("--config", type=options.FILE, help="Settings in a TOML file; several surfaces as [[surface]].")
@options.set_option
def deflect(
    mesh: Path,
    out: Path | None,
    sensitivity: bool,
    dry_run: bool,
    report: bool,
    plan: Path | None,
    meshes: bool,
    **given: Any,
) -> int:
    """Deflect surfaces of a mesh, and judge the new mesh.

    sdm deflect wing.su2 --surface flap --fixed wing --hinge 0.7,0,0 0.7,1,0 --angle 10 --motion blended
    """
    from sdm_deflect.cases.run.deflect_file import deflect_file, figures, plan_file
    from sdm_deflect.cases.run.mesh_files import OutputFiles

    as_json, quiet, verbose = (given.pop(name) for name in ("as_json", "quiet", "verbose"))
    angles, helpers = given.pop("angles"), {name: given.pop(name) for name in ("count", "scheduler", "memory")}
    twice = [f"--{name}" for name in ("angle", "down", "up", "amount") if angles and given.get(name) is not None]
    if twice:
        raise InputError(f"{twice[0]} beside --angles: give one of them")
    has_range = given.get("range") is not None
    settings, inputs = _settings(given)
    if has_range and len(settings.surface) > 1:
        raise InputError("--range: there are several surfaces; give each its range in its table of the file")
    from sdm_deflect.cases.settings.jobs import in_series, swept
    from sdm_deflect.deform.volume.job import poses_of

    if angles:
        jobs, poses = swept(settings, angles, by_range=not meshes)
    else:
        jobs, poses = in_series(settings, by_range=not meshes)
        if plan and len(poses) > 1:
            raise InputError("--plan: a plan holds one shape; give one file in --to")
    if angles and plan:
        jobs = tuple(job.over(amounts) for job, amounts in zip(jobs, poses_of(jobs, poses), strict=True))
    poses = tuple(dict.fromkeys(poses))
    wanted = replace(OutputFiles.of(mesh, out, poses, sensitivity, report), plan=plan, meshes=meshes)
    wanted.check(inputs)
    with (
        options.watch(quiet or (as_json and not verbose), verbose) as watch,
        _runner(helpers, watch, mesh, wanted.out.absolute().parent) as runner,
    ):
        if dry_run:
            decided = plan_file(wanted, jobs, watch, runner)
        else:
            done = deflect_file(wanted, jobs, watch, runner)
    if dry_run:
        return _show_plan(wanted, decided, as_json)
    from .console import result_table

    options.print_either(as_json, figures(done, watch), result_table(done, verbose))
    return options.code_of(done.passed)


@click.command(cls=options.DeflectCommand, params=options.settings_options(BY_NAME.values()))
@click.argument("place", metavar="CASE|MESH", type=options.CaseName())
@options.output_option("--scale", type=options.SCALES, help="Of a case: size of the mesh (default: small).")
@options.output_option("--quality", type=float, help="Of a case: smallest acceptable mean ratio (default: 0.2).")
@options.output_option("--resolution", type=float, help="Of the limit (default: 1 degree, 0.02 of a table).")
@options.output_option("--out", type=options.FILE, help="Output folder (default: runs/CASE-limit, or MESH-limit).")
@options.json_option
@options.progress_options
@click.option("--config", type=options.FILE, help="Of a mesh: settings in a TOML file.")
@options.set_option
def limit(place: str, out: Path | None, as_json: bool, quiet: bool, verbose: bool, **given: Any) -> None:
    """Find the largest deflections, and what ends them.

    These are the amounts, up and down, at which every check of sdm deflect holds. They are sought without repair and
    with it; with --repair off only without.

    sdm limit wing.su2 --surface flap --fixed wing --hinge 0.7,0,0 0.7,1,0 --motion blended
    """
    from sdm_deflect.cases.aircraft.registry import CASES

    if place not in CASES and not Path(place).exists():
        raise InputError(f"{place} is no mesh file, and no case: the cases are {', '.join(CASES)}")
    for name, high in (("quality", 1.0), ("resolution", 30.0)):
        if given[name] is not None and not 0.0 < given[name] < high:
            raise InputError(f"--{name} {given[name]:g} must be between 0 and {high:g}")
    search_of = _search_of_case if place in CASES else _search_of_mesh
    with options.watch(quiet or (as_json and not verbose), verbose) as watch:
        search, repair, folder, figures = search_of(place, watch, given)
        from sdm_deflect.cases.run.limit import write_limits
        from sdm_deflect.cases.run.output import output_folder

        with output_folder(out or folder, ()) as scratch:
            with watch.stage("limits") as progress:
                limits = search.limits(
                    repair, progress, (lambda line: None) if quiet else partial(click.echo, err=True)
                )
            table = write_limits(limits, search, scratch)
    options.print_either(as_json, {**figures, "limits": [asdict(row) for row in limits]}, table)


@click.command()
@click.argument("plan", type=options.FILE)
@click.argument("meshes", metavar="MESH...", type=options.FILE, nargs=-1, required=True)
@click.option("--angle", required=True, metavar="A", help="Amount, or several such as flap=12,tab=-3; others stay.")
@click.option("--out", type=options.FILE, help="File or case (default: MESH-deflected).")
@click.option("--zone", "zones", metavar="NAME", multiple=True, help="Further zones that deform; '*' for all; repeat.")
@options.json_option
@options.progress_options
def apply(
    plan: Path,
    meshes: tuple[Path, ...],
    angle: str,
    out: Path | None,
    zones: tuple[str, ...],
    as_json: bool,
    **show: bool,
) -> int:
    """Move meshes by a saved plan.

    `sdm deflect --plan` saves it. The files may be the parts of a decomposed OpenFOAM case; every point gets the same
    bits as in the whole: sdm apply flap.npz --angle 12 case/processor*
    """
    from sdm_deflect.cases.run.apply import apply_plan

    quiet = show["quiet"] or (as_json and not show["verbose"])
    with options.watch(quiet, show["verbose"]) as watch, watch.stage("apply") as progress:
        done = apply_plan(plan, _named_amounts("--angle", angle), meshes, out, zones, progress)
    files = [{"file": str(file), "points": points, "moved": moved} for file, points, moved in done.files]
    lines = [f"{file}: {moved} of {points} points moved" for file, points, moved in done.files]
    if done.missing:
        lines.append(f"{done.missing} of {done.places} places of {plan} are in none of these meshes")
    options.print_either(as_json, {**asdict(done), "files": files, "verdict": done.verdict}, *lines, done.verdict)
    return options.code_of(not done.faults)


@click.command()
@click.argument("sensitivity", type=options.FILE)
@click.option("--plan", type=options.FILE, required=True, help="The plan.")
@click.option("--at", required=True, metavar="A", help="Amount at the adjoint, or several such as flap=12,tab=-3.")
@click.option("--mesh", type=options.FILE, help="Undeflected mesh (default: the plan's, beside it).")
@click.option("--zone", "zones", metavar="NAME", multiple=True, help="Further zones that deform; '*' for all; repeat.")
@options.json_option
@options.progress_options
def gradient(
    sensitivity: Path, plan: Path, at: str, mesh: Path | None, zones: tuple[str, ...], as_json: bool, **show: bool
) -> int:
    """Turn an adjoint's sensitivities into derivatives by amounts.

    SENSITIVITY is a .csv of SU2, an .npz, a .cgns, or a pointVectorField of OpenFOAM, by all coordinates of the mesh:
    sdm gradient volume_sens.csv --plan wing-plan.npz --at flap=12,tab=-3
    """
    from sdm_deflect.cases.run.gradient import amount_derivatives

    quiet = show["quiet"] or (as_json and not show["verbose"])
    with options.watch(quiet, show["verbose"]) as watch, watch.stage("gradient") as progress:
        amounts = _named_amounts("--at", at)
        derivatives = amount_derivatives(sensitivity, plan, amounts, mesh, zones, progress)
    units = {control.name: control.unit for control in derivatives.motion.controls}
    lines = [f"d/d({name}) = {value:.10g} per {units[name]}" for name, value in derivatives.values.items()]
    figures = {"gradient": derivatives.values, "units": units, "nodes": derivatives.nodes}
    options.print_either(as_json, figures, *lines, f"from {derivatives.nodes} nodes")
    return 0


def _named_amounts(flag: str, text: str) -> float | dict[str, float]:
    """Return an amount, or amounts by name for ``NAME=AMOUNT`` with commas; InputError for another text."""
    try:
        if "_" in text.rpartition("=")[2]:  # Python's digit groups: 1_0 is more likely a slip than 10
            raise ValueError
        if "=" not in text:
            return float(text)
        pairs = [part.rpartition("=") for part in text.split(",")]
        amounts = {name.strip(): float(amount) for name, _, amount in pairs}
    except ValueError:
        raise InputError(f"{flag} {text}: must be a number, or NAME=NUMBER with commas") from None
    if len(amounts) < len(pairs):
        raise InputError(f"{flag} {text}: a surface is named twice")
    return amounts


@click.command()
@click.argument("folder", type=options.FILE, default=Path())
@click.option("--fighter", is_flag=True, help="Write the SDM fighter instead, and settings that turn all its surfaces.")
@click.option("--layers", is_flag=True, help="Write a wing under layers of hexahedra instead.")
def example(folder: Path, fighter: bool, layers: bool) -> None:
    """Write a half wing with a flap, to try the commands on.

    The file is naca.su2, layers.su2, or fighter.su2 and fighter.toml, in FOLDER or here.
    """
    from sdm_deflect.base.files import fresh

    if fighter and layers:
        raise InputError("--fighter and --layers are two examples: give one of them")
    names = ("fighter.su2", "fighter.toml") if fighter else ("layers.su2",) if layers else ("naca.su2",)
    for out in (folder / name for name in names):
        if out.exists():
            raise InputError(f"{out} is there already: delete it, or name another folder")
    mesh, *settings = (folder / name for name in names)
    for out in settings:
        with fresh(out) as beside:
            beside.write_bytes(files("sdm_deflect.cases").joinpath(out.name).read_bytes())
    with fresh(mesh) as beside:
        beside.write_bytes(lzma.decompress(files("sdm_deflect.cases").joinpath(f"{mesh.name}.xz").read_bytes()))
    about, commands = EXAMPLES[mesh.name]
    click.echo(f"wrote {', '.join(map(str, (mesh, *settings)))}: {about}. Next:")
    for words in (*(f"--config {out}" for out in settings), *commands):
        click.echo(f"sdm deflect {mesh} {words}")


@click.command(params=options.settings_options([BY_NAME["select"]]))
@click.argument("mesh", type=options.FILE)
@click.option("--slot", nargs=2, metavar="NAME NAME", help="Measure gap and overlap between two patches (plane mesh).")
@options.json_option
def quality(mesh: Path, select: tuple[str, ...], slot: tuple[str, ...] | None, as_json: bool) -> None:
    """List the patches of a mesh, its sizes and its cell quality."""
    from sdm_deflect.cases.run.inspection import file_figures, inspect

    if as_json:
        options.print_json(file_figures(mesh, selections_of(select), slot or ()))
    else:
        click.echo(inspect(mesh, selections_of(select), slot or ()))


@click.command()
@click.argument("mesh", type=options.FILE)
@click.argument("out", type=options.FILE)
@options.json_option
@options.progress_options
def convert(mesh: Path, out: Path, as_json: bool, quiet: bool, verbose: bool) -> None:
    """Write a mesh in another format.

    OUT is a new file, or a new folder for OpenFOAM; its suffix is the format. Nodes, cells and patches stay, and their
    names as far as the format can hold them: sdm convert wing.msh wing.cgns
    """
    from sdm_deflect.cases.api import read
    from sdm_deflect.cases.file_mesh import written
    from sdm_deflect.meshing.formats.registry import format_of

    if out.exists():
        raise InputError(f"{out} exists already; delete it, or choose another name")
    format_of(out)  # refused before a long read
    with options.watch(quiet or (as_json and not verbose), verbose) as watch:
        with watch.stage("read") as progress:
            source = read(mesh, progress)
        with watch.stage("write") as progress:
            points, rounding = _rounded_for(out, source)
            target, lost = written(source, points, out, progress)
    lost = (*rounding, *lost)
    sizes = {"points": len(source.points), "cells": sum(source.cell_counts), "patches": list(source.names)}
    lines = [*(f"note: {text}" for text in source.notes), *(f"lost in this format: {text}" for text in lost)]
    last = f"wrote {target}: {sizes['points']} points, {sizes['cells']} cells, patches {', '.join(source.names)}"
    options.print_either(as_json, {"file": target, **sizes, "notes": source.notes, "lost": lost}, *lines, last)


def _rounded_for(out: Path, mesh: "Mesh") -> "tuple[FloatArray, tuple[str, ...]]":
    """Return the points (N, 3) as a new file keeps them, and a sentence if they are rounded."""
    from sdm_deflect.cases.run.mesh_files import precision_of

    precision = precision_of(Path(mesh.source) if mesh.source else None, out, mesh)
    points = precision.rounded(mesh.points, mesh.points)
    off = float(abs(points - mesh.points).max(initial=0.0))
    said = f"digits of coordinates, which are rounded to {8 * precision.real.itemsize} bits by up to {off:.2g}"
    return points, (said,) if off else ()


def _search_of_case(case: str, watch: "Stopwatch", given: dict[str, Any]) -> Found:
    """Return the search for the limits of a case, whose mesh is made first."""
    from sdm_deflect.cases.aircraft.registry import resolve
    from sdm_deflect.cases.run.output import check_installed

    threshold, resolution = given.pop("quality") or 0.2, given.pop("resolution") or 1.0
    chosen = {name: given.pop(name) for name in ("scale", "repair", "assignments")}
    for name in (name for name, value in given.items() if value not in (None, ())):
        flag = options.flag(BY_NAME[name]) if name in BY_NAME else f"--{name}"
        raise InputError(f"{flag} is of a mesh, and {case} is a case: replace its settings by --set")
    resolved = resolve(case, **{**chosen, "scale": chosen["scale"] or "small"})
    check_installed("aircraft")

    from sdm_deflect.cases.aircraft.pipeline import case_search, mesh_of_case

    search = case_search(resolved, mesh_of_case(resolved, watch)[0], threshold, resolution)
    figures = {"case": case, "scale": resolved.scale, "quality": threshold, "resolution_deg": resolution}
    return search, resolved.repair, Path("runs") / f"{case}-limit", figures


def _search_of_mesh(name: str, watch: "Stopwatch", given: dict[str, Any]) -> Found:
    """Return the search for the limits of surfaces of a mesh, which is read first."""
    from sdm_deflect.cases.run.limit import search_of
    from sdm_deflect.cases.run.mesh_files import OutputFiles
    from sdm_deflect.cases.settings.jobs import jobs_of
    from sdm_deflect.meshing.formats.registry import read

    for option in ("scale", "quality"):
        if given.pop(option) is not None:
            raise InputError(f"--{option} is of a case, and {name} is a mesh; a mesh keeps the share --min-quality")
    resolution, path = given.pop("resolution") or 0.0, Path(name)
    if not (given["config"] or given["table"] or given["angle"]):
        given["angle"] = 1.0
    jobs = jobs_of(check_swept(_settings(given)[0]))
    wanted = OutputFiles.of(path, None, ())
    with watch.stage("read") as progress:
        mesh = read(path, progress)
    search, asked = search_of(mesh, jobs, resolution, wanted.precision(mesh)), jobs[0].repair
    figures = {"mesh": name, "min_quality": asked.min_quality, "unit": search.unit, "resolution": search.resolution}
    return search, asked.mode, wanted.limits, figures


def _runner(helpers: Mapping[str, Any], *where: Any) -> AbstractContextManager["Runner"]:
    from sdm_deflect.base.threads import HERE

    if not any(helpers.values()):
        return nullcontext(HERE)
    from sdm_deflect.cases.run.cluster import workers

    return workers(*where, **helpers)


def _show_plan(wanted: "OutputFiles", plan: "Plan", as_json: bool) -> int:
    from sdm_deflect.cases.run.deflect_file import plan_figures

    from .console import plan_table

    names = [
        str(path)
        for path in (*map(wanted.mesh, wanted.poses), *wanted.extra, *filter(None, [wanted.plan]), *wanted.reports)
    ]
    figured = {**plan_figures(plan), "files": names}
    options.print_either(as_json, figured, plan_table(plan), f"would write {short_list(names)}")
    return 0


def _settings(given: dict[str, Any]) -> tuple[JobSettings, tuple[Path, ...]]:
    """Return the settings of a configuration file, replaced by options, and the files that they name."""
    from sdm_deflect.cases.run.mesh_files import inputs_of

    config, assignments = given.pop("config"), given.pop("assignments")
    nested = with_options(read_job(config) if config else {}, given, assignments)
    return job_settings(nested), (*inputs_of(nested, Path()), *([config] if config else ()))
