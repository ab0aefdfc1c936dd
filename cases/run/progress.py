"""Stages of a run: progress, its display, and the time of each stage."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isnan
from pathlib import Path
from threading import Event, Thread
from time import perf_counter
from typing import TYPE_CHECKING, Any

from sdm_deflect.base.errors import printable
from sdm_deflect.base.numbers import percent
from sdm_deflect.base.threads import Progress, Stage, silent, unseen

if TYPE_CHECKING:
    from rich.console import Console


# Seconds after which a stage shows progress in a notebook, a file or a pipe.
PATIENCE = 2.0
# Seconds between further lines in a file or a pipe: an hour makes 120.
PAUSE = 30.0


def lines(console: "Console", every: bool = True) -> Stage:
    """Show stages as lines on a console, with the seconds since each began.

    A line is printed for every report; or at the beginning of a long stage, every `PAUSE` seconds, and at its end.
    """

    @contextmanager
    def stage(name: str) -> Iterator[Progress]:
        start, last, over = perf_counter(), "", Event()

        def line(text: str) -> None:
            said = f"{name:<12} {perf_counter() - start:8.2f} s  {text}".rstrip()
            console.print(said, markup=False, highlight=False, soft_wrap=True)

        def report(text: str, fraction: float) -> None:
            nonlocal last
            last = text
            if every:
                line(text)

        def wait() -> None:
            """Print a line after two seconds, and then every `PAUSE`."""
            pause = PATIENCE
            while not over.wait(pause):
                line(last or "begins")
                pause = PAUSE

        if every:
            line("begins")
        else:
            Thread(target=wait, daemon=True).start()
        try:
            yield report
        finally:
            over.set()
        line("ends" if every else last)

    return stage


@contextmanager
def live_line(console: "Console") -> Iterator[Stage]:
    """Show the current stage in one line of a terminal, with its last report and the seconds since the start."""
    from rich import progress

    columns = (
        progress.SpinnerColumn(), progress.TextColumn("{task.fields[stage]:<11}", markup=False),
        progress.TextColumn("{task.description}", markup=False), progress.TimeElapsedColumn(),
    )  # fmt: skip
    with progress.Progress(*columns, console=console, transient=True) as shown:
        task = shown.add_task("", stage="")

        @contextmanager
        def stage(name: str) -> Iterator[Progress]:
            shown.update(task, stage=name, description="")

            def report(text: str, fraction: float) -> None:
                shown.update(task, stage=name, description=text if isnan(fraction) else f"{text}, {percent(fraction)}")

            yield report

        yield stage


@contextmanager
def show_stages(*, quiet: bool, verbose: bool, console: "Console | None" = None) -> Iterator[Stage]:
    """Show stages on a console (default: standard error) by the switches of the command line.

    A terminal shows one line, which goes at the end; a file or a pipe gets a line for each when it has ended.
    """
    from rich.console import Console

    out = console or Console(stderr=True)
    if quiet:
        yield unseen
    elif verbose or not out.is_terminal:
        yield lines(out, every=verbose)
    else:
        with live_line(out) as show:
            yield show


def in_notebook() -> bool:
    """Return whether this process answers the cells of a notebook."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return type(shell).__name__ == "ZMQInteractiveShell"


def of_notebook() -> Progress:
    """Return a display of progress for notebooks, which appears after two seconds; elsewhere it shows nothing."""
    if not in_notebook():
        return silent
    from IPython.display import display

    start = perf_counter()
    shown: list[Any] = []

    def report(text: str, fraction: float) -> None:
        line = {"text/plain": printable(text) + ("" if isnan(fraction) else f" {percent(fraction)}")}
        if shown:
            shown[0].update(line, raw=True)
        elif perf_counter() - start > PATIENCE:
            shown.append(display(line, raw=True, display_id=True))  # type: ignore[no-untyped-call]

    return report


def process_start() -> float:
    """Return the start of this process on the clock of `perf_counter`; known on Linux only."""
    if not hasattr(time, "CLOCK_BOOTTIME"):
        return perf_counter()
    ticks = int(Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[19])
    return perf_counter() - (time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK"))


@dataclass(slots=True)
class Stopwatch:
    """Seconds of every stage and of all since `start`; stages are shown while they run."""

    show: Stage = unseen
    seconds: dict[str, float] = field(default_factory=dict)
    start: float = field(default_factory=perf_counter)

    @property
    def total(self) -> float:
        """Seconds since the start, the time between stages included."""
        return perf_counter() - self.start

    @contextmanager
    def stage(self, name: str) -> Iterator[Progress]:
        """Time one stage; stages of the same name add up."""
        start = perf_counter()
        with self.show(name) as report:
            yield lambda text, fraction: report(printable(text), fraction)
        self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - start
