"""How commands end when a signal asks them to. The work here is a stand-in for a command.

It sleeps in short turns: Python does not see a signal that arrives just before a sleep begins until the sleep ends.
"""

import signal
import subprocess
import sys
import time

import pytest

from sdm_deflect.base.errors import REQUESTS

UNCHANGED = "interrupted; earlier results are as they were\n"


def begun(work: str, ignored: tuple[signal.Signals, ...] = ()) -> "subprocess.Popen[str]":
    """Start a command whose work is `work`, and wait until it prints a line."""
    script = f"""
import sys, time
from pathlib import Path
from sdm_deflect.cases import cli
from sdm_deflect.cases.cli import commands
from sdm_deflect.base import files

def work():
    print(1, flush=True)
{work}

commands.carry_out = work
cli.main()
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
    _, said = process.communicate(timeout=60)
    return process.returncode, said


OBEYS = "    for _ in range(600): time.sleep(1)"
TURNS = """
    try:
        for _ in range(600): time.sleep(1)
    except BaseException:
        raise ValueError("an error of a library's own")
"""
FORGETS = """
    try:
        for _ in range(600): time.sleep(1)
    except BaseException:
        pass
"""


@pytest.mark.parametrize("number", REQUESTS)
@pytest.mark.parametrize("work", [OBEYS, TURNS, FORGETS])
def test_a_request_to_end_is_obeyed_whatever_a_library_makes_of_it(work, number):
    process = begun(work)
    process.send_signal(number)
    assert ended(process) == (128 + number, UNCHANGED)


def test_no_other_request_disturbs_the_tidying(tmp_path):
    process = begun(f"""
    with files.fresh(Path({str(tmp_path / "old")!r})) as beside:
        try:
            for _ in range(600): time.sleep(1)
        finally:
            time.sleep(0.5)
""")
    for number in (signal.SIGINT, signal.SIGINT, signal.SIGTERM):
        process.send_signal(number)
        time.sleep(0.1)
    assert ended(process) == (130, UNCHANGED)
    assert list(tmp_path.iterdir()) == []


def test_a_signal_that_is_ignored_at_the_start_stays_ignored():
    process = begun("    time.sleep(1); sys.exit(1)", ignored=(signal.SIGHUP,))
    process.send_signal(signal.SIGHUP)
    assert ended(process) == (1, "")


def test_the_line_says_what_became_of_the_results(tmp_path):
    process = begun(f"""
    with files.fresh(Path({str(tmp_path / "new")!r})): pass
    print(2, flush=True)
    for _ in range(600): time.sleep(1)
""")
    process.stdout.readline()
    process.send_signal(signal.SIGTERM)
    assert ended(process) == (143, f"interrupted; {tmp_path / 'new'} written already, and whole\n")


@pytest.mark.parametrize("code", [0, 1, 2])
def test_the_code_is_that_of_the_work(code):
    assert ended(begun(f"    sys.exit({code})")) == (code, "")
