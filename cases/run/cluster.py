"""Workers in other processes and on other machines, by Dask distributed.

Pieces of work can be repeated: Dask gives the pieces of a lost worker to others.
"""

import json
import os
import pickle
import platform
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import version
from multiprocessing import resource_tracker
from pathlib import Path
from time import monotonic, sleep
from typing import Any

from sdm_deflect.base.errors import InputError, LostError
from sdm_deflect.base.files import hidden_folder
from sdm_deflect.base.threads import Runner

from .output import check_installed
from .progress import Stopwatch

# Pieces per worker thread that are out, or done and not taken; workers that may be lost over the same piece.
AHEAD, LOSSES = 3, 10
# Seconds in which a scheduler must answer, and its first worker arrive.
ANSWER, ARRIVAL = 15, 60
# Bytes of memory that a worker needs; its libraries take 200 MB.
LEAST = 400_000_000
# Packages of which workers must have our version.
SAME = ("sdm-deflect", "numpy", "numba")
# Dask's own settings; it reads most where workers are started here.
SETTINGS: dict[str, Any] = {
    "logging": dict.fromkeys(("distributed", "distributed.client", "tornado"), "critical"),
    "distributed.scheduler.allowed-failures": LOSSES,
    "distributed.admin.large-graph-warning-threshold": "1GB",  # what all share is kept by the scheduler
    "distributed.scheduler.http.routes": [],  # pages, for which no certificate is needed
    "distributed.worker.http.routes": [],
    "distributed.nanny.pre-spawn-environ": {
        **dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), 1),
        "MALLOC_TRIM_THRESHOLD_": 65536,
        "DASK_LOGGING__DISTRIBUTED": "critical",
    },
}


class Cluster:
    """The workers of a scheduler (`Runner`)."""

    shares_memory = False

    def __init__(self, client: Any) -> None:
        self.client = client
        self._sent: tuple[Any, Any] = None, None

    def map(self, work: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any]) -> Iterator[Any]:
        """See `Runner.map`; LostError if the scheduler is lost, or a piece killed too many workers."""
        with _losses(self.client):
            room, waiting = AHEAD * max(1, sum(self.client.nthreads().values())), deque[Any]()
            if self._sent[0] is not shared:  # sent once, as a task: if its workers are lost, others make it again
                self._sent = shared, self.client.submit(pickle.loads, pickle.dumps(shared), pure=False)
            try:
                for item in items:
                    waiting.append(self.client.submit(work, self._sent[1], item, pure=False))
                    if len(waiting) > room:
                        yield waiting.popleft().result()
                while waiting:
                    yield waiting.popleft().result()
            finally:
                for future in waiting:
                    future.release()

    def check(self, source: Path, out: Path) -> None:
        """Raise InputError unless all workers have this process's versions, see the file, and may write into `out`."""
        asked: list[Any] = [("Python", platform.python_version()), *((name, version(name), name) for name in SAME)]
        with _losses(self.client):
            for package, version_here, *words in asked:
                versions_there = self.client.run(
                    version if words else platform.python_version, *words, on_error="return"
                )
                for name, there in versions_there.items():
                    if there != version_here:
                        said = f"worker {name} has {'none' if isinstance(there, Exception) else there} of {package}"
                        raise InputError(f"{said}, but {version_here} is needed: start it in this environment")
            seen = self.client.run(_missing, source.resolve(), source.stat().st_size, out.resolve())
        if blind := [f"{why}, such as {name}" for name, why in seen.items() if why]:
            said = f"{len(blind)} of {len(seen)} workers cannot {blind[0]}"
            raise InputError(f"{said}: put it on a file system that all of them see")


@contextmanager
def workers(
    watch: Stopwatch, source: Path, out: Path, *, count: int = 0, scheduler: str = "", memory: str = ""
) -> Iterator[Runner]:
    """Yield workers for a file and an output folder.

    Parameters
    ----------
    count : Number of processes to start on this machine.
    scheduler : Address of a running scheduler, such as ``"tcp://node7:8786"``, or its file ``"scheduler.json"``.
    memory : Memory of each started process, such as ``"2GB"``; by default as much as this process may have.

    Raises InputError if workers cannot be started or reached, or are unfit for the work.
    """
    if count and scheduler:
        raise InputError("--workers starts processes here and --scheduler joins others: give one of them")
    if memory and not count:
        raise InputError("--worker-memory is for workers that are started here: give --workers as well")
    check_installed("cluster")
    import dask

    with dask.config.set(SETTINGS), ExitStack() as stack:
        with watch.stage("workers") as progress:
            with suppress(ValueError):  # not the main thread
                # Python's own setting, which Gmsh undoes: else a connection that is closed would end this process
                signal.signal(signal.SIGPIPE, signal.SIG_IGN)
            client = stack.enter_context(_client(scheduler) if scheduler else _local_scheduler(count, memory))
            cluster, said = Cluster(client), f"{len(client.nthreads())} workers"
            if scheduler:
                cluster.check(source, out)
                said += f", dashboard {client.dashboard_link}"
            progress(said, 1.0)
        yield cluster


@contextmanager
def _local_scheduler(count: int, wanted: str) -> Iterator[Any]:
    """Start processes on this machine; they end whenever this process ends, and accept no other user."""
    from dask.utils import parse_bytes
    from distributed import Client, LocalCluster, Security
    from distributed.system import MEMORY_LIMIT

    with hidden_folder() as folder:
        if count > (most := max(1, int(MEMORY_LIMIT) // LEAST - 1)):
            raise InputError(
                f"--workers {count}: this machine has memory for {most}, each with {LEAST // 10**6} MB at least"
            )
        memory = 0
        with suppress(ValueError):
            memory = int(parse_bytes(wanted or MEMORY_LIMIT // (count + 1)))
        if wanted and memory < LEAST:
            raise InputError(f"--worker-memory {wanted}: must be a size such as 2GB, and at least {LEAST // 10**6}MB")
        options: dict[str, Any] = {
            "local_directory": str(folder),
            "memory_limit": memory,
            "security": Security.temporary(),
        }
        options |= {"dashboard_address": None, "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"}}
        try:
            with _block_interrupts():
                cluster = LocalCluster(n_workers=count, threads_per_worker=1, **options)
        except RuntimeError as error:
            raise LostError(f"workers cannot be started: {error.__cause__ or error}; start fewer") from None
        with cluster, Client(cluster, set_as_default=False, direct_to_workers=True) as client:
            yield client


@contextmanager
def _client(named: str) -> Iterator[Any]:
    from distributed import Client

    file, end = Path(named) if named.endswith(".json") else None, monotonic() + ANSWER
    while file and not file.exists() and monotonic() < end:
        sleep(0.1)
    try:
        address = json.loads(file.read_text("utf-8"))["address"] if file else named
        client = Client(address, timeout=ANSWER, set_as_default=False)
    except (OSError, ValueError, KeyError) as error:
        said = f"--scheduler {named}: no scheduler answers there ({error})"
        raise InputError(f"{said}; start one by: dask scheduler") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=ARRIVAL)
        except TimeoutError:
            start = f"dask worker {client.scheduler.address}"
            raise InputError(f"--scheduler {named}: has no workers; start some by: {start}") from None
        yield client


@contextmanager
def _losses(client: Any) -> Iterator[None]:
    from distributed import KilledWorker

    try:
        yield
    except KilledWorker as error:
        ended = f"{error.allowed_failures + 1} workers ended over one piece of the mesh, perhaps for want of memory"
        raise LostError(f"{ended}: give each more, or start fewer") from None
    except (CancelledError, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        where = client.scheduler.address if client.scheduler else "there"
        raise LostError(f"the scheduler at {where} is gone: start it again, and then this command") from None


def _missing(source: Path, size: int, out: Path) -> str:
    """Return a sentence on what a worker cannot do, or nothing."""
    try:
        if source.stat().st_size != size and not source.is_dir():
            return f"read {source}, of which they see another"
        os.close(os.open(source, os.O_RDONLY))
        return "" if os.access(out, os.W_OK | os.X_OK) else f"write to {out}"
    except OSError as error:
        return f"read {source} ({error.strerror})"


@contextmanager
def _block_interrupts() -> Iterator[None]:
    """Block interrupts from the terminal in threads and processes that are started within the block."""
    shown = os.environ.get("PYTHONWARNINGS", "")
    os.environ["PYTHONWARNINGS"] = f"{shown},ignore:resource_tracker".lstrip(",")  # what it says when we are killed
    resource_tracker.ensure_running()  # whose start lets interruptions in again
    os.environ["PYTHONWARNINGS"] = shown
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
