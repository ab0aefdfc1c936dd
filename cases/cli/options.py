"""What the commands share: kinds of arguments, options of the same name, and how a result is printed."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from sdm_deflect.meshing.formats.known import written

if TYPE_CHECKING:
    from sdm_deflect.cases.run.progress import Stopwatch

FAILED, UNUSABLE, PIPE_CLOSED = 1, 2, 141
FILE = click.Path(path_type=Path)
SCALES = click.Choice(("small", "medium", "paper"))
STRATEGIES = click.Choice(("squv", "mv"))
REPAIRS = click.Choice(("auto", "off", "always"))
FORMATS = click.Choice(written())
SOLVERS = click.Choice(("openfoam", "su2"))

Command = Callable[..., Any]


class CaseName(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """The name of a case; a shell completes it."""

    name = "case"

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the cases whose names begin so, with their titles."""
        from sdm_deflect.cases.aircraft.registry import CASES

        return [CompletionItem(name, help=case.title) for name, case in CASES.items() if name.startswith(incomplete)]


class Point(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A point ``x,y,z``; of a plane mesh ``x,y``."""

    name = "x,y,z"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return its numbers; a next option in the place of a point is named."""
        try:
            point = tuple(float(number) for number in str(value).split(","))
        except ValueError:
            point = ()
        if len(point) not in (2, 3):
            hint = "the hinge needs two, such as 0.7,0,0 0.7,1,0; in a plane mesh one, such as 0.7,0"
            self.fail(f"{value!r} is no point: {hint}", param, ctx)
        return point


class WithHinge(click.Command):
    """A command whose ``--hinge`` takes two points, or one of a plane mesh."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Give a hinge of one point that point twice."""
        args = [word for arg in args for word in (arg.split("=", 1) if arg.startswith("--hinge=") else [arg])]
        place = args.index("--hinge") + 1 if "--hinge" in args else len(args)
        one, other = (*args[place : place + 2], "", "")[:2]
        if one.count(",") == 1 and (other.startswith("--") or "," not in other):
            args = [*args[: place + 1], one, *args[place + 1 :]]
        return super().parse_args(ctx, args)


angle_option = click.option("--angle", type=float, help="Deflection in degrees; positive is trailing edge down.")
select_option = click.option(
    "--select", multiple=True, metavar="NAME=EXPR|FILE", help="Make a part of a patch a patch, as flap=wall#2; repeat."
)
set_option = click.option("--set", "assignments", multiple=True, metavar="KEY=VALUE", help="Replace a setting; repeat.")
repair_option = click.option("--repair", type=REPAIRS, help="auto (default), off or always: whether cells are mended.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON to the standard output, nothing else.")
cache_option = click.option("--cache/--no-cache", default=True, help="Whether to use the mesh cache.")
report_option = click.option("--report/--no-report", default=True, help="Whether to make report and pictures.")
scale_option = click.option("--scale", type=SCALES, default="small", show_default=True, help="Size of the mesh.")


def flow_options(command: Command) -> Command:
    """Give a command ``--to-solver`` and what belongs to it."""
    solver = click.option("--to-solver", type=SOLVERS, help="Write a case that this flow solver can start as it is.")
    mach = click.option("--mach", type=float, help="Of --to-solver: Mach number of the free stream (0.6).")
    alpha = click.option("--alpha", type=float, help="Of --to-solver: angle of attack in degrees, nose up (0).")
    far = click.option("--far-field", multiple=True, metavar="NAME", help="Of --to-solver: a far field; repeat.")
    return solver(mach(alpha(far(command))))


def progress_options(command: Command) -> Command:
    """Give a command ``--quiet`` and ``--verbose``; its function takes both."""
    quiet = click.option("-q", "--quiet", is_flag=True, help="No progress.")
    verbose = click.option("-v", "--verbose", is_flag=True, help="Progress as lines: all that is reported.")
    return quiet(verbose(command))


@contextmanager
def watched(quiet: bool = False, verbose: bool = False) -> Iterator["Stopwatch"]:
    """Show stages on the standard error output."""
    from sdm_deflect.cases.run.progress import Stopwatch, shown

    with shown(quiet=quiet, verbose=verbose) as display:
        yield Stopwatch(display)


def print_json(value: Any) -> None:
    """Print a value as JSON; numbers that JSON does not know become null."""
    click.echo(json.dumps(_known(value), indent=2))


def print_tables(*tables: Any) -> None:
    """Print tables for a reader, and texts as they are, one below the other."""
    from sdm_deflect.cases.cli.console import console, plain

    out = console()
    for table in tables:
        out.print(plain(table) if isinstance(table, str) else table, soft_wrap=isinstance(table, str))


def print_either(as_json: bool, figures: Any, *tables: Any) -> None:
    """Print figures as JSON, or else tables for a reader."""
    if as_json:
        print_json(figures)
    else:
        print_tables(*tables)


def code_of(passed: bool) -> int:
    """Return the exit code of a verdict."""
    return 0 if passed else FAILED


def _known(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _known(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_known(item) for item in value]
    if isinstance(value, float):
        return value if isfinite(value) else None
    return str(value) if isinstance(value, Path) else value
