"""Commands on cases and finished runs: list, run, validate, report, compare, view, export, geometry."""

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.numbers import percent
from sdm_deflect.cases.settings.job_settings import BY_NAME

from . import options

if TYPE_CHECKING:
    from rich.console import Group

    from sdm_deflect.cases.aircraft.metrics import Run


@click.command("list")
@options.json_option
def list_cases(as_json: bool) -> None:
    """List the cases and their angles."""
    from sdm_deflect.cases.aircraft.registry import CASES

    if as_json:
        options.print_json(
            [{"name": case.name, "angle_deg": case.angle, "title": case.title} for case in CASES.values()]
        )
        return
    for case in CASES.values():
        click.echo(f"{case.name:<18}{case.angle:+6.1f} deg  {case.title}")


@click.command(params=options.settings_options([BY_NAME["range"], BY_NAME["strategy"], BY_NAME["repair"]]))
@click.argument("case", default="", type=options.CaseName())
@click.option("--scale", type=options.SCALES, help="Size of the mesh (default: small).")
@options.angle_option
@click.option("--out", type=options.FILE, help="Output folder (default: runs/CASE).")
@options.set_option
@options.config_option
@options.cache_option
@options.report_option
@options.json_option
@options.progress_options
def run(
    case: str, out: Path | None, cache: bool, report: bool, as_json: bool, quiet: bool, verbose: bool, **given: Any
) -> int:
    """Build a case as CAD, mesh it, deflect it and validate it."""
    from sdm_deflect.cases.aircraft.registry import resolve

    resolved = resolve(case, **given)

    from sdm_deflect.cases.run.output import check_installed, lacks, output_folder

    check_installed("aircraft")

    from sdm_deflect.cases.aircraft.pipeline import run_case

    folder, lacking = out or Path("runs") / resolved.name, lacks("report") if report else ""
    with output_folder(folder) as scratch, options.watch(quiet or (as_json and not verbose), verbose) as watch:
        result = run_case(resolved, watch, scratch, cache, report and not lacking)
    if lacking:
        click.echo(f"note: there is no report.html: {lacking}", err=True)
    if as_json:
        click.echo((folder / "metrics.json").read_text(encoding="utf-8"), nl=False)
    else:
        options.print_tables(case_table(result, folder, verbose))
    return options.code_of(result.passed)


def case_table(run: "Run", folder: Path, whole: bool) -> "Group":
    """Return the `result_table` of a case in a folder, with the figures that only cases have."""
    from sdm_deflect.cases.run.deflect_file import Outcome, PoseSummary
    from sdm_deflect.deform.checks import tally

    from .console import page_of, result_table, rigid_lines

    notes = [f"case: {run.case.title}, {run.case.scale}, {run.case.strategy}", f"mesh: {run.guide}"]
    notes += [f"CAD: {line}" for line in rigid_lines(run.checks)]
    notes += [] if whole else [f"checks: {tally(run.checks)} checks passed (--verbose: each)"]
    for state, quality in (("slides", run.deflection.quality[0]), ("is pinned", run.pinned)) if run.pinned else ():
        share = f"{percent(quality.below_0_4, 3)} below 0.4, {quality.inverted} inverted"
        notes.append(f"least quality inside if the Chimera face {state}: {quality.min:.3f}, {share}")
    summary, pages = PoseSummary.of(run.deflection, run.checks), (folder,) if page_of(folder).exists() else ()
    return result_table(Outcome(run.deflection.plan, (summary,), (folder,), pages, (), tuple(notes)), whole)


@click.command()
@click.option("--out", type=options.FILE, required=True, help="File to write: .step, .brep or .stl.")
@click.option("--case", type=options.CaseName(), help="Case whose aircraft is built (default: aileron).")
@options.config_option
@options.angle_option
@options.set_option
@click.option("--binary", is_flag=True, help="Of an .stl: triangles in binary, without the names of patches.")
@options.progress_options
def geometry(out: Path, case: str | None, angle: float | None, binary: bool, **given: Any) -> None:
    """Write the CAD of a case.

    --angle deflects it (default: 0). Faces in a .step and solids in an .stl have the names of the patches.
    """
    from sdm_deflect.base.errors import InputError
    from sdm_deflect.cases.aircraft.registry import resolve

    if out.suffix not in (".step", ".brep", ".stl"):
        raise InputError(f"--out {out}: the suffix must be .step, .brep or .stl")
    if binary and out.suffix != ".stl":
        raise InputError(f"--out {out}: only an .stl can be binary")
    quiet, verbose = given.pop("quiet"), given.pop("verbose")
    name = case or ("" if given["config"] else "aileron")
    resolved = resolve(name, angle=angle or 0.0, **given)

    from sdm_deflect.base.files import fresh
    from sdm_deflect.cases.aircraft.cad import deflected_cad, undeflected_cad

    with options.watch(quiet, verbose) as watch, watch.stage("geometry"):
        model = deflected_cad(resolved) if resolved.angle else undeflected_cad(resolved)
        with fresh(out) as beside:
            (model.write_binary_stl if binary else model.write)(beside)
    click.echo(f"{out}: {len(model.faces)} faces, {len(model.edges)} edges")


@click.command()
@click.argument("folder", type=options.FILE)
@options.json_option
@options.progress_options
def validate(folder: Path, as_json: bool, quiet: bool, verbose: bool) -> int:
    """Repeat the checks of a finished run from its files.

    The run may also be the folder beside a deflected mesh.
    """
    from sdm_deflect.cases.finished import read_run
    from sdm_deflect.cases.run.metrics import verdict_figures

    from .console import check_table, outcome, rigid_lines

    with options.watch(quiet, verbose) as watch, watch.stage("validation"):
        run = read_run(folder)
        checks = run.recheck()
    skipped = run.not_repeated(checks)
    notes = [f"not measured again: {', '.join(skipped)}; {run.validation.lacks}"] if skipped and run.validation else []
    tables = (check_table(checks, str(folder)), *rigid_lines(checks), *notes, outcome(checks))
    options.print_either(as_json, {"folder": folder, **verdict_figures(checks), "skipped": skipped}, *tables)
    return options.code_of(all(check.passed for check in checks))


@click.command()
@click.argument("folder", type=options.FILE)
@click.option("--figures", "form", type=click.Choice(("pdf", "svg", "png")), help="Also write the figures for a paper.")
@options.progress_options
def report(folder: Path, form: str | None, quiet: bool, verbose: bool) -> int:
    """Make the report of a finished run again.

    The run may also be the folder beside a deflected mesh. The command writes report.html and figures/ into it.
    """
    from sdm_deflect.cases.finished import read_run
    from sdm_deflect.cases.run.output import check_installed

    check_installed("report")
    with options.watch(quiet, verbose) as watch, watch.stage("report"):
        data = read_run(folder).report(form or "")
    click.echo(f"{folder / 'report.html'}: {(folder / 'report.html').stat().st_size / 1e6:.1f} MB")
    return options.code_of(data.passed)


@click.command()
@click.argument("folders", metavar="RUN RUN...", nargs=-1, required=True, type=options.FILE)
@options.json_option
@options.progress_options
def compare(folders: tuple[Path, ...], as_json: bool, quiet: bool, verbose: bool) -> None:
    """Compare the settings and figures of finished runs.

    A run may also be the folder beside a deflected mesh. The tables have what differs; with --verbose all figures.
    """
    from sdm_deflect.cases.compare import comparison, read_runs, rows_by_table

    from .console import comparison_tables

    with options.watch(quiet or as_json, verbose) as watch, watch.stage("read") as progress:
        runs = read_runs(folders, progress)
    names = [run.name for run in runs]
    options.print_either(as_json, comparison(runs), *comparison_tables(names, rows_by_table(runs, verbose)))


@click.command()
@click.argument("place", metavar="RUN|MESH", type=options.FILE)
@click.option("--out", type=options.FILE, help="Of a mesh: page to write (default: MESH-view.html).")
@click.option("--open/--no-open", "show", default=True, help="Whether to open the page in the browser.")
@options.progress_options
def view(place: Path, out: Path | None, show: bool, quiet: bool, verbose: bool) -> None:
    """Look at a mesh, or turn the surfaces of a finished run by sliders.

    RUN is the folder of a run, or the one beside a deflected mesh: its report is opened. MESH is any mesh: click its
    patches for their names, and for a hinge. Pages are files; they ask no network for anything.
    """
    from sdm_deflect.cases.run.output import check_installed

    with options.watch(quiet, verbose) as watch, watch.stage("page") as progress:
        if place.is_dir() and not (place / "constant").is_dir():
            from sdm_deflect.cases.finished import read_run

            page = place / "report.html"
            if out:
                raise InputError(f"--out {out} is of a mesh; {place} has its page")
            if not page.exists():
                run = read_run(place)
                check_installed("report")
                run.report()
        else:
            check_installed("report")
            from sdm_deflect.cases.api import read
            from sdm_deflect.cases.report.mesh_page import write_mesh_page
            from sdm_deflect.meshing.formats.registry import ending

            page = out or place.with_name(f"{place.name.removesuffix(ending(place))}-view.html")
            write_mesh_page(read(place, progress), page)
    click.echo(page)
    if show:
        webbrowser.open(page.resolve().as_uri())


@click.command()
@click.argument("place", metavar="RUN|PLAN", type=options.FILE)
@click.option("--format", "form", type=options.FORMATS, required=True, help="Format of the flow solver.")
@click.option("--which", default="deflected", show_default=True, type=click.Choice(("deflected", "undeflected")))
@click.option("--out", type=options.FILE, help="File to write, for OpenFOAM a new folder (default: beside RUN).")
@options.progress_options
def export(place: Path, form: str, which: str, out: Path | None, quiet: bool, verbose: bool) -> None:
    """Write the mesh of a finished run in another format, or a plan.

    PLAN is a file of sdm deflect --plan; it becomes fields in an OpenFOAM case, for the motion solver in
    solvers/openfoam: sdm export flap.npz --format openfoam --out CASE
    """
    if place.suffix == ".npz":
        from sdm_deflect.cases.run.apply import plan_to_case

        if form != "openfoam" or out is None:
            raise InputError(f"{place}: a plan becomes fields of a case: give --format openfoam, and the case in --out")
        with options.watch(quiet, verbose) as watch, watch.stage("export") as progress:
            files = plan_to_case(place, out, progress)
        click.echo("\n".join(map(str, files)))
        return
    from sdm_deflect.cases.finished import export_run, read_run

    with options.watch(quiet, verbose) as watch, watch.stage("export") as progress:
        target, lost = export_run(read_run(place), form, which, out, progress)
    for sentence in lost:
        click.echo(f"{target}: {sentence}", err=True)
    click.echo(f"{target}")
