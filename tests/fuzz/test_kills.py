"""Whole commands that signals end at random moments; `tests/deform/test_files.py` ends a process at each rename.

A command writes over an older result. However it ends, each target is the old or the new one, the line that it prints
says which, its children end, and nothing else is left once `sdm doctor` was there.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from random import Random

import psutil
import pytest

from sdm_deflect.base.errors import REQUESTS
from sdm_deflect.base.files import NAME, OLD
from sdm_deflect.cases.cli import examination
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.meshing.formats.wing import wing

pytestmark = pytest.mark.nightly
ROOT = Path(__file__).parents[2]
KILLS = int(os.environ.get("FUZZ_KILLS", "96"))
# Within which a command and its children have ended, on a loaded machine.
SECONDS = 10.0
FLAP = (
    "deflect", "{place}/mesh.su2", "--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion",
    "blended", "--hinge", "0.7,0.3,0", "0.7,0.7,0", "--quiet", "--repair", "off", "--out", "{place}/results/w.su2",
)  # fmt: skip
AILERON = ("run", "aileron", "--out", "{place}/results/run", "--quiet")
# By name: the words that make an older result, and those of the command that is ended.
COMMANDS = {
    "run": ((*AILERON, "--angle", "5"), (*AILERON, "--angle", "6")),
    "deflect": tuple((*FLAP, "--report", "--sensitivity", "--angle", angle) for angle in ("5", "6")),
    "sweep": ((*FLAP, "--no-report", "--angle", "5"), (*FLAP, "--report", "--angles", "2,4")),
}
ALONE = "from sdm_deflect.cases.cli import main; main()"
WITHOUT = """
from types import SimpleNamespace
from sdm_deflect.base import files
files.ctypes = SimpleNamespace(CDLL=str)
"""
# How a folder is replaced: as Linux does it, and as a system does that has no renameat2.
EXCHANGES = {"exchange": "", "two renames": WITHOUT}
MEANS = {"earlier results are as they were": {"old"}, "written already, and whole": {"new"}}


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@dataclass
class Scenario:
    """A command over an older result; `old` and `new` are what the folder holds before and after it."""

    name: str
    way: str
    place: Path
    old: dict[str, bytes] = field(init=False)
    new: dict[str, bytes] = field(init=False)
    seconds: float = field(init=False)

    def __post_init__(self):
        FORMATS["su2"].write(wing(cells=4).mesh, self.place / "mesh.su2")
        (self.place / "temporary").mkdir()
        for number, kept in enumerate(("old", "new")):
            start = time.monotonic()
            with self.begin(number) as process:
                _, said = process.communicate()
            assert process.returncode in (0, 1), said
            self.seconds = time.monotonic() - start
            (self.folder / "mine.txt").write_text("the user's own")
            setattr(self, kept, contents(self.folder))

    @property
    def folder(self):
        return self.place / "results"

    def begin(self, number):
        words = (word.format(place=self.place) for word in COMMANDS[self.name][number])
        return subprocess.Popen(
            [sys.executable, "-c", EXCHANGES[self.way] + ALONE, *words],
            env=os.environ | {"TMPDIR": str(self.place / "temporary"), "PYTHONPATH": str(ROOT)},
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            preexec_fn=lambda: [signal.signal(one, signal.SIG_DFL) for one in REQUESTS],
        )  # fmt: skip

    def states(self):
        """Return "old", "new" or what is wrong, for each target that differs: a file, or a folder as a whole."""
        now, found = contents(self.folder), set()
        for target in {name.partition(os.sep)[0] for name in (*now, *self.old, *self.new)}:
            files = [
                {name: one[name] for name in one if name.partition(os.sep)[0] == target}
                for one in (now, self.old, self.new)
            ]
            if files[0] == files[1]:
                found |= {"old"} if files[1] != files[2] else set()
            else:
                torn = [name for name in files[0] if not whole(name, files[0], files[2])]
                found.add(
                    "new"
                    if files[0].keys() == files[2].keys() and not torn
                    else f"{target}: {sorted(files[0])}, torn {torn}"
                )
        return found


def whole(name, now, new):
    """Whether a file is the new one; one with times in it is never the same twice."""
    if name not in new or now[name] == new[name]:
        return True
    if name.endswith(".json"):
        return json.loads(now[name]).keys() == json.loads(new[name]).keys()
    return now[name][-16:].split() == new[name][-16:].split() or name.endswith("convergence.csv")


@pytest.fixture(scope="module", params=product(COMMANDS, EXCHANGES), ids=", ".join)
def scenario(request, tmp_path_factory):
    return Scenario(*request.param, tmp_path_factory.mktemp("kills"))


@pytest.mark.parametrize("number", [*REQUESTS, signal.SIGKILL])
def test_a_command_that_is_ended_leaves_each_target_old_or_new(scenario, number, monkeypatch):
    random = Random(int(number))
    monkeypatch.setattr("tempfile.tempdir", str(scenario.place / "temporary"))
    monkeypatch.setattr(examination, "YOUNG", 0.0)
    for _ in range(KILLS // 4 // len(COMMANDS) // len(EXCHANGES)):
        shutil.rmtree(scenario.folder)
        for name, content in scenario.old.items():
            (scenario.folder / name).parent.mkdir(parents=True, exist_ok=True)
            (scenario.folder / name).write_bytes(content)
        at = random.uniform(0.1, 1.02 * scenario.seconds)
        process, children = scenario.begin(1), []
        time.sleep(at)
        with suppress(psutil.NoSuchProcess):
            children = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(number)
        with process:
            _, said = process.communicate(timeout=SECONDS)
        assert psutil.wait_procs(children, timeout=SECONDS)[1] == []
        if aside := [path for path in scenario.folder.iterdir() if path.name.endswith(OLD)]:
            assert (number, scenario.way) == (signal.SIGKILL, "two renames"), aside
        before = scenario.states()
        examination.leftovers(scenario.folder)
        code, line, after = process.returncode, said.strip().rpartition("\n")[2], scenario.states()
        assert [*scenario.place.rglob(f"{NAME}*"), *scenario.folder.glob(f"*{OLD}")] == []
        seen = (at, code, line, before, after)
        if code in (0, 1):
            assert after in ({"new"}, set()), seen
        elif number == signal.SIGKILL:
            assert (code, after <= {"old", "new"}) == (-number, True), seen
        elif code == -number or line == "KeyboardInterrupt":
            assert (at < 1.0, after) == (True, {"old"}), seen  # Python itself is starting
        else:
            assert code == 128 + number, seen
            assert line.startswith("interrupted; "), seen
            assert any(text in line and before == after == state for text, state in MEANS.items()), seen
