"""The command `sdm study`: the paper's tables and figures, measured here."""

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

if TYPE_CHECKING:
    from sdm_deflect.cases.progress import Display

TABLES = ("table1", "table2", "table3", "table4")
PAGE = "page"


@click.command()
@click.argument("name", type=click.Choice([*TABLES, PAGE]))
@click.option("--scale", default="small", show_default=True, help="small, medium or paper.")
@click.option("--out", type=click.Path(path_type=Path), help="Output folder (default runs/NAME).")
@click.option("--cache/--no-cache", default=True, help="Whether to use the mesh cache.")
@click.option("--quiet", is_flag=True, help="No progress bars.")
def study(name: str, scale: str, out: Path | None, cache: bool, quiet: bool) -> None:
    """Measure a table of the paper and write it as .csv, .md and .png; page: all tables and figures."""
    from sdm_deflect.cases.errors import InputError
    from sdm_deflect.cases.output import output_folder
    from sdm_deflect.cases.progress import Bars, Silent
    from sdm_deflect.cases.registry import case_named

    try:
        case_named("aileron", scale)
    except ValueError as error:
        raise InputError(str(error)) from None
    folder = out or Path("runs") / name
    with output_folder(folder) as scratch:
        if quiet:
            text = _written(name, scale, scratch, Silent(), cache)
        else:
            with Bars(Console(stderr=True)) as bars:
                text = _written(name, scale, scratch, bars, cache)
    click.echo(f"{text}\nresults in {folder}")


def _written(name: str, scale: str, folder: Path, display: "Display", cache: bool) -> str:
    """Write the files of a study into `folder` and return its text."""
    from sdm_deflect.cases.progress import Stopwatch
    from sdm_deflect.cases.study.page import write_page
    from sdm_deflect.cases.study.study import run_study
    from sdm_deflect.cases.study.text import write_study

    if name == PAGE:
        write_page(scale, folder, display, cache)
        return (folder / "paper.md").read_text(encoding="utf-8")
    write_study(run_study(name, scale, Stopwatch(display), cache), folder)
    return (folder / f"{name}.md").read_text(encoding="utf-8")
