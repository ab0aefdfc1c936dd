"""The process that a user starts as `sdm`: another one does the work, and this one answers for how that ends.

A library may hold a process for seconds in compiled code, where Python hears no signal, may swallow an interruption,
or may end its process by a fault. This process loads nothing and only waits: it passes a request to end on to the
work, which may tidy up then, kills what has not ended in time, and says what became of the results.
"""

import os
import signal
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from mmap import mmap
from pathlib import Path
from types import FrameType
from typing import NoReturn

from sdm_deflect.meshing.files.orphan import end_with, watchers

REQUESTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that ask a command to end; its exit code is 128 and the signal's number."""

PATIENCE = 1.0
"""Seconds that the work has to tidy up after it was asked to end."""

_UNCHANGED = "earlier results are as they were"
_HALF = (
    "being replaced: each file is the old or the new one; the next command that writes there restores a missing folder"
)
_WHOLE = "written already, and whole"
_ROOM, _NAMED = 4096, 3
_SHOW_CURSOR = "\x1b[?25h"


def main() -> NoReturn:
    """Entry point: do the work in a process of its own and end with its code."""
    requests = [one for one in REQUESTS if signal.getsignal(one) != signal.SIG_IGN]  # nohup's stays ignored
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, (*requests, signal.SIGCHLD, signal.SIGALRM))
    parent, state = os.getpid(), mmap(-1, _ROOM)  # shared with the work
    work = os.fork()
    if not work:
        end_with(parent)
        _work(requests, mask, state)
    asked, status = _outcome(work, requests)
    killed = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    code = 128 + killed if killed else os.WEXITSTATUS(status)
    if not asked and code - 128 in REQUESTS:  # the work alone was asked
        asked = code - 128
    became = state[:].rstrip(b"\0").decode(errors="ignore") or _UNCHANGED
    if asked and code:
        _say(f"interrupted; {became}", bool(killed))
        code = 128 + asked
    elif killed:
        _say(f"sdm: ended within a library: {signal.strsignal(killed)}; {became}", True)
    os._exit(code)


def _outcome(work: int, requests: Iterable[signal.Signals]) -> tuple[int, int]:
    """Wait for the work; return the first request to end that came, or 0, and the status with which the work ended."""
    asked = 0
    while True:
        number = signal.sigwait((*requests, signal.SIGCHLD, signal.SIGALRM))
        if number == signal.SIGCHLD:
            ended, status = os.waitpid(work, os.WNOHANG)
            if ended:
                return asked, status
        elif number == signal.SIGALRM:
            os.kill(work, signal.SIGKILL)
        else:
            if not asked:
                asked = number
                signal.setitimer(signal.ITIMER_REAL, PATIENCE)
            os.kill(work, number)


def _say(sentence: str, killed: bool) -> None:
    """Write a line to standard error; a display of progress that was killed has hidden the cursor."""
    with suppress(OSError):
        os.write(2, f"{_SHOW_CURSOR if killed and os.isatty(2) else ''}{sentence}\n".encode())


def _work(requests: Iterable[signal.Signals], mask: Iterable[int], state: mmap) -> NoReturn:
    """Carry out the command and end this process with its code."""
    watchers.append(_notebook(state))
    attention = _Attention()
    for one in requests:
        signal.signal(one, attention)
    code = 0
    try:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        from sdm_deflect.cases.cli import main as command

        command()
    except SystemExit as stop:
        code = int(stop.code or 0)
    except BaseException:
        if not attention.came:  # else it is the interruption, or what a library made of it
            raise
    finally:
        attention.over = True
        for one in requests:
            signal.signal(one, signal.SIG_DFL)  # nothing is left to tidy
    code = 128 + attention.came[0] if attention.came else code
    try:
        sys.stdout.flush()
    except OSError:
        sys.exit(code)  # which says what is wrong with the output
    os._exit(code)  # nothing is left to do, and libraries take up to a second to be unloaded


class _Attention:
    """The handler of requests to end: the first one raises KeyboardInterrupt, no other disturbs the tidying."""

    def __init__(self) -> None:
        self.came: list[int] = []
        self.over = False

    def __call__(self, number: int, _: FrameType | None) -> None:
        self.came.append(number)
        if len(self.came) == 1 and not self.over:
            raise KeyboardInterrupt


def _notebook(state: mmap) -> Callable[[Path, bool], None]:
    """Return what keeps in shared memory a sentence on the targets that were begun (False) and are whole (True)."""
    whole: dict[str, bool] = {}

    def note(target: Path, done: bool) -> None:
        whole[str(target)] = done
        half = [name for name, complete in whole.items() if not complete]
        said = f"{_listed(half or list(whole))} {_HALF if half else _WHOLE}"
        state[:] = said.encode(errors="replace")[:_ROOM].ljust(_ROOM, b"\0")

    return note


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
