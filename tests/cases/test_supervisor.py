"""How commands end: by signals at any moment, and by faults of libraries. The work here is a stand-in for a command."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sdm_deflect.cases.cli.supervisor import REQUESTS

UNCHANGED = "interrupted; earlier results are as they were\n"
SLOW = 10.0
"""Seconds that a loaded machine may take for what takes two."""


def begun(work: str, ignored: tuple[signal.Signals, ...] = ()) -> "subprocess.Popen[str]":
    """Start a command whose work is `work`, and wait until it prints a line."""
    script = f"""
import ctypes, os, sys, time
from pathlib import Path
from sdm_deflect.cases import cli
from sdm_deflect.cases.cli import supervisor
from sdm_deflect.meshing.files.orphan import watchers

def work():
{work}

cli.main = work
supervisor.main()
"""

    def as_in_a_terminal() -> None:
        for one in REQUESTS:
            signal.signal(one, signal.SIG_IGN if one in ignored else signal.SIG_DFL)

    process = subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=as_in_a_terminal,
    )
    assert process.stdout.readline(), process.stderr.read()
    return process


def ended(process: "subprocess.Popen[str]") -> tuple[int, str]:
    start = time.monotonic()
    _, said = process.communicate(timeout=60)
    assert time.monotonic() - start < SLOW
    return process.returncode, said


OBEYS = "    print(os.getpid(), flush=True); time.sleep(600)"
SWALLOWS = """
    try:
        print(os.getpid(), flush=True)
        time.sleep(600)
    except BaseException:
        time.sleep(600)
"""
HOLDS = "    print(os.getpid(), flush=True); sum(range(10**13))"  # no bytecode in between, and the lock is held
TURNS = """
    try:
        print(os.getpid(), flush=True)
        time.sleep(600)
    except BaseException:
        raise ValueError("an error of a library's own")
"""


@pytest.mark.parametrize("number", REQUESTS)
@pytest.mark.parametrize("work", [OBEYS, SWALLOWS, HOLDS, TURNS])
def test_a_request_to_end_is_obeyed_whatever_the_work_does(work, number):
    process = begun(work)
    process.send_signal(number)
    assert ended(process) == (128 + number, UNCHANGED)


def test_no_other_request_disturbs_the_tidying(tmp_path):
    tidied = tmp_path / "tidied"
    process = begun(f"""
    try:
        print(os.getpid(), flush=True)
        time.sleep(600)
    finally:
        time.sleep(0.5)
        Path({str(tidied)!r}).touch()
""")
    for number in (signal.SIGINT, signal.SIGINT, signal.SIGTERM):
        process.send_signal(number)
        time.sleep(0.1)
    assert ended(process) == (130, UNCHANGED)
    assert tidied.exists()


def test_a_signal_that_is_ignored_at_the_start_stays_ignored():
    process = begun("    print(1, flush=True); time.sleep(1); sys.exit(1)", ignored=(signal.SIGHUP,))
    process.send_signal(signal.SIGHUP)
    assert ended(process) == (1, "")


@pytest.mark.parametrize(("done", "says"), [(True, "run written already, and whole"), (False, "run being replaced: ")])
def test_the_line_says_what_became_of_the_results(done, says):
    process = begun(f"    watchers[0](Path('run'), {done}); print(1, flush=True); time.sleep(600)")
    process.send_signal(signal.SIGTERM)
    code, said = ended(process)
    assert code == 143
    assert said.startswith(f"interrupted; {says}")


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGABRT])
def test_a_fault_of_a_library_is_one_line(number):
    code, said = ended(begun(f"    print(1, flush=True); os.kill(os.getpid(), {int(number)})"))
    assert code == 128 + number
    assert said == f"sdm: ended within a library: {signal.strsignal(number)}; earlier results are as they were\n"


@pytest.mark.parametrize("code", [0, 1, 2])
def test_the_code_is_that_of_the_work(code):
    assert ended(begun(f"    print(1); sys.exit({code})")) == (code, "")


def test_the_work_ends_with_a_process_that_is_killed():
    process = begun(HOLDS)
    process.kill()
    process.communicate(timeout=SLOW)  # the work holds the pipes until it ends
    assert process.returncode == -signal.SIGKILL


def test_the_work_that_alone_is_asked_says_the_same():
    process = begun(OBEYS)
    (work,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    os.kill(int(work), signal.SIGTERM)
    assert ended(process) == (143, UNCHANGED)
