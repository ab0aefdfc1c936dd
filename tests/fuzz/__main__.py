"""Try damaged meshes: ``python -m tests.fuzz --inputs 2000``.

Each format is tried in a process of its own, which may die of an input; another one goes on after it. Exit code 1 if
something was found; what was is kept in the folder of ``--keep``.
"""

import argparse
import faulthandler
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random

import click

from sdm_deflect.cases.errors import is_reported
from tests.fuzz import known
from tests.fuzz.inputs import Input
from tests.fuzz.targets import TARGETS, Target, WrongError

# Bytes of addresses that a process may take beside those of what is loaded.
MEMORY = 3 << 30
# Time for an input; characters of a message.
SECONDS, LONGEST = 60, 1000
GOOD = ("ok", "clean")
# Number of an input, what came of it, and the stack of an error.
Result = tuple[int, str, str]


def main() -> int:
    """Try inputs, print what came of them, return the exit code."""
    words = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    words.add_argument("--known", action="store_true", help="sound inputs, and those that once did harm, alone")
    words.add_argument("--inputs", type=int, default=300, help="so many of each format, always the same ones")
    words.add_argument("--target", action="append", choices=TARGETS, help="only this one; repeat")
    words.add_argument("--seed", type=int, default=1)
    words.add_argument("--keep", type=Path, default=Path("fuzz-findings"), help="folder for inputs that were found")
    words.add_argument("--json", type=Path, help="file for the figures")
    given = words.parse_args()
    figures, bad = {}, 0
    for name in given.target or TARGETS:
        target = TARGETS[name]
        with tempfile.TemporaryDirectory() as place:
            sound = list(target.seeds(Path(place)))
        inputs = Inputs(target, (*sound, *known.of(name, sound)), len(sound), given.seed)
        counts: Counter[str] = Counter()
        for number, kind, text in tried(inputs, len(inputs.first) if given.known else given.inputs):
            counts[kind.partition(" ")[0]] += 1
            if kind not in GOOD:
                bad += 1
                click.echo(f"{name} {number}: {kind}\n{text}")
                inputs.at(number).put(given.keep / name / str(number))
        figures[name] = {"inputs": counts.total(), **counts}
        click.echo(f"{name}: {figures[name]}")
    if given.json:
        given.json.write_text(json.dumps(figures))
    return int(bad > 0)


@dataclass(frozen=True, slots=True)
class Inputs:
    """The `first` inputs of a target are tried as they are; then those are damaged that are `sound`, the first ones."""

    target: Target
    first: tuple[Input, ...]
    sound: int
    seed: int

    def at(self, number: int) -> Input:
        """Return an input."""
        if number < len(self.first):
            return self.first[number]
        return self.target.input(Random(f"{self.seed}/{self.target.name}/{number}"), self.first[: self.sound])


def tried(inputs: Inputs, count: int) -> Iterator[Result]:
    """Yield what came of each input."""
    context, done = get_context("fork"), 0
    while done < count:
        here, there = context.Pipe(duplex=False)
        process = context.Process(target=work, args=(there, inputs, range(done, count)))
        process.start()
        there.close()
        try:
            while done < count:
                yield here.recv()
                done += 1
        except EOFError:
            process.join()
            late = process.exitcode == -signal.SIGALRM
            yield done, f"{'SLOW' if late else 'DIED'} of {process.exitcode}", ""
            done += 1
        process.join()


def work(channel: Connection, inputs: Inputs, numbers: range) -> None:
    """Try inputs and send what came of each; be a process of its own."""
    faulthandler.enable()
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    with tempfile.TemporaryDirectory() as name:
        place = Path(name, "in")
        for number in numbers:
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
            given = inputs.at(number)
            given.put(place)
            signal.alarm(SECONDS)
            kind, text = outcome(inputs.target, place, given, Random(number))
            signal.alarm(0)
            if kind in GOOD and any((place / file).read_bytes() != data for file, data in given.files.items()):
                kind, text = "CHANGED", "the input was changed"
            channel.send((number, kind, text))
        channel.close()


def outcome(target: Target, place: Path, given: Input, random: Random) -> tuple[str, str]:
    """Run a target on an input; return what came of it, and the stack of what is wrong."""
    here = Path.cwd()
    os.chdir(place)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for unseen in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
            warnings.simplefilter("ignore", unseen)  # as for users
        try:
            target.run(place, given, random)
        except WrongError as error:
            return f"WRONG {error}", traceback.format_exc()
        except Exception as error:  # whatever it is, it is the finding
            if not is_reported(error):
                return f"TRACEBACK {type(error).__name__}", traceback.format_exc()
            text = str(error)
            single = text.strip() and text.isprintable() and len(text) < LONGEST
            return ("clean", "") if single else ("LINES", traceback.format_exc())
        finally:
            os.chdir(here)
    return "ok", ""


if __name__ == "__main__":
    sys.exit(main())
