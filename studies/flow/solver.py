"""OpenFOAM's programs run on a case: found, started, watched, and gone when this process is interrupted or dies."""

import os
import shutil
import subprocess
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sdm_deflect.base.errors import InputError, LostError
from sdm_deflect.meshing.child import CHILD

# Where Debian's package has what a program asks for at its start.
HOME = "/usr/share/openfoam"
INSTALL = "install OpenFOAM (apt-get install openfoam) and, where it is not Debian's, source its etc/bashrc"
# Lines of a program's output that are kept for a message.
KEPT = 30


def needed(*programs: str) -> None:
    """Raise InputError, a sentence, if one of these programs is not on PATH."""
    for program in programs:
        if shutil.which(program) is None:
            raise InputError(f"{program} is not on PATH: {INSTALL}")


def lines(program: str, case: Path, *words: str) -> Iterator[str]:
    """Run a program on a case and yield its lines as they come.

    It is killed when the iteration ends early. Raises InputError if the program is not on PATH, LostError, with its
    complaint, if it fails: OpenFOAM prints that among its lines, and a fault of the processor below all.
    """
    needed(program)
    last: deque[str] = deque(maxlen=KEPT)
    with _started([program, "-case", str(case.resolve()), *words], case) as process:
        assert process.stdout is not None
        for line in process.stdout:
            last.append(line.rstrip())
            yield line
        code = process.wait()
    if code or any("FOAM FATAL" in line for line in last):
        raise LostError(f"{program} ended with code {code} in {case}: {_complaint(last)}")


def run(program: str, case: Path, *words: str) -> str:
    """Return what a program prints on a case; errors as of `lines`."""
    return "".join(lines(program, case, *words))


def _complaint(last: deque[str]) -> str:
    """Return what matters of the last lines: what follows a fatal error, or else the last line with words."""
    text = [line.strip() for line in last if line.strip()]
    fatal = next((i for i, line in enumerate(text) if "FOAM FATAL" in line), None)
    return " ".join(text[fatal : fatal + 4]) if fatal is not None else (text or ["it said nothing"])[-1]


@contextmanager
def _started(words: list[str], case: Path) -> Iterator[subprocess.Popen[str]]:
    # Its own session: the terminal's Ctrl-C reaches this process only, which then kills the program.
    with subprocess.Popen(
        [sys.executable, "-m", CHILD, str(os.getpid()), "--", *words],
        cwd=case,
        env={"WM_PROJECT_DIR": HOME} | os.environ | {"PYTHONPATH": os.pathsep.join(path or "." for path in sys.path)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()
            process.wait()
