"""The command line `sdm`, which a signal may end at any time, even while libraries are loaded."""

import os
import signal
import sys
from contextlib import suppress
from typing import NoReturn

from sdm_deflect.base.errors import REQUESTS


def main() -> NoReturn:
    """Carry out `sdm` and end this process; after a signal the exit code is 128 plus its number."""
    came = _requests()
    code = 0
    try:
        from .commands import carry_out

        carry_out()
    except SystemExit as end:
        code = int(end.code or 0)
    except BaseException:
        if not came:  # else it is what a library made of the request
            raise
    if came:
        code = 128 + came[0]
        files = sys.modules.get("sdm_deflect.base.files")
        placed = ", ".join(map(str, files.placed)) if files else ""
        became = f"{placed} written already, and whole" if placed else "earlier results are as they were"
        with suppress(OSError, AttributeError):
            sys.stderr.write(f"interrupted; {became}\n")
    with suppress(OSError, AttributeError):  # a stream that is closed, or that was never there
        sys.stdout.flush()
    os._exit(code)  # nothing is left to do, and libraries take up to a second to be unloaded


def _requests() -> list[int]:
    """Return a list of the signals that ask to end, as they come; the first one raises SystemExit."""
    came: list[int] = []

    def asked(number: int, _: object) -> None:
        came.append(number)
        if len(came) == 1:  # no other one disturbs the tidying
            raise SystemExit(128 + number)

    for request in REQUESTS:
        if signal.getsignal(request) != signal.SIG_IGN:  # nohup's stays ignored
            signal.signal(request, asked)
    return came
