"""The command line `sdm`."""

import sys
from pathlib import Path
from signal import SIGTERM, default_int_handler, signal
from typing import Any, NoReturn

import click
from rich.console import Console

from sdm_deflect.cases.cli_deflect import deflect
from sdm_deflect.cases.cli_doctor import doctor
from sdm_deflect.cases.cli_export import export
from sdm_deflect.cases.cli_report import report
from sdm_deflect.cases.cli_study import study
from sdm_deflect.cases.cli_view import view

FAILED, UNUSABLE, INTERRUPTED = 1, 2, 130
FILE = click.Path(path_type=Path)

angle_option = click.option("--angle", type=float, help="Deflection in degrees; positive is trailing edge down.")
set_option = click.option("--set", "assignments", multiple=True, metavar="KEY=VALUE", help="Replace a parameter.")


@click.group()
@click.version_option(package_name="sdm-deflect")
def cli() -> None:
    """Deflect aircraft control surfaces in CFD meshes, and check the result against CAD."""


@cli.command("list")
def list_cases() -> None:
    """List the cases with their default angle."""
    from sdm_deflect.cases.registry import CASES

    for case in CASES.values():
        print(f"{case.name:<18}{case.angle:+6.1f} deg  {case.title}")


@cli.command()
@click.argument("case", default="")
@click.option("--scale", help="small (default), medium or paper.")
@angle_option
@click.option("--strategy", help="squv (centres per direction) or mv (common centres).")
@click.option("--out", type=FILE, help="Output folder (default runs/CASE).")
@set_option
@click.option("--config", type=FILE, help="Repeat a run from its case.toml.")
@click.option("--cache/--no-cache", default=True, help="Whether to use the mesh cache.")
@click.option("--json", "as_json", is_flag=True, help="Print metrics.json instead of the table.")
@click.option("--quiet", is_flag=True, help="No progress bars.")
@click.option("--verbose", is_flag=True, help="Progress as lines instead of bars: all that is reported.")
def run(case: str, out: Path | None, cache: bool, as_json: bool, quiet: bool, verbose: bool, **given: Any) -> int:
    """Run a case: geometry, mesh, deformation, validation, report."""
    from sdm_deflect.cases.settings import resolve

    resolved = resolve(case, **given)

    from sdm_deflect.cases.console import console, summary
    from sdm_deflect.cases.output import output_folder
    from sdm_deflect.cases.pipeline import run_case
    from sdm_deflect.cases.progress import Stopwatch, shown

    folder = out or Path("runs") / resolved.name
    bars = shown(Console(stderr=True), quiet=quiet or (as_json and not verbose), verbose=verbose)
    with output_folder(folder) as scratch, bars as display:
        result = run_case(resolved, Stopwatch(display), scratch, cache)
    if as_json:
        print((folder / "metrics.json").read_text(encoding="utf-8"), end="")
    else:
        console().print(summary(result, folder))
    return 0 if result.passed else FAILED


@cli.command()
@click.option("--out", type=FILE, required=True, help="File to write: .step, .brep or .stl.")
@click.option("--case", default="aileron", show_default=True, help="Case whose aircraft is built.")
@angle_option
@set_option
def geometry(out: Path, case: str, angle: float | None, assignments: tuple[str, ...]) -> None:
    """Write the CAD alone, deflected by --angle (default 0)."""
    from sdm_deflect.cases.errors import InputError
    from sdm_deflect.cases.settings import resolve

    resolved = resolve(case, angle=angle or 0.0, assignments=assignments)
    if out.suffix not in (".step", ".brep", ".stl"):
        raise InputError(f"--out {out}: the suffix must be .step, .brep or .stl")

    from sdm_deflect.cases.cad import deflected_cad, undeflected_cad

    with Console(stderr=True).status("building the CAD"):
        model = deflected_cad(resolved) if resolved.angle else undeflected_cad(resolved)
        try:
            model.write(out)
        except OSError as error:
            raise InputError(f"--out {out}: {error.strerror}") from None
    print(f"{out}: {len(model.faces)} faces, {len(model.edges)} edges")


@cli.command()
@click.argument("folder", type=FILE)
def validate(folder: Path) -> int:
    """Repeat the validation of a finished run from its files."""
    from sdm_deflect.cases.console import console, verdict
    from sdm_deflect.cases.finished import validate_folder

    with Console(stderr=True).status("building the deflected CAD"):
        checks = validate_folder(folder)
    console().print(verdict(checks, str(folder)))
    return 0 if all(check.passed for check in checks) else FAILED


@cli.command()
@click.argument("case")
@click.option("--scale", default="small", show_default=True, help="small, medium or paper.")
@click.option("--quality", "threshold", default=0.2, show_default=True, help="Smallest acceptable mean ratio.")
@click.option("--resolution", default=1.0, show_default=True, help="Degrees to which the limit is found.")
@click.option("--out", type=FILE, help="Output folder (default runs/CASE-limit).")
@set_option
def limit(case: str, scale: str, threshold: float, resolution: float, out: Path | None, **given: Any) -> None:
    """Find the largest angle of each sign that inverts no cell and keeps a quality, by bisection."""
    from sdm_deflect.cases.errors import InputError
    from sdm_deflect.cases.settings import resolve

    resolved = resolve(case, scale, **given)
    for name, value, high in (("quality", threshold, 1.0), ("resolution", resolution, 30.0)):
        if not 0.0 < value < high:
            raise InputError(f"--{name} {value:g} must be between 0 and {high:g}")

    from sdm_deflect.cases.console import console
    from sdm_deflect.cases.limit import find_limits, write_limits
    from sdm_deflect.cases.output import output_folder
    from sdm_deflect.cases.pipeline import meshed
    from sdm_deflect.cases.progress import Bars, Stopwatch

    folder = out or Path("runs") / f"{resolved.name}-limit"
    with output_folder(folder) as scratch, Bars(Console(stderr=True)) as bars:
        watch = Stopwatch(bars)
        mesh, _ = meshed(resolved, watch)
        with watch.stage("bisection") as report:
            limits = find_limits(resolved, mesh, threshold, resolution, report)
        table = write_limits(limits, resolved, threshold, scratch)
    console().print(table)


@cli.command()
@click.argument("mesh", type=FILE)
def quality(mesh: Path) -> None:
    """Print points, cells, patches, quality and inverted cells of a mesh file."""
    from sdm_deflect.cases.inspection import inspect

    print(inspect(mesh))


@cli.command()
@click.option("--clear", is_flag=True, help="Delete the cached meshes.")
def cache(clear: bool) -> None:
    """Show where meshes are cached and how much they take."""
    from sdm_deflect.meshing.cache import MeshCache, default_folder

    store = MeshCache(default_folder())
    if clear:
        print(f"{store.folder}: freed {store.clear() / 1e6:.1f} MB")
    else:
        sizes = store.entries().values()
        print(f"{store.folder}: {len(sizes)} meshes, {sum(sizes) / 1e6:.1f} MB")


cli.add_command(deflect)
cli.add_command(doctor)
cli.add_command(report)
cli.add_command(export)
cli.add_command(study)
cli.add_command(view)


def main() -> NoReturn:
    """Entry point: one line on stderr and a code that tells what went wrong; never a traceback for a mistake."""
    from sdm_deflect.cases.errors import is_reported

    signal(SIGTERM, default_int_handler)  # batch systems and service managers ask to end like this
    try:
        code = cli(standalone_mode=False) or 0
    except click.exceptions.NoArgsIsHelpError as error:
        print(error.format_message())
        code = UNUSABLE
    except click.ClickException as error:
        code = _complain(error.format_message())
    except (KeyboardInterrupt, click.Abort):
        print("interrupted; earlier results are as they were", file=sys.stderr)
        code = INTERRUPTED
    except Exception as error:
        if not is_reported(error):
            raise
        code = _complain(str(error))
    sys.exit(code)


def _complain(message: str) -> int:
    print("sdm: " + " ".join(message.split()), file=sys.stderr)
    return UNUSABLE
