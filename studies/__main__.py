"""``python -m studies NAME``: the paper's tables and figures, and the flow."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from sdm_deflect.cases.cli import options
from sdm_deflect.cases.cli.commands import carry_out
from sdm_deflect.cases.run.progress import Stopwatch

TABLES = ("table1", "table2", "table3", "table4")
# Writes the files of a study into a folder, and returns what to print and whether all is as it should be.
Writer = Callable[[Path, Stopwatch], tuple[str, bool]]

out_option = click.option("--out", type=options.FILE, help="Output folder (default: runs/NAME).")
angles_option = click.option("--angles", metavar="A,B,...", help="Angles in degrees.")


def measured(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of a study that measures at a scale."""
    for option in (options.progress_options, options.json_option, options.cache_option, out_option):
        command = option(command)
    return options.scale_option(command)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def study() -> None:
    """Measure what the paper states, or the flow, and write tables and pictures."""


def _written(name: str, scale: str, out: Path | None, as_json: bool, quiet: bool, verbose: bool, write: Writer) -> int:
    """Write a study into its folder, and print its text, or its tables as JSON."""
    from sdm_deflect.cases.run.output import output_folder

    folder = out or Path("runs") / name
    with output_folder(folder, ()) as scratch, options.watch(quiet or (as_json and not verbose), verbose) as watch:
        text, passed = write(scratch, watch)
        tables = {path.stem: _rows(path) for path in sorted(scratch.rglob("*.csv"))}
    figures = {"study": name, "scale": scale, "folder": folder, "tables": tables}
    options.print_either(as_json, figures, f"{text}\nresults in {folder}")
    return options.code_of(passed)


def _table(name: str) -> click.Command:
    def command(scale: str, cache: bool, **given: Any) -> int:
        from studies.files import sizes, write_study
        from studies.measure import GROWN, run_study
        from studies.trends import off

        def write(folder: Path, watch: Stopwatch) -> tuple[str, bool]:
            result = run_study(name, scale, watch, cache)
            write_study(result, folder)
            faults = off(result.by(GROWN)) if name == "table2" else []
            return "\n".join([f"{len(result.measured)} adaptations. {sizes(result)}", *faults]), not faults

        return _written(name, scale, write=write, **given)

    return click.command(name, help=f"Measure {name} of the paper; write it as .csv and .png.")(measured(command))


for table in TABLES:
    study.add_command(_table(table))


@study.command()
@measured
def page(scale: str, cache: bool, out: Path | None, as_json: bool, quiet: bool, verbose: bool) -> int:
    """Measure all tables and figures of the paper, and write the blocks that docs/paper.md quotes of them: page.md.

    It takes hours at scale paper, and continues in its folder where it was stopped. It ends with 1 if the centres in a
    row of table 2 differ from the paper's by more than 15 %.
    """
    from studies.figures import write_page
    from studies.files import read_rows
    from studies.trends import off

    folder = out or Path("runs/page")
    with options.watch(quiet or (as_json and not verbose), verbose) as watch:
        numbers = write_page(scale, folder, watch.show, cache)
    trends, faults = numbers["trends"], off(read_rows(folder / "tables/table2.csv", "grown"))
    lines = [f"{'holds' if one['holds'] else 'does NOT hold'}: {one['table']}: {one['sentence']}\n"
             f"    paper {one['paper']}\n    here  {one['here']}" for one in trends]  # fmt: skip
    lines += [f"{sum(one['holds'] for one in trends)} of {len(trends)} trends hold", *faults, f"results in {folder}"]
    options.print_either(as_json, {"study": "page", "folder": folder, "off": faults, **numbers}, "\n".join(lines))
    return options.code_of(not faults)


@study.command()
@measured
def distances(scale: str, cache: bool, **given: Any) -> int:
    """Run the cases, and write how far their surfaces are from CAD that turned rigidly: the table of docs/cases.md."""
    from studies.distances import write_distances

    def write(folder: Path, watch: Stopwatch) -> tuple[str, bool]:
        return write_distances(scale, folder, watch, cache), True

    return _written("distances", scale, write=write, **given)


@study.command()
@measured
def limits(scale: str, cache: bool, **given: Any) -> int:
    """Find how far aileron, rudder and tail can turn: the limits that README and the guide quote."""
    from studies.limits import write_limits

    def write(folder: Path, watch: Stopwatch) -> tuple[str, bool]:
        return write_limits(scale, folder, watch, cache), True

    return _written("limits", scale, write=write, **given)


@study.command()
@out_option
@options.json_option
@options.progress_options
def flap(**given: Any) -> int:
    """Compare the forces on a blended flap with those on a rigid one, for docs/flow.md."""
    from studies.flap import write_flap

    def write(folder: Path, watch: Stopwatch) -> tuple[str, bool]:
        return write_flap(folder), True

    return _written("flap", "", write=write, **given)


@study.command()
@click.option("--case", type=options.CaseName(), default="aileron", help="The case.")
@angles_option
@click.option("--mach", type=float, help="Mach number of the free stream (0.6).")
@click.option("--alpha", type=float, help="Angle of attack in degrees (0).")
@click.option("--fresh", type=int, help="Meshes made around the deflected CAD, and as many undeflected ones (3).")
@click.option("--iterations", type=int, help="Iterations of each flow (3000); more continue it.")
@options.set_option
@options.scale_option
@out_option
@options.json_option
@options.progress_options
def flow(case: str, angles: str | None, scale: str, assignments: tuple[str, ...], **given: Any) -> int:
    """Compute the flow on the deflected mesh and on new meshes of the deflected CAD, with OpenFOAM; compare forces.

    New meshes are made at the first angle. It takes hours, and continues in its folder where it was stopped.
    """
    from sdm_deflect.cases.aircraft.registry import resolve
    from sdm_deflect.cases.settings.job_settings import angles_of
    from studies.flow.members import study_of
    from studies.flow.setup import FreeStream

    out, as_json, quiet, verbose = (given.pop(name) for name in ("out", "as_json", "quiet", "verbose"))
    given = {key: value for key, value in given.items() if value is not None}
    stream = FreeStream(**{name: given.pop(name) for name in ("mach", "alpha") if name in given})
    resolved = resolve(case, scale, assignments=assignments)
    wanted = study_of(resolved, angles_of(angles) if angles else (), stream, **given)

    from studies.flow.page import figures_of, write_results
    from studies.flow.solve import carried_out

    folder = out or Path("runs") / f"flow-{wanted.case.name}"
    with options.watch(quiet or (as_json and not verbose), verbose) as watch:
        members = carried_out(wanted, folder, watch)
        results, text = write_results(wanted, members, folder)
    options.print_either(as_json, figures_of(results), f"{text}\nresults in {folder}")
    return options.code_of(results.passed)


@study.command()
@click.argument("mesh", type=options.FILE)
@click.argument("out", type=options.FILE)
@click.option("--mach", type=float, default=0.6, show_default=True, help="Mach number of the free stream.")
@click.option("--alpha", type=float, default=0.0, show_default=True, help="Angle of attack in degrees, nose up.")
@click.option("--far-field", multiple=True, metavar="NAME", help="A patch that is far field, or a wildcard; repeat.")
@click.option("--hinge", type=(str, str, str), multiple=True, metavar="PATCH X,Y,Z X,Y,Z",
              help="Report the moment of a patch about a line; repeat.")  # fmt: skip
def case(mesh: Path, out: Path, mach: float, alpha: float, far_field: tuple[str, ...], hinge: Any) -> None:
    """Write a mesh, deflected or not, as a case that OpenFOAM (a folder) or SU2 (OUT.su2) starts as it is."""
    from sdm_deflect.cases.settings.spellings import points_of
    from sdm_deflect.meshing.formats.registry import read
    from studies.flow.case import write_flow
    from studies.flow.setup import FreeStream, Hinge, Setup, kinds_of

    given, hinges = read(mesh), [Hinge.through(patch, [patch], points_of(points)) for patch, *points in hinge]
    kinds = kinds_of(given, far_field, [one.name for one in hinges])
    for sentence in write_flow(given, out, Setup(FreeStream(mach, alpha), tuple(hinges), kinds=kinds)):
        click.echo(f"{out}: {sentence}", err=True)
    click.echo(f"{out}")


def _rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a .csv by their headings, numbers as numbers."""
    with path.open(newline="", encoding="utf-8") as file:
        return [{key: _number(text) for key, text in row.items()} for row in csv.DictReader(file)]


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


if __name__ == "__main__":
    carry_out(study, "python -m studies")
