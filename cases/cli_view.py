"""The command `sdm view`: a finished run on a page that one can turn and bend."""

from pathlib import Path

import click


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port on 127.0.0.1 (default: a free one).")
@click.option("--open/--no-open", "show", default=True, help="Whether to open the page in the browser.")
def view(run: Path, port: int, show: bool) -> None:
    """Show a finished run as a page with a slider for the angle; Ctrl-C ends it.

    The mesh follows the slider with the centres of the run. Nothing leaves this machine: the page is served on
    the loopback interface and draws in the browser.
    """
    from rich.console import Console

    from sdm_deflect.cases.view.live import Live
    from sdm_deflect.cases.view.serve import check_free, serve

    if port:
        check_free(port)
    with Console(stderr=True).status("reading the run and factorising"):
        from sdm_deflect.cases.view.control import Control
        from sdm_deflect.cases.view.page import Page

        page = Page(Control.of(Live.of(run)))
    serve(page, port, show)
