"""Common parts of commands: types of arguments, common options, and printing of results."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import is_dataclass
from functools import partial
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_origin

import click
from click.shell_completion import CompletionItem

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.schema import GROUPS, Setting, choices_of, kind_of
from sdm_deflect.cases.settings.conversion import parse_spelling
from sdm_deflect.cases.settings.job_settings import BY_NAME
from sdm_deflect.meshing.formats.registration import writable

if TYPE_CHECKING:
    from sdm_deflect.cases.run.progress import Stopwatch

OUTPUT, CLUSTER = "Output", "Cluster"
# Exit codes: a check failed, an input is unusable, and, as in shells, the reader of the output has gone.
FAILED, UNUSABLE, PIPE_CLOSED = 1, 2, 141
FILE = click.Path(path_type=Path)
SCALES = click.Choice(("small", "medium", "paper"))
FORMATS = click.Choice(writable())

# Options of `sdm deflect` that its help shows first.
BASIC = ("patches", "fixed", "hinge", "angle", "motion", "dry_run", "out")
# Settings whose options the help of `sdm deflect` shows: those that most runs need; `sdm help` has all.
SHOWN = (
    *BASIC, "device", "down", "up", "vertical", "range", "select", "table", "to", "force", "slide", "periodic",
    "margin", "repair", "min_quality", "tolerance",
)  # fmt: skip
# What `sdm help` explains: groups of settings by their words.
TOPICS = {group.lower(): group for group in (*GROUPS[1:6], *GROUPS[7:], CLUSTER)}

Command = Callable[..., Any]


class CaseName(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """Type of an argument: the name of a case, which shells complete."""

    name = "case"

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the cases whose names begin so, with their titles."""
        from sdm_deflect.cases.aircraft.registry import CASES

        return [CompletionItem(name, help=case.title) for name, case in CASES.items() if name.startswith(incomplete)]


class Grouped(click.Option):
    """An option that help shows in a group."""

    def __init__(self, *args: Any, group: str = "Options", **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.group = group


output_option, cluster_option = (partial(click.option, cls=Grouped, group=group) for group in (OUTPUT, CLUSTER))


def settings_options(settings: Iterable[Setting]) -> list[click.Parameter]:
    """Return the options of settings; some settings have none."""
    return [_option(setting) for setting in settings if setting.option.flag is not None]


def _option(setting: Setting) -> Grouped:
    how, kind, words = setting.option, kind_of(setting.kind), choices_of(setting.kind)
    of = click.Choice(words) if words else kind if kind in (int, float) and not setting.spelling.read else str
    inner = get_args(kind)[:1]
    several = get_origin(kind) is dict or inner == (str,) or any(map(is_dataclass, inner))
    value = {"type": of, "nargs": max(1, len(how.metavar.split())), "multiple": several, "metavar": how.metavar or None}
    switch = {"is_flag": True, "default": None}
    given: dict[str, Any] = switch if kind is bool else value

    def read(ctx: click.Context, param: click.Parameter, text: Any) -> Any:
        """Parse the value first, so that its error comes before that of an unexpected argument."""
        return parse_spelling(text, setting, setting.name) if text else text

    return Grouped([flag(setting), setting.name], help=_help(setting), group=setting.doc.group, callback=read, **given)


def flag(setting: Setting) -> str:
    """Return the option of a setting, or the setting's name without one."""
    how = setting.option
    return setting.name if how.flag is None else how.flag or f"--{setting.name.replace('_', '-')}"


def _help(setting: Setting, in_full: bool = False) -> str:
    """Return a setting's meaning and default; names of settings are replaced by options."""
    words = f"{setting.doc.text} {setting.doc.more if in_full else ''}".rstrip().replace("``", "'").split("`")
    text = "".join(flag(BY_NAME[word]) if i % 2 and word in BY_NAME else word for i, word in enumerate(words))
    hidden = not setting.default or setting.default is True or not setting.default_text
    return text if hidden else f"{text.removesuffix('.')} (default: {setting.default_text})."


class DeflectCommand(click.Command):
    """A command with its options in groups, whose ``--hinge`` takes two points, or one of a plane mesh."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the basic options, then others that most runs need by group, and name the topics of the rest."""
        rows: dict[str, list[tuple[str, str]]] = {group: [] for group in ("Basic", *GROUPS, OUTPUT)}
        order = {name: i for i, name in enumerate(BASIC)}
        for option in sorted(self.get_params(ctx), key=lambda option: order.get(str(option.name), len(BASIC))):
            group = "Basic" if option.name in BASIC else getattr(option, "group", "Options")
            rare = group == CLUSTER or (option.name in BY_NAME and option.name not in SHOWN)
            record = option.get_help_record(ctx) if isinstance(option, click.Option) and not rare else None
            if record:
                rows.setdefault(group, []).append(record)
        for group, records in filter(lambda row: row[1], rows.items()):
            with formatter.section(group):
                formatter.write_dl(records)
        formatter.write_paragraph()
        formatter.write_text(f"More words: sdm help TOPIC, with {', '.join(TOPICS)}.")

    def topic(self, ctx: click.Context, group: str) -> str:
        """Return the options and settings of a group with all that their notes say."""
        formatter = ctx.make_formatter()
        records = {param.name: param.get_help_record(ctx) for param in self.get_params(ctx)}
        rows = []
        for setting in BY_NAME.values():
            if setting.doc.group == group:
                record = records.get(setting.name)
                rows.append((record[0] if record else f"--set {setting.name}=VALUE", _help(setting, in_full=True)))
        others = (
            param
            for param in self.get_params(ctx)
            if param.name not in BY_NAME and getattr(param, "group", "") == group
        )
        rows += [record for other in others if (record := records[other.name])]
        with formatter.section(group):
            formatter.write_dl(rows)
        return formatter.getvalue().rstrip("\n")

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Double a hinge of one point, and repeat ``--to`` for each of its files."""
        return super().parse_args(ctx, _to_each_file(_of_two_points(args)))


def _of_two_points(args: list[str]) -> list[str]:
    """Return words with a hinge of one point doubled; InputError for one without commas."""
    args = [word for arg in args for word in (arg.split("=", 1) if arg.startswith("--hinge=") else [arg])]
    place = args.index("--hinge") + 1 if "--hinge" in args else len(args)
    first, second = (*args[place : place + 2], "", "")[:2]
    if "," not in first and len(words := first.split()) > 1:
        raise InputError(f"--hinge {first!r}: write a point with commas, {','.join(words)}")
    if first.count(",") == 1 and (second.startswith("--") or "," not in second):
        return [*args[: place + 1], first, *args[place + 1 :]]
    return args


def _to_each_file(args: list[str]) -> list[str]:
    """Return words with ``--to`` before each of its files: all words up to the next option."""
    if any(word == "--to" and after[:1] in ("", "-") for word, after in pairwise([*args, ""])):
        raise InputError("--to: name a file with the new places of the surface's nodes")
    out, listing = list[str](), False
    for word in args:
        listing = word == "--to" or (listing and not word.startswith("-"))
        out += ["--to", word] if listing and word != "--to" and out[-1:] != ["--to"] else [word]
    return out


angle_option = click.option("--angle", type=float, help="Deflection in degrees; positive is trailing edge down.")
set_option = click.option("--set", "assignments", multiple=True, metavar="KEY=VALUE", help="Replace a setting; repeat.")
json_option = output_option("--json", "as_json", is_flag=True, help="Print JSON to the standard output, nothing else.")
cache_option = click.option("--cache/--no-cache", default=True, help="Whether to use the mesh cache.")
report_option = output_option("--report/--no-report", default=True, help="Whether to make report and pictures.")
config_option = click.option("--config", type=FILE, help="Read the case from the case.toml of a run.")
scale_option = click.option("--scale", type=SCALES, default="small", show_default=True, help="Size of the mesh.")


def progress_options(command: Command) -> Command:
    """Give a command ``--quiet`` and ``--verbose``; its function takes both."""
    quiet = output_option("-q", "--quiet", is_flag=True, help="No progress.")
    verbose = output_option("-v", "--verbose", is_flag=True, help="All figures, and progress as lines.")
    return quiet(verbose(command))


@contextmanager
def watch(quiet: bool = False, verbose: bool = False) -> Iterator["Stopwatch"]:
    """Show stages on the standard error output."""
    from sdm_deflect.cases.run.progress import Stopwatch, process_start, show_stages

    with show_stages(quiet=quiet, verbose=verbose) as display:
        yield Stopwatch(display, start=process_start())


def print_json(value: Any) -> None:
    """Print a value as JSON; numbers that JSON does not know become null."""
    click.echo(json.dumps(_known(value), indent=2))


def print_tables(*tables: Any) -> None:
    """Print tables, and texts as they are, one below the other."""
    from .console import console, plain

    out = console()
    for table in tables:
        out.print(plain(table) if isinstance(table, str) else table, soft_wrap=isinstance(table, str), crop=False)


def print_either(as_json: bool, figures: Any, *tables: Any) -> None:
    """Print figures as JSON, or else tables."""
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
