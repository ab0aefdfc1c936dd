"""The command `sdm doctor`: whether this machine is fit, and if not, what would help."""

import json
from dataclasses import asdict

import click
from rich.console import Console


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print the findings for a machine.")
def doctor(as_json: bool) -> int:
    """Check libraries, graphics, threads, cache, disk and memory, and say what to install."""
    from sdm_deflect.cases.console import console, findings
    from sdm_deflect.cases.doctor import examined

    with Console(stderr=True).status("looking"):
        found = list(examined())
    if as_json:
        click.echo(json.dumps([asdict(one) for one in found], indent=2))
    else:
        console().print(findings(found))
    return 0 if all(one.well for one in found) else 1
