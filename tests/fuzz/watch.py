"""Starts workers, notices when they die or take too long, and collects what they found."""

import json
import os
import pickle
import shutil
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import connection, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path

import click

from tests.fuzz import known
from tests.fuzz.inputs import Input
from tests.fuzz.targets import Target
from tests.fuzz.worker import CURRENT, STACK, Lines, Result, Slice, work

SLOW = 30.0
"""Seconds of processor time that an input may take; of time on the wall six times as many."""
FORK = get_context("fork")
SLICE = 20.0


@dataclass(slots=True)
class Findings:
    """What came of one target so far."""

    target: Target
    known: list[Input] = field(repr=False)
    next: int = 0
    inputs: int = 0
    seconds: float = 0.0
    slowest: float = 0.0
    peak: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    bad: dict[str, list[Result]] = field(default_factory=dict)
    seen: Lines = field(default_factory=set, repr=False)
    wall: float = 0.0

    def add(self, result: Result, guided: bool) -> None:
        """Note the result of an input."""
        self.inputs += 1
        self.seconds += result.seconds
        self.slowest, self.peak = max(self.slowest, result.seconds), max(self.peak, result.peak)
        self.kinds[result.kind] += 1
        if not result.good:
            self.bad.setdefault(f"{result.kind} {result.where}", []).append(result)
        new = set(result.new_lines) - self.seen
        self.seen |= new
        if guided and new and result.kept and result.number >= len(self.known):
            self.known.append(result.kept)

    def figures(self) -> dict[str, object]:
        """Return the figures of the target."""
        return {
            "inputs": self.inputs, "per_second": round(self.inputs / max(self.wall, 1e-9), 1),
            "kinds": dict(self.kinds),
            "slowest_s": round(self.slowest, 2), "peak_MB": round(self.peak / 1e6), "known": len(self.known),
            "findings": {key: len(results) for key, results in self.bad.items()},
        }  # fmt: skip


@dataclass(slots=True)
class Running:
    """A worker at work."""

    process: BaseProcess
    channel: connection.Connection
    findings: Findings
    slice: Slice
    folder: Path
    until: float
    at: int
    since: float
    used: float = 0.0


def seeds_of(target: Target) -> list[Input]:
    """Return the sound inputs of a target, made in a process of its own: libraries start threads."""
    with _folder() as folder:
        ours, theirs = FORK.Pipe(duplex=False)
        process = FORK.Process(target=_send_seeds, args=(theirs, target, folder))
        process.start()
        theirs.close()
        try:
            found: list[Input] = ours.recv()
        except EOFError:
            raise RuntimeError(f"the seeds of {target.name} cannot be made") from None
        finally:
            process.join()
        return found


def _send_seeds(channel: connection.Connection, target: Target, folder: Path) -> None:
    sound = list(target.seeds(folder))
    channel.send([*sound, *known.of(target.name, sound)])


class Watch:
    """Tries inputs of several targets with several workers.

    Attributes
    ----------
    found : findings by target.
    """

    def __init__(self, found: Sequence[Findings], seed: int, guided: bool, jobs: int) -> None:
        self.found, self.seed, self.guided, self.jobs = found, seed, guided, jobs
        self.running: list[Running] = []

    def for_minutes(self, minutes: float, keep: Path, report: float = 60.0) -> None:
        """Try inputs until the time is over, each target by its weight; what was found is kept now and then."""
        with _folder() as folder:
            end, told = time.monotonic() + 60.0 * minutes, time.monotonic()
            while time.monotonic() < end or self.running:
                while len(self.running) < self.jobs and time.monotonic() < end:
                    free = [one for one in self.found if not any(run.findings is one for run in self.running)]
                    chosen = min(free or self.found, key=lambda one: one.wall / one.target.weight)
                    numbers = range(chosen.next, chosen.next + 10**6)
                    self._start(chosen, numbers, folder, min(end, time.monotonic() + SLICE))
                self._wait()
                if time.monotonic() > told + report:
                    told = time.monotonic()
                    save(self.found, keep)
                    click.echo(" | ".join(f"{one.target.name} {one.inputs}, {len(one.bad)} bad" for one in self.found))

    def for_counts(self, counts: Sequence[int]) -> None:
        """Try so many inputs of each target."""
        with _folder() as folder:
            waiting = list(zip(self.found, counts, strict=True))
            while waiting or self.running:
                while waiting and len(self.running) < self.jobs:
                    findings, count = waiting.pop()
                    self._start(findings, range(count), folder, float("inf"))
                self._wait()

    def _start(self, findings: Findings, numbers: range, folder: Path, until: float) -> None:
        own = Path(tempfile.mkdtemp(dir=folder))
        run = Slice(self.seed, numbers, self.guided)
        ours, theirs = FORK.Pipe(duplex=False)
        process = FORK.Process(target=work, args=(theirs, findings.target, run, own, findings.known, findings.seen))
        process.start()
        theirs.close()
        findings.next = numbers.start
        self.running.append(Running(process, ours, findings, run, own, until, numbers.start, time.monotonic()))

    def _wait(self) -> None:
        ready = connection.wait([run.channel for run in self.running], timeout=1.0)
        for run in list(self.running):
            if run.channel in ready:
                self._receive(run)
            else:
                self._check_time(run)

    def _receive(self, run: Running) -> None:
        try:
            result: Result = run.channel.recv()
        except (EOFError, OSError):
            run.process.join()
            if run.at < run.slice.numbers.stop:
                self._lost(run, "CRASH")
            else:
                self._end(run)
            return
        run.findings.add(result, self.guided)
        run.findings.wall += time.monotonic() - run.since
        run.at, run.since, run.used = result.number + 1, time.monotonic(), _processor(run.process.pid)
        run.findings.next = max(run.findings.next, run.at)
        if time.monotonic() > run.until:
            run.process.kill()
            self._end(run)

    def _check_time(self, run: Running) -> None:
        if _processor(run.process.pid) - run.used < SLOW and time.monotonic() - run.since < 6 * SLOW:
            return
        os.kill(run.process.pid or 0, signal.SIGUSR1)  # it writes its stack
        time.sleep(0.5)
        run.process.kill()
        self._lost(run, "SLOW")

    def _lost(self, run: Running, kind: str) -> None:
        """Note that an input ended its worker, and go on with the next."""
        run.process.join()
        stack = (run.folder / STACK).read_text() if (run.folder / STACK).is_file() else ""
        kept = _pickled(run.folder / CURRENT)
        lines = [line.split(", line ") for line in stack.splitlines() if "sdm_deflect" in line]
        where = " > ".join(f"{Path(line[0].strip()).stem} {line[1]}" for line in lines[:2] if len(line) > 1)
        code = f"ended with {run.process.exitcode}" if kind == "CRASH" else f"more than {SLOW:g} s"
        run.findings.add(Result(run.at, kind, f"{code} {where}", stack[:6000], kept=kept), False)
        run.findings.wall += time.monotonic() - run.since
        run.findings.next = run.at + 1
        self._end(run)
        if self.jobs and run.at + 1 < run.slice.numbers.stop and time.monotonic() < run.until:
            numbers = range(run.at + 1, run.slice.numbers.stop)
            self._start(run.findings, numbers, run.folder.parent, run.until)

    def _end(self, run: Running) -> None:
        self.running.remove(run)
        run.process.join()
        run.channel.close()
        shutil.rmtree(run.folder, ignore_errors=True)


def save(found: Sequence[Findings], folder: Path) -> None:
    """Keep an input of each finding, the shortest, with its text."""
    for one in found:
        for i, (key, results) in enumerate(sorted(one.bad.items())):
            place = folder / one.target.name / f"{i:03d}"
            shutil.rmtree(place, ignore_errors=True)
            shown = [result for result in results if result.kept]
            least = min(shown or results, key=lambda r: r.kept.size if r.kept else 0)
            place.mkdir(parents=True)
            if least.kept:
                least.kept.keep(place)
            numbers = [result.number for result in results]
            (place / "finding.txt").write_text(f"{key}\nnumbers {numbers[:20]}\n{least.text}\n", errors="replace")


def print_figures(found: Sequence[Findings], as_json: Path | None) -> None:
    """Print a line for each target and each finding, and write the same as JSON."""
    for one in found:
        figures = one.figures()
        click.echo(
            f"{one.target.name}: " + ", ".join(f"{key} {value}" for key, value in figures.items() if key != "findings")
        )
        for key, results in sorted(one.bad.items()):
            click.echo(f"    {len(results):5d} {key}  (number {results[0].number})")
    if as_json:
        as_json.write_text(json.dumps({one.target.name: one.figures() for one in found}, indent=1))


def _pickled(path: Path) -> Input | None:
    try:
        kept: Input = pickle.loads(path.read_bytes())
    except (OSError, EOFError, pickle.UnpicklingError):
        return None
    return kept


def _processor(pid: int | None) -> float:
    """Seconds of processor time of a process and of its children that have ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _folder() -> Iterator[Path]:
    """Yield a folder in memory where there is one."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(prefix="sdm-fuzz-", dir=memory if memory.is_dir() else None) as name:
        yield Path(name)
