"""Stages of a run: who reports progress, who shows it, and how long each stage took."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isnan, nan
from os import sysconf
from pathlib import Path
from time import CLOCK_BOOTTIME, clock_gettime, perf_counter
from typing import TYPE_CHECKING, Any, Protocol

from sdm_deflect.deform.base.errors import printable
from sdm_deflect.deform.base.progress import Progress, silent

if TYPE_CHECKING:
    from rich.console import Console


class Display(Protocol):
    """Shows the stages of a run."""

    def begin(self, stage: str) -> Progress:
        """Announce a stage; the returned callable takes its progress."""
        ...

    def end(self, stage: str, seconds: float) -> None:
        """Announce that a stage is over."""


class Silent:
    """Shows nothing."""

    def begin(self, stage: str) -> Progress:
        """Return a callable that ignores what it is told."""
        return silent

    def end(self, stage: str, seconds: float) -> None:
        """Ignore the end of a stage."""


@dataclass(frozen=True, slots=True)
class Told:
    """Hands the progress of all stages to one callable."""

    progress: Progress

    def begin(self, stage: str) -> Progress:
        """Announce a stage."""
        self.progress(stage, nan)
        return self.progress

    def end(self, stage: str, seconds: float) -> None:
        """Ignore the end of a stage."""


@dataclass(slots=True)
class Lines:
    """Lines on a console, with the seconds since a stage began: one for each stage, or one for every report of it."""

    console: "Console"
    every: bool = True
    _last: dict[str, str] = field(init=False, default_factory=dict)

    def begin(self, stage: str) -> Progress:
        """Announce a stage."""
        start = perf_counter()

        def report(text: str, fraction: float) -> None:
            self._last[stage] = text
            if self.every:
                self._line(stage, perf_counter() - start, text)

        if self.every:
            self._line(stage, 0.0, "begins")
        return report

    def end(self, stage: str, seconds: float) -> None:
        """Announce that a stage is over."""
        self._line(stage, seconds, "ends" if self.every else self._last.pop(stage, ""))

    def _line(self, stage: str, seconds: float, text: str) -> None:
        line = f"{stage:<12} {seconds:8.2f} s  {text}".rstrip()
        self.console.print(line, markup=False, highlight=False, soft_wrap=True)


@dataclass(slots=True)
class Bars:
    """One rich progress bar per stage with elapsed time and counts, on the given console."""

    console: "Console"
    bars: Any = field(init=False)
    _tasks: dict[str, Any] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        from rich import progress

        self.bars = progress.Progress(
            progress.SpinnerColumn(),
            progress.TextColumn("{task.fields[stage]:<12}", markup=False),
            progress.BarColumn(bar_width=24),
            progress.TimeElapsedColumn(),
            progress.TextColumn("{task.description}", markup=False),
            console=self.console,
        )

    def begin(self, stage: str) -> Progress:
        """Add a bar for the stage."""
        task = self._tasks[stage] = self.bars.add_task("", total=None, stage=stage)

        def report(text: str, fraction: float) -> None:
            total, completed = (None, 0.0) if isnan(fraction) else (1.0, fraction)
            self.bars.update(task, description=text, total=total, completed=completed)

        return report

    def end(self, stage: str, seconds: float) -> None:
        """Fill the bar of the stage; what it told last stays."""
        self.bars.update(self._tasks[stage], total=1.0, completed=1.0)


@contextmanager
def shown(*, quiet: bool, verbose: bool, console: "Console | None" = None) -> Iterator[Display]:
    """Show stages on a console (default: standard error) as the switches of the command line ask.

    A terminal shows a bar for each stage; a file or a pipe gets a line for each when it has ended.
    """
    from rich.console import Console

    out = console or Console(stderr=True)
    if quiet:
        yield Silent()
    elif verbose or not out.is_terminal:
        yield Lines(out, every=verbose)
    else:
        display = Bars(out)
        with display.bars:
            yield display


def process_start() -> float:
    """Return when this process started, on the clock of `perf_counter`."""
    ticks = int(Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[19])
    return perf_counter() - (clock_gettime(CLOCK_BOOTTIME) - ticks / sysconf("SC_CLK_TCK"))


@dataclass(slots=True)
class Stopwatch:
    """Seconds of every stage, shown on a display as they pass, and of all since `start` on the clock."""

    display: Display
    seconds: dict[str, float] = field(default_factory=dict)
    start: float = field(default_factory=perf_counter)

    @property
    def total(self) -> float:
        """Seconds since the start, with what lies between the stages."""
        return perf_counter() - self.start

    @contextmanager
    def stage(self, name: str) -> Iterator[Progress]:
        """Time one stage; stages of the same name add up."""
        report, start = self.display.begin(name), perf_counter()
        yield lambda text, fraction: report(printable(text), fraction)
        spent = perf_counter() - start
        self.seconds[name] = self.seconds.get(name, 0.0) + spent
        self.display.end(name, spent)
