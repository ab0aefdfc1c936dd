"""End commands at random moments and at each rename: ``python -m tests.fuzz.kills --kills 200``.

A command writes over an older result. However it is ended, the folder is the old or the new result, the line that was
printed says which, and nothing else is left once the next command has written there. After SIGKILL several targets may
be some old and some new, each of them whole. Exit code 1 if one of this is not so.
"""

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from unittest.mock import patch

import click

from sdm_deflect.meshing.files import NAME, hidden_folder
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.meshing.formats.wing import wing

ROOT = Path(__file__).parents[2]
SECONDS = 2.0
"""Within which a command has ended."""
REQUESTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SIGNALS = (*REQUESTS, signal.SIGKILL)
BOTH = "old and new"
"""State of a folder in which some targets are the old and some the new ones, each as a whole."""
HOOK = """
import os, signal
folder, when, number = os.environ["KILL_FOLDER"], int(os.environ["KILL_AT"]), int(os.environ["KILL_SIGNAL"])
count = 0

def heeded(rename):
    def other(*given, **named):
        global count
        if any(str(one if isinstance(one, str) else os.fsdecode(one)).startswith(folder)
               for one in given if not isinstance(one, int)):
            count += 1
            with open(os.environ["KILL_COUNT"], "a") as file:
                file.write(".")
            if count == when:
                os.kill(os.getpid(), number)
        return rename(*given, **named)
    return other

os.rename, os.replace = heeded(os.rename), heeded(os.replace)
import ctypes
library = ctypes.CDLL

class Heeded(library):
    def __init__(self, *given, **named):
        super().__init__(*given, **named)
        if given == (None,) and hasattr(self, "renameat2"):
            self.renameat2 = heeded(self.renameat2)

ctypes.CDLL = Heeded
"""
"""Run by the command's interpreter: sends the signal before the KILL_AT-th rename in KILL_FOLDER."""

FLAP = (
    "--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion", "blended",
    "--hinge", "0.7,0.3,0", "0.7,0.7,0", "--quiet",
)  # fmt: skip
AILERON = ("run", "aileron", "--out", "{folder}/run", "--quiet")
DEFLECT = ("deflect", "{mesh}", *FLAP, "--repair", "off", "--out", "{folder}/w.su2")
COMMANDS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "run": ((*AILERON, "--no-report", "--angle", "5"), (*AILERON, "--no-report", "--angle", "6")),
    "run, report": ((*AILERON, "--angle", "5"), (*AILERON, "--angle", "6")),
    "deflect": ((*DEFLECT, "--no-report", "--angle", "5"), (*DEFLECT, "--no-report", "--angle", "6")),
    "deflect, report": tuple((*DEFLECT, "--report", "--sensitivity", "--angle", angle) for angle in ("5", "6")),
    "deflect, sensitivity": tuple((*DEFLECT, "--no-report", "--sensitivity", "--angle", angle) for angle in ("5", "6")),
    "sweep, report": (
        (*DEFLECT, "--no-report", "--angle", "5"), (*DEFLECT, "--report", "--angles", "2,4"),
    ),
}  # fmt: skip
"""By name: the words that make an older result, and those of the command that is ended."""

Files = dict[str, bytes]


@dataclass(slots=True)
class Scenario:
    """A command over an older result; `old` and `new` are what the folder holds before and after it."""

    name: str
    place: Path
    old: Files = field(init=False)
    new: Files = field(init=False)
    seconds: float = field(init=False)
    renames: int = field(init=False)

    def __post_init__(self) -> None:
        """Make the older result, and carry the command out once without a signal."""
        self.place.mkdir(parents=True)
        FORMATS["su2"].write(wing(cells=4).mesh, self.place / "mesh.su2")
        (self.place / "sitecustomize.py").write_text(HOOK)
        self.folder.mkdir()
        self.carry_out(COMMANDS[self.name][0])
        kept = self.folder / "run" / "mine.txt" if self.name.startswith("run") else self.folder / "mine.txt"
        kept.write_text("the user's own")
        self.old = contents(self.folder)
        start = time.monotonic()
        self.carry_out(COMMANDS[self.name][1])
        self.seconds, self.renames = time.monotonic() - start, len((self.place / "count").read_text())
        self.new = contents(self.folder)

    @property
    def folder(self) -> Path:
        """The folder that is written to."""
        return self.place / "results"

    def carry_out(self, words: tuple[str, ...]) -> None:
        """Carry out a command without a signal."""
        with self.begin(words) as process:
            _, said = process.communicate()
        assert process.returncode in (0, 1), said

    def begin(self, words: tuple[str, ...], when: int = 0, number: int = 0) -> "subprocess.Popen[str]":
        """Start a command that gets the signal at a rename, if `when` is not 0."""
        (self.place / "count").write_text("")
        temporary = self.place / "temporary"
        temporary.mkdir(exist_ok=True)
        given = [word.format(folder=self.folder, mesh=self.place / "mesh.su2") for word in words]
        own = {
            "KILL_FOLDER": self.folder,
            "KILL_AT": when,
            "KILL_SIGNAL": int(number),
            "KILL_COUNT": self.place / "count",
            "TMPDIR": temporary,
            "PYTHONPATH": os.pathsep.join([str(self.place), str(ROOT)]),
        }
        return subprocess.Popen(
            [sys.executable, "-m", "sdm_deflect", *given],
            env=os.environ | {key: str(value) for key, value in own.items()},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: [signal.signal(one, signal.SIG_DFL) for one in REQUESTS],
        )

    def restore(self) -> None:
        """Put the older result back."""
        shutil.rmtree(self.folder)
        for name, content in self.old.items():
            (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
            (self.folder / name).write_bytes(content)

    def state(self) -> str:
        """Return "old", "new", `BOTH`, or what is none of these."""
        every = contents(self.folder), self.old, self.new
        targets = {name.partition(os.sep)[0] for files in every for name in files}
        states = {standing(*(of_target(files, target) for files in every)) for target in targets} - {"unchanged"}
        if wrong := states - {"old", "new"}:
            return ", ".join(sorted(wrong))
        return BOTH if len(states) == 2 else states.pop() if states else "new"


def of_target(files: Files, target: str) -> Files:
    """Return the files of a target, itself a file or a folder."""
    return {name: content for name, content in files.items() if name.partition(os.sep)[0] == target}


def standing(now: Files, old: Files, new: Files) -> str:
    """Return whether a target is "old", "new", "unchanged" because these are the same, or what it is."""
    if old == new == now:
        return "unchanged"
    if now == old:
        return "old"
    missing, more = new.keys() - now.keys(), now.keys() - new.keys()
    stale = [
        name
        for name in now.keys() & new.keys()
        if now[name] != new[name] and (now[name] == old.get(name) or not complete(name, now, new))
    ]
    wrong = {"missing": sorted(missing), "too many": sorted(more), "old or torn": stale}
    return ", ".join(f"{what} {names}" for what, names in wrong.items() if names) or "new"


def contents(folder: Path) -> Files:
    """Return all files of a folder by their names."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def complete(name: str, now: Files, new: Files) -> bool:
    """Whether a file that holds times, and so is never the same twice, is whole."""
    if name.endswith(".json"):
        return json.loads(now[name]).keys() == json.loads(new[name]).keys()
    return now[name][-16:].split() == new[name][-16:].split() or name.endswith("convergence.csv")


@dataclass(frozen=True, slots=True)
class Kill:
    """One command that was ended: when, by what, how long that took (nan: it had ended before), what it left."""

    scenario: str
    when: str
    number: signal.Signals
    seconds: float
    code: int
    said: str
    state: str
    wrong: tuple[str, ...]


def kill(scenario: Scenario, number: signal.Signals, at: float | int) -> Kill:
    """End a command at a rename (int, from 1) or after some seconds (float), and look at what it left."""
    scenario.restore()
    renaming = isinstance(at, int)
    process = scenario.begin(COMMANDS[scenario.name][1], at if renaming else 0, number)
    begun = time.monotonic()
    children: set[int] = set()
    if renaming:
        while process.poll() is None and len((scenario.place / "count").read_text()) < at:
            children |= set(descendants(process.pid))
            time.sleep(0.002)
    else:
        time.sleep(at)
        children = set(descendants(process.pid))
        process.send_signal(number)
    sent = time.monotonic()
    with process:
        _, said = process.communicate()
    seconds = time.monotonic() - sent
    deadline = time.monotonic() + SECONDS
    while (alive := [one for one in children if is_alive(one)]) and time.monotonic() < deadline:
        time.sleep(0.01)
    before = scenario.state()
    left = next_command(scenario)
    state = scenario.state()
    line = said.strip().rpartition("\n")[2]
    wrong = list(judged(number, process.returncode, line, before, state, sent - begun))
    wrong += [f"ended after {seconds:.1f} s"] * (seconds > SECONDS) + [f"alive: {alive}"] * bool(alive)
    wrong += [f"left: {one}" for one in left]
    when = f"rename {at} of {scenario.renames}" if renaming else f"{at:.2f} of {scenario.seconds:.1f} s"
    return Kill(scenario.name, when, number, seconds, process.returncode, line, state, tuple(wrong))


def judged(number: signal.Signals, code: int, line: str, before: str, state: str, age: float) -> Iterator[str]:
    """Yield what is wrong with an exit code, a line, and a folder before and after the next command."""
    if state not in {"old", "new"} | ({BOTH} if number == signal.SIGKILL else set()):
        yield f"folder: {state}"
    if age < 1.0 and state == "old" and (code == -number or line == "KeyboardInterrupt"):  # Python itself is starting
        return
    if code in {0, 1} and state != "new":
        yield f"code {code}, and the folder is {state}"
    if code in {0, 1} or code == -number == -signal.SIGKILL:
        return
    if code != 128 + number:
        yield f"code {code}"
    means = (("earlier results are as they were", "old"), ("written already, and whole", "new"))
    if not any(line.startswith("interrupted; ") and text in line and before == state == meant for text, meant in means):
        yield f"says {line!r}, and the folder is {before}, then {state}"


def next_command(scenario: Scenario) -> list[str]:
    """Begin to write in the folder, as the next command does; return what is there of hidden folders after that."""
    temporary = scenario.place / "temporary"
    with patch.object(tempfile, "tempdir", str(temporary)), hidden_folder(scenario.folder), hidden_folder():
        pass
    return [str(path) for path in scenario.place.rglob(f"{NAME}*")]


def descendants(pid: int) -> list[int]:
    """Process ids of the children of a process, and of theirs."""
    parents: dict[int, list[int]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        parents.setdefault(parent, []).append(int(path.parent.name))
    found = list(parents.get(pid, []))
    for child in found:
        found += parents.get(child, [])
    return found


def is_alive(pid: int) -> bool:
    """Whether a process runs."""
    try:
        return re.search(r"\) (\w)", Path(f"/proc/{pid}/stat").read_text())[1] != "Z"
    except OSError:
        return False


def moments(scenario: Scenario, number: int, random: Random) -> list[tuple[float | int, signal.Signals]]:
    """Return so many moments, and a signal for each: every rename with every signal, then random ones."""
    renames = [(at, one) for at in range(1, scenario.renames + 1) for one in SIGNALS]
    chosen = random.sample(renames, min(len(renames), number // 2))
    rest = range(number - len(chosen))
    return [*chosen, *((random.uniform(0.0, 1.02 * scenario.seconds), SIGNALS[k % len(SIGNALS)]) for k in rest)]


def main() -> int:
    """End commands, print a table, return the exit code."""
    words = argparse.ArgumentParser(prog="python -m tests.fuzz.kills", description=__doc__)
    words.add_argument("--kills", type=int, default=200)
    words.add_argument("--seed", type=int, default=1)
    words.add_argument("--only", choices=COMMANDS)
    given = words.parse_args()
    random, names = Random(given.seed), [given.only] if given.only else list(COMMANDS)
    wrong = 0
    with tempfile.TemporaryDirectory() as place:
        for i, name in enumerate(names):
            scenario = Scenario(name, Path(place, str(i)))
            click.echo(f"{name}: {scenario.seconds:.1f} s, {scenario.renames} renames")
            share = given.kills * (i + 1) // len(names) - given.kills * i // len(names)
            done = []
            for at, number in moments(scenario, share, random):
                done.append(kill(scenario, number, at))
                if done[-1].wrong:
                    click.echo(done[-1])
            click.echo("\n".join(rows(done)))
            wrong += sum(bool(one.wrong) for one in done)
    return int(wrong > 0)


def rows(done: Sequence[Kill]) -> Iterator[str]:
    """Yield a line for each signal: how many there were, what they left, exit codes, the longest time to the end."""
    for number in SIGNALS:
        some = [one for one in done if one.number == number]
        counts = [dict(Counter(values)) for values in ([one.state for one in some], [one.code for one in some])]
        slowest, bad = max((one.seconds for one in some), default=0.0), sum(bool(one.wrong) for one in some)
        yield f"  {number.name:<8} {len(some):4}  {counts[0]}  codes {counts[1]}  {slowest:.2f} s  wrong: {bad}"


if __name__ == "__main__":
    sys.exit(main())
