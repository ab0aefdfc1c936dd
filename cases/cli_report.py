"""The command `sdm report`: the page of a finished run, made anew."""

from pathlib import Path

import click
from rich.console import Console


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
def report(folder: Path) -> int:
    """Make report.html and figures/ of a finished run anew from its files."""
    from sdm_deflect.cases.output import output_folder
    from sdm_deflect.cases.report.data import report_data_of_folder
    from sdm_deflect.cases.report.page import write_report
    from sdm_deflect.cases.report.pictures import drawn

    with Console(stderr=True).status("validating again"):
        data = report_data_of_folder(folder)
    with Console(stderr=True).status("drawing"), output_folder(folder) as scratch:
        write_report(data, drawn(data, scratch / "figures"), scratch)
    click.echo(f"{folder / 'report.html'}: {(folder / 'report.html').stat().st_size / 1e6:.1f} MB")
    return 0 if data.passed else 1
