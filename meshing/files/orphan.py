"""A process that does not outlive its parent, and says which results it replaces.

``python -m sdm_deflect.meshing.files.orphan PARENT MODULE ...`` runs a module as ``python -m MODULE ...`` does,
but before any library is loaded it binds itself to the process whose id is PARENT. ``PARENT -- PROGRAM ...``
becomes another program.
"""

import ctypes
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from runpy import run_module

_PR_SET_PDEATHSIG = 1
watchers: list[Callable[[Path, bool], None]] = []
"""Called with the target: False when its replacement begins, True when it is whole; not for the mesh cache."""


def end_with(parent: int) -> None:
    """Let this process be killed when its parent ends, of a kill that no one catches too; on Linux."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it ended before it could be watched
            os.kill(os.getpid(), signal.SIGKILL)


if __name__ == "__main__":
    end_with(int(sys.argv[1]))
    if sys.argv[2] == "--":
        os.execvp(sys.argv[3], sys.argv[3:])
    sys.argv = sys.argv[2:]
    run_module(sys.argv[0], run_name="__main__", alter_sys=True)
