"""The command line `sdm`."""

import sys
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.console import Console

app = typer.Typer(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)

Set = Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Replace a parameter.")]
Angle = Annotated[float | None, typer.Option(help="Deflection in degrees; positive is trailing edge down.")]
Out = Annotated[Path | None, typer.Option(help="Output folder (default runs/CASE).")]
UNUSABLE, FAILED, INTERRUPTED = 2, 1, 130


@app.command("list")
def list_cases() -> None:
    """List the cases with their default angle."""
    from cases.registry import CASES

    for case in CASES.values():
        print(f"{case.name:<18}{case.angle:+6.1f} deg  {case.title}")


@app.command()
def run(  # noqa: PLR0913, PLR0917 - one parameter an option
    case: Annotated[str, typer.Argument(help="Name of the case (see sdm list).")] = "",
    scale: Annotated[str, typer.Option(help="small, medium or paper.")] = "small",
    angle: Angle = None,
    strategy: Annotated[str | None, typer.Option(help="squv or mv.")] = None,
    out: Out = None,
    assignments: Set = None,
    config: Annotated[Path | None, typer.Option(help="Repeat a run from its case.toml.")] = None,
    cache: Annotated[bool, typer.Option(help="Use the mesh cache.")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print metrics.json instead of the table.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress bars.")] = False,
) -> None:
    """Run a case: geometry, mesh, deformation, validation, report."""
    from cases.resolve import resolve

    resolved = resolve(case, scale, angle, strategy, assignments or [], config)

    from cases.console import summary
    from cases.output import output_folder
    from cases.pipeline import run_case
    from cases.progress import Bars, Silent, Stopwatch

    folder = out or Path("runs") / resolved.name
    with output_folder(folder) as scratch:
        if quiet or as_json:
            result = run_case(resolved, Stopwatch(Silent()), scratch, cache)
        else:
            with Bars(Console(stderr=True)) as bars:
                result = run_case(resolved, Stopwatch(bars), scratch, cache)
    if as_json:
        print((folder / "metrics.json").read_text(encoding="utf-8"), end="")
    else:
        Console().print(summary(result, folder))
    raise typer.Exit(0 if result.passed else FAILED)


@app.command()
def geometry(
    out: Annotated[Path, typer.Option(help="File to write: .step, .brep or .stl.")],
    case: Annotated[str, typer.Option(help="Case whose aircraft is built.")] = "aileron",
    angle: Angle = 0.0,
    assignments: Set = None,
) -> None:
    """Write the CAD alone, deflected by --angle."""
    from cases.errors import InputError
    from cases.resolve import resolve

    resolved = resolve(case, "small", angle, None, assignments or [], None)
    if out.suffix not in (".step", ".brep", ".stl"):
        raise InputError(f"--out {out}: the suffix must be .step, .brep or .stl")

    from cases.cad import deflected_cad

    with Console(stderr=True).status("building the CAD"):
        model = deflected_cad(resolved)
    model.write(out)
    print(f"{out}: {len(model.faces)} faces, {len(model.edges)} edges")


@app.command()
def quality(mesh: Annotated[Path, typer.Argument(help="Any mesh file that VTK or meshio reads.")]) -> None:
    """Print points, cells, patches, quality and inverted cells of a mesh file."""
    from cases.inspection import inspect

    Console().print(inspect(mesh))


@app.command("cache")
def cache_command(clear: Annotated[bool, typer.Option("--clear", help="Delete the cached meshes.")] = False) -> None:
    """Show where meshes are cached and how much they take."""
    from meshing.cache import MeshCache, default_folder

    store = MeshCache(default_folder())
    if clear:
        print(f"{store.folder}: freed {store.clear() / 1e6:.1f} MB")
    else:
        sizes = store.entries().values()
        print(f"{store.folder}: {len(sizes)} meshes, {sum(sizes) / 1e6:.1f} MB")


def main() -> NoReturn:
    """Entry point: one line on stderr and a code that tells what went wrong; never a traceback for a mistake."""
    import click

    from cases.errors import is_reported

    try:
        code = app(standalone_mode=False)
    except click.ClickException as error:
        code = _complain(error.format_message())
    except click.Abort:
        code = INTERRUPTED
    except KeyboardInterrupt:
        print("interrupted; the previous results are as they were", file=sys.stderr)
        code = INTERRUPTED
    except Exception as error:
        if not is_reported(error):
            raise
        code = _complain(str(error))
    sys.exit(code)


def _complain(message: str) -> int:
    print("sdm: " + " ".join(message.split()), file=sys.stderr)
    return UNUSABLE
