"""The command `sdm report`: the page of a finished run, made anew."""

from pathlib import Path

import click
from rich.console import Console


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
def report(folder: Path) -> int:
    """Make report.html and figures/ of a finished run anew from its files."""
    from sdm_deflect.cases.output import output_folder
    from sdm_deflect.cases.report.gallery import drawn
    from sdm_deflect.cases.report.page import write_report
    from sdm_deflect.cases.report.story import of_folder

    with Console(stderr=True).status("validating again"):
        story = of_folder(folder)
    with Console(stderr=True).status("drawing"), output_folder(folder) as scratch:
        write_report(story, drawn(story, scratch / "figures"), scratch)
    click.echo(f"{folder / 'report.html'}: {(folder / 'report.html').stat().st_size / 1e6:.1f} MB")
    return 0 if story.passed else 1
