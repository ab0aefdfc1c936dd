"""The commands of `sdm`; each imports what it needs when it is carried out."""

import gc
import os
import sys
from contextlib import suppress
from dataclasses import asdict
from io import TextIOWrapper
from itertools import chain
from pathlib import Path
from typing import NoReturn, TextIO

import click

from . import options
from .deflect import apply, convert, deflect, example, gradient, limit, quality
from .run import compare, export, geometry, list_cases, report, run, validate, view

# Number of new objects before a garbage collection: libraries create many while loading, and all stay.
OBJECTS = 100_000
# Largest number of letters of a path in a message.
LONGEST = 200


class InOrder(click.Group):
    """A group whose help lists commands by subject, in the order of use."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one section for each subject; a command without one is hidden."""
        for subject, commands in SUBJECTS.items():
            with formatter.section(subject):
                formatter.write_dl([(str(command.name), command.get_short_help_str(80)) for command in commands])


@click.group(cls=InOrder, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="sdm-deflect")
def cli() -> None:
    """Deflect control surfaces in CFD meshes, and check the result."""


@click.command()
@click.option("--clear", is_flag=True, help="Delete the cached meshes and compiled code.")
@options.json_option
def cache(clear: bool, as_json: bool) -> None:
    """Show or clear the cached meshes and compiled code."""
    from sdm_deflect.base.compiled import default_folder
    from sdm_deflect.meshing.cache import MeshCache, clear_code, code_bytes

    store = MeshCache(default_folder())
    freed = store.clear() + clear_code() if clear else 0
    sizes, code = store.entries().values(), code_bytes()
    if as_json:
        figures = {"meshes": len(sizes), "bytes": sum(sizes), "code_bytes": code, "freed_bytes": freed}
        options.print_json({"folder": store.folder, **figures})
    elif clear:
        click.echo(f"{store.folder}: freed {freed / 1e6:.1f} MB")
    else:
        meshes = f"{len(sizes)} meshes, {sum(sizes) / 1e6:.1f} MB"
        click.echo(f"{store.folder}: {meshes}; compiled code, {code / 1e6:.1f} MB")


@click.command()
@click.argument("folder", type=options.FILE, default=Path())
@options.json_option
@options.progress_options
def doctor(folder: Path, as_json: bool, quiet: bool, verbose: bool) -> int:
    """Check this machine, and remove what killed commands left.

    They are looked for in FOLDER or here. It says what is missing. Hidden folders of commands that run, and those of
    other users, stay.
    """
    from .console import findings
    from .examination import EXAMINATIONS, leftovers

    results = []
    with options.watch(quiet, verbose) as watch, watch.stage("doctor") as progress:
        for i, examine in enumerate(EXAMINATIONS):
            progress(examine.__name__, i / len(EXAMINATIONS))
            results.append(examine())
        results.append(leftovers(folder))
    options.print_either(as_json, [asdict(result) for result in results], findings(results))
    return options.code_of(all(result.well for result in results))


@click.command()
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")))
def completion(shell: str) -> None:
    """Print a script that completes commands in a shell.

    bash: eval "$(sdm completion bash)"
    """
    from click.shell_completion import get_completion_class

    script = get_completion_class(shell)
    assert script
    click.echo(script(cli, {}, "sdm", "_SDM_COMPLETE").source())


@click.command(name="help")
@click.argument("topic", type=click.Choice(tuple(options.TOPICS)))
def help_on(topic: str) -> None:
    """Explain the words of sdm deflect that its own help leaves out.

    For example: sdm help blended
    """
    with click.Context(deflect, info_name="sdm deflect") as ctx:
        click.echo(deflect.topic(ctx, options.TOPICS[topic]))


# The commands that the help lists.
SUBJECTS = {
    "Your mesh": (example, quality, deflect, limit, apply, gradient, view, convert),
    "The SDM, an aircraft": (list_cases, run, geometry, validate),
    "Results": (report, compare, export),
    "This machine": (doctor, cache, completion, help_on),
}
for command in chain.from_iterable(SUBJECTS.values()):
    cli.add_command(command)


def carry_out(commands: click.Command = cli, name: str = "sdm") -> NoReturn:
    """Carry out a command; a user's mistake is one line on stderr and an exit code, without a traceback."""
    gc.set_threshold(OBJECTS)
    try:
        code = _carried_out(commands, name)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        code = options.UNUSABLE
    except click.ClickException as error:
        code = _complain(error.format_message())
    except ModuleNotFoundError as error:
        from sdm_deflect.cases.run.output import missing

        if not (sentence := missing(error)):
            raise
        code = _complain(sentence)
    except (ValueError, RuntimeError) as error:
        from sdm_deflect.base.errors import LostError
        from sdm_deflect.cases.errors import is_reported

        if not is_reported(error):
            raise
        code = _complain(str(error))
        code = options.FAILED if isinstance(error, LostError) else code
    sys.exit(code)


def _carried_out(commands: click.Command, name: str) -> int:
    _prepare(sys.stdout)
    try:
        code: int = commands(prog_name=name, standalone_mode=False) or 0
        if sys.stdout:
            sys.stdout.flush()
    except SystemExit as end:  # with 1: click's answer if whoever reads the standard output has read enough
        return options.PIPE_CLOSED if end.code == options.FAILED else int(end.code or 0)
    except OSError as error:
        if not error.filename:
            _drop(sys.stdout)
        if isinstance(error, BrokenPipeError):
            return options.PIPE_CLOSED
        where = str(error.filename)[:LONGEST] if error.filename else "standard output"
        return _complain(f"{where}: {error.strerror or error}")
    return code


def _prepare(out: TextIO | None) -> None:
    """Let an output escape letters that its encoding lacks; ClickException if the working folder does not exist."""
    if isinstance(out, TextIOWrapper):
        out.reconfigure(errors="backslashreplace")
    try:
        Path.cwd()
    except FileNotFoundError:
        raise click.ClickException("the working folder does not exist any more: change to another one") from None


def _drop(out: TextIO | None) -> None:
    """Redirect an output to the null device, so that flushing it at exit cannot fail."""
    with suppress(OSError, ValueError):
        if out:
            os.dup2(os.open(os.devnull, os.O_WRONLY), out.fileno())


def _complain(message: str) -> int:
    from sdm_deflect.base.errors import printable

    click.echo("sdm: " + printable(" ".join(message.split())), err=True)
    return options.UNUSABLE
