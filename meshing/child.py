"""Work in a child process that ends at once when this process is interrupted or dies.

``python -m sdm_deflect.meshing.child PARENT MODULE ...`` runs a module as ``python -m MODULE ...`` does, bound to the
process whose id is PARENT; ``PARENT -- PROGRAM ...`` becomes another program.
"""

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from runpy import run_module

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.errors import write_errors
from sdm_deflect.base.files import hidden_folder

Array = NDArray[np.generic]
Arrays = Mapping[str, Array]
CHILD, PR_SET_PDEATHSIG = "sdm_deflect.meshing.child", 1
QUESTION, ANSWER = "question.npz", "answer.npz"


class MeshingError(RuntimeError):
    """No usable mesh could be made; the message says which step failed and why."""


class LateError(MeshingError):
    """A step took too long; on a faster or less busy machine the same input may succeed."""


def end_with(parent: int) -> None:
    """Let this process be killed when its parent ends, even by a kill that no one can catch; on Linux."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it ended before it could be watched
            os.kill(os.getpid(), signal.SIGKILL)


@dataclass(frozen=True, slots=True)
class Pending:
    """Work that a child process does while this process goes on."""

    module: str
    folder: Path
    process: subprocess.Popen[bytes]

    def answer(self, seconds: float) -> dict[str, Array]:
        """Wait at most `seconds` for the child's arrays; MeshingError, with its last line, if it fails or is late."""
        try:
            _, complaint = self.process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            raise LateError(f"{self.module} took more than {seconds:g} s") from None
        if self.process.returncode:
            lines = complaint.decode(errors="replace").strip().splitlines() or ["no message"]
            raise MeshingError(f"{self.module} ended with code {self.process.returncode}: {lines[-1]}")
        with np.load(self.folder / ANSWER, allow_pickle=False) as stored:
            return dict(stored)


@contextmanager
def start(module: str, arrays: Arrays) -> Iterator[Pending]:
    """Start ``python -m module`` on arrays, a child that calls `serve`; it is killed when the context ends.

    Mesh generators run for minutes inside compiled code that no signal can stop; a process can be killed.
    """
    with hidden_folder() as folder:
        with write_errors(folder):
            np.savez(folder / QUESTION, **arrays)  # type: ignore[arg-type]
        files = (str(folder / QUESTION), str(folder / ANSWER))
        # Its own session: the terminal's Ctrl-C reaches this process only, which then kills the child.
        with subprocess.Popen(
            [sys.executable, "-m", CHILD, str(os.getpid()), module, *files],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        ) as process:
            try:
                yield Pending(module, folder, process)
            finally:
                process.kill()
                process.wait()


def call(module: str, arrays: Arrays, seconds: float) -> dict[str, Array]:
    """Run ``python -m module`` on arrays and return the arrays that it answers with, as `Pending.answer` does."""
    with start(module, arrays) as pending:
        return pending.answer(seconds)


def serve(work: Callable[[Arrays], Arrays]) -> None:
    """Serve as the child: read arrays, work, and answer arrays with peak memory (bytes) and processor seconds."""
    with np.load(sys.argv[1], allow_pickle=False) as stored:
        question = dict(stored)
    answer = work(question)
    used = {"peak_bytes": np.array(peak_bytes()), "processor_seconds": np.array(time.process_time())}
    np.savez(sys.argv[2], **answer, **used)  # type: ignore[arg-type]


def peak_bytes() -> int:
    """The largest resident memory of this process so far."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        # Unlike ru_maxrss this does not start from the parent's memory at the time of the fork.
        return 1024 * int(next(line.split()[1] for line in lines if line.startswith("VmHWM:")))
    except (OSError, StopIteration):
        import resource

        return (1 if sys.platform == "darwin" else 1024) * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    end_with(int(sys.argv[1]))
    if sys.argv[2] == "--":
        os.execvp(sys.argv[3], sys.argv[3:])
    sys.argv = sys.argv[2:]
    run_module(sys.argv[0], run_name="__main__", alter_sys=True)
