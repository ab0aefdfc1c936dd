"""Stages of a run: who reports progress, who shows it, and how long each stage took."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isnan
from time import perf_counter
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

Report = Callable[[str, float], None]
"""Called by a library with what it is doing and the fraction done (nan when that is unknown)."""


class Display(Protocol):
    """Shows the stages of a run."""

    def begin(self, stage: str) -> Report:
        """Announce a stage; the returned callable takes its progress."""
        ...

    def end(self, stage: str, seconds: float) -> None:
        """Announce that a stage is over."""
        ...


class Silent:
    """Shows nothing."""

    def begin(self, stage: str) -> Report:
        """Return a callable that ignores what it is told."""
        return lambda text, fraction: None

    def end(self, stage: str, seconds: float) -> None:
        """Ignore the end of a stage."""


@dataclass(slots=True)
class Lines:
    """One line for everything that a stage reports, with the seconds since it began."""

    console: Console

    def begin(self, stage: str) -> Report:
        """Announce a stage."""
        self._line(stage, 0.0, "begins")
        start = perf_counter()
        return lambda text, fraction: self._line(stage, perf_counter() - start, text)

    def end(self, stage: str, seconds: float) -> None:
        """Announce that a stage is over."""
        self._line(stage, seconds, "ends")

    def _line(self, stage: str, seconds: float, text: str) -> None:
        self.console.print(Text(f"{stage:<12} {seconds:8.2f} s  {text}"), soft_wrap=True)


@dataclass(slots=True)
class Bars:
    """One rich progress bar per stage with elapsed time and counts, on the given console."""

    console: Console
    _bars: Progress = field(init=False)
    _tasks: dict[str, TaskID] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self._bars = Progress(
            SpinnerColumn(),
            TextColumn("{task.fields[stage]:<12}", markup=False),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            TextColumn("{task.description}", markup=False),
            console=self.console,
        )

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bars.stop()

    def begin(self, stage: str) -> Report:
        """Add a bar for the stage."""
        task = self._bars.add_task("", total=None, stage=stage)
        self._tasks[stage] = task

        def report(text: str, fraction: float) -> None:
            known = not isnan(fraction)
            self._bars.update(
                task, description=text, total=1.0 if known else None, completed=fraction if known else 0.0
            )

        return report

    def end(self, stage: str, seconds: float) -> None:
        """Fill the bar of the stage; what it told last stays."""
        self._bars.update(self._tasks[stage], total=1.0, completed=1.0)


@contextmanager
def shown(console: Console, *, quiet: bool, verbose: bool) -> Iterator[Display]:
    """Show stages as bars on a console, or as the switches of the command line ask."""
    if quiet:
        yield Silent()
    elif verbose:
        yield Lines(console)
    else:
        with Bars(console) as bars:
            yield bars


@dataclass(slots=True)
class Stopwatch:
    """Seconds of every stage, shown on a display as they pass."""

    display: Display
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[Report]:
        """Time one stage; stages of the same name add up."""
        report, start = self.display.begin(name), perf_counter()
        yield report
        spent = perf_counter() - start
        self.seconds[name] = self.seconds.get(name, 0.0) + spent
        self.display.end(name, spent)
