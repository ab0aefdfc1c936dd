"""Commands on any mesh file: deflect, quality."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from sdm_deflect.cases.cli import options

if TYPE_CHECKING:
    from sdm_deflect.cases.flow.flow_case import FlowCase

CASE = ("to_solver", "mach", "alpha", "far_field")
"""Options of a case for a flow solver."""
IDLE_IN_TIME = ("angle", "angles", "sensitivity", "workers", "scheduler", "worker_memory", *CASE)
"""Options that mean nothing beside a history."""


@click.command(cls=options.WithHinge)
@click.argument("mesh", type=options.FILE)
@options.select_option
@click.option(
    "--surface",
    "patches",
    multiple=True,
    metavar="NAME",
    help="Patches that move; repeat, or use commas. wall#2: a part.",
)
@click.option(
    "--hinge", nargs=2, type=options.Point(), metavar="x0,y0,z0 x1,y1,z1", help="Two points of the hinge line; or x,y."
)
@click.option("--angle", type=float, help="Degrees, right-handed from the first hinge point to the second.")
@click.option("--angles", metavar="A:B:STEP", help="Many angles, one file each; or a list with commas.")
@click.option("--history", type=options.FILE, help="Many times: a .csv of time,angle; an OpenFOAM case that moves.")
@click.option("--motion", type=click.Choice(("rigid", "blended")), help="Whole surface, or hinge to trailing edge.")
@click.option("--held", help="blended: nodes that stay: patches, or a .txt of node indices (default: --fixed).")
@click.option("--driven", help="blended: nodes that follow: edges[:DEG], patches, or a .txt (default: edges:40).")
@click.option("--strip", type=float, help="blended: width beside a closed rib, as a share of the span (0.2).")
@click.option("--table", help="Displacements instead of a hinge: .csv of x,y,z,dx,dy,dz, or .npz.")
@click.option("--cpacs", metavar="FILE", help="CPACS file with the hinge line and the angle of --device.")
@click.option("--device", metavar="UID[=STEP]", help="Trailing edge device of --cpacs; a step of its path.")
@click.option("--fixed", multiple=True, metavar="NAME", help="Patches that stay; wildcards such as 'wing*'.")
@click.option("--slide", multiple=True, metavar="NAME:plane|cylinder|surface", help="Patches that stay on their shape.")
@click.option("--periodic", nargs=2, multiple=True, metavar="NAME NAME", help="Patches that are images; repeat.")
@click.option("--zone", "zones", multiple=True, metavar="NAME", help="Further zones that deform; '*' for all.")
@click.option("--box", metavar="auto|FILE", help="The box: auto, or a .toml with `corners`.")
@click.option("--margin", type=float, help="Distance from the surface to an automatic box.")
@click.option("--steps", metavar="auto|N", help="Most steps for an angle (auto: up to 8).")
@click.option("--strategy", type=options.STRATEGIES, help="squv: centres for each direction; mv: common ones.")
@click.option("--tolerance", type=float, help="Error at a data site (default: 1 % of the surface's median edge).")
@click.option("--allow-inverted", is_flag=True, default=None, help="Take a mesh that has inverted cells already.")
@click.option("--min-quality", type=float, help="Share of its least quality that a type of cell must keep (0.1).")
@options.repair_option
@options.set_option
@click.option("--config", type=options.FILE, help="The same in a TOML file; several surfaces as [[surface]].")
@click.option("--out", type=options.FILE, help="File to write (default: MESH-deflected); the suffix says the format.")
@options.flow_options
@click.option("--sensitivity", is_flag=True, help="Also write d(points)/d(angle), as .npz and .vtu.")
@click.option("--dry-run", is_flag=True, help="Print what would be done, and write nothing.")
@click.option("--workers", type=int, metavar="N", help="Let so many processes do the work, with Dask.")
@click.option("--scheduler", metavar="ADDRESS|FILE", help="Let the workers of a Dask scheduler do it: tcp://HOST:PORT.")
@click.option("--worker-memory", metavar="SIZE", help="Memory of each of the --workers, such as 2GB.")
@options.report_option
@options.json_option
@options.progress_options
def deflect(mesh: Path, out: Path | None, sensitivity: bool, dry_run: bool, report: bool, **given: Any) -> int:
    """Deflect marked surfaces of a mesh file, and let the mesh around them follow.

    sdm deflect wing.su2 --surface flap --fixed wing --hinge 0.7,0,0 0.7,1,0 --angle 10 --motion blended
    """
    from sdm_deflect.cases.cli.console import plan_table, result_table
    from sdm_deflect.cases.run.cluster import Wanted, workers
    from sdm_deflect.cases.run.deflect_file import deflect_file, figures, plan_figures, planned
    from sdm_deflect.cases.run.mesh_files import Targets, inputs_of
    from sdm_deflect.cases.settings.job_settings import angles_of, job_settings

    if history := given.pop("history"):
        return _in_time(mesh, out, history, dry_run, {**given, "sensitivity": sensitivity})
    text, as_json = given.pop("angles"), given.pop("as_json")
    quiet, verbose = given.pop("quiet"), given.pop("verbose")
    helpers = Wanted(*(given.pop(name) for name in ("workers", "scheduler", "worker_memory")))
    flow = _flow([given.pop(name) for name in CASE])
    many = angles_of(text) if text else ()
    if many:
        given["angle"] = max(many, key=abs)
    nested, config = _tables(given), given["config"]
    settings = job_settings(nested)
    job = settings.job()
    wanted = Targets.of(mesh, out, many or (job.angle,), sensitivity, report, flow)
    wanted.check((*inputs_of(nested, Path()), *([config] if config else ())))
    with (
        options.watched(quiet or (as_json and not verbose), verbose) as watch,
        workers(helpers, watch, mesh, wanted.out.absolute().parent) as runner,
    ):
        if dry_run:
            plan = planned(wanted, job, watch, runner)
        else:
            done = deflect_file(wanted, job, watch, settings.min_quality, runner)
    if dry_run:
        case = [flow.text(plan)] if flow else []
        meshes = map(wanted.mesh, wanted.angles)
        names = [str(path) for path in (*meshes, *wanted.configurations, *wanted.extra, *wanted.reports)]
        figured = {**plan_figures(plan, flow), "files": names}
        options.print_either(as_json, figured, plan_table(plan), *case, f"would write {', '.join(names)}")
        return 0
    options.print_either(as_json, figures(done, watch), result_table(done))
    return options.code_of(done.passed)


@click.command()
@click.argument("mesh", type=options.FILE)
@options.select_option
@options.json_option
def quality(mesh: Path, select: tuple[str, ...], as_json: bool) -> None:
    """Print points, cells, patches with their connected components, quality and inverted cells of a mesh file."""
    from sdm_deflect.cases.run.inspection import inspect, inspected
    from sdm_deflect.cases.settings.selections import selections_of

    if as_json:
        options.print_json(inspected(mesh, selections_of(select)))
    else:
        click.echo(inspect(mesh, selections_of(select)))


def _in_time(mesh: Path, out: Path | None, path: Path, dry_run: bool, given: dict[str, Any]) -> int:
    """Deflect to the angle of each time of a history."""
    from sdm_deflect.cases.cli.console import plan_table, result_table
    from sdm_deflect.cases.run.deflect_file import plan_figures, planned
    from sdm_deflect.cases.run.history import History, deflect_in_time, target_of
    from sdm_deflect.cases.run.mesh_files import inputs_of
    from sdm_deflect.cases.settings.job_settings import job_settings

    _check_alone(given)
    history, as_json = History.read(path), given.pop("as_json")
    quiet, verbose = given.pop("quiet"), given.pop("verbose")
    nested, config = _tables({**given, "angle": history.largest}), given["config"]
    settings = job_settings(nested)
    job, wanted = settings.job(), target_of(mesh, out, history)
    wanted.check((path, *inputs_of(nested, Path()), *([config] if config else ())))
    with options.watched(quiet or (as_json and not verbose), verbose) as watch:
        if dry_run:
            plan = planned(wanted, job, watch, angles=history.distinct)
        else:
            done = deflect_in_time(wanted, job, history, watch, settings.min_quality)
    if dry_run:
        figured = {**plan_figures(plan), "files": [str(wanted.out)]}
        options.print_either(as_json, figured, plan_table(plan), f"would write {wanted.out}")
        return 0
    options.print_either(as_json, done.figures(watch), result_table(done.outcome))
    return options.code_of(done.passed)


def _flow(given: list[Any]) -> "FlowCase | None":
    """Return the case for a flow solver that is asked for; what writes it is loaded if there is one."""
    if all(value in (None, ()) for value in given):
        return None
    from sdm_deflect.cases.flow.flow_case import FlowCase

    return FlowCase.of(*given)


def _check_alone(given: dict[str, Any]) -> None:
    """Refuse options that a history has no use for, and leave them out."""
    from sdm_deflect.deform.base.errors import InputError

    for name in IDLE_IN_TIME:
        value = given.pop(name)
        if value is not None and value is not False and value != ():
            raise InputError(f"--{name.replace('_', '-')}: --history has no use for it; leave one of them out")
    here = click.get_current_context()
    if here.params["report"] and here.get_parameter_source("report") is ParameterSource.COMMANDLINE:
        raise InputError("--report: --history makes none; leave one of them out")


def _tables(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a configuration file with the options of the command line in their place."""
    from sdm_deflect.cases.settings.job_settings import periodic_of, read_job, slides_of, with_options
    from sdm_deflect.cases.settings.selections import selections_of

    own = dict(given)
    config, assignments, steps = (own.pop(name) for name in ("config", "assignments", "steps"))
    own["slide"], own["select"] = slides_of(own["slide"]), selections_of(own["select"])
    own["periodic"] = periodic_of(own["periodic"]) or None
    own["max_steps"] = None if steps in (None, "auto") else _steps(steps)
    return with_options(read_job(config) if config else {}, own, assignments)


def _steps(text: str) -> int:
    from sdm_deflect.deform.base.errors import InputError

    if not text.isascii() or not text.isdigit() or int(text) < 1:
        raise InputError(f"--steps {text}: must be auto or a whole number from 1")
    return int(text)
