"""The command `sdm export`: a run's mesh in a flow solver's format."""

from pathlib import Path

import click
from rich.console import Console

FILE = click.Path(path_type=Path)


@click.command()
@click.argument("run", type=FILE)
@click.option("--format", "form", required=True, help="su2, cgns, gmsh, vtu or openfoam.")
@click.option("--which", default="deflected", show_default=True, help="deflected or undeflected.")
@click.option("--out", type=FILE, help="File to write, for OpenFOAM a new folder (default: beside RUN).")
def export(run: Path, form: str, which: str, out: Path | None) -> None:
    """Write a finished run's mesh in a flow solver's format, boundary names included."""
    from sdm_deflect.cases.errors import InputError
    from sdm_deflect.cases.export import WHICH, export_run
    from sdm_deflect.meshing.formats.registry import FORMATS

    for name, value, possible in (("format", form, tuple(FORMATS)), ("which", which, WHICH)):
        if value not in possible:
            raise InputError(f"--{name} {value} is not one of {', '.join(possible)}")
    with Console(stderr=True).status("") as status:
        target, lost = export_run(run, form, which, out, lambda text, _: status.update(text))
    for sentence in lost:
        click.echo(f"{target}: {sentence}", err=True)
    click.echo(f"{target}")
