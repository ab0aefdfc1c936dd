"""Workers in other processes and on other machines: Dask distributed, the engine that clusters run.

A piece of work is a function of what all share and of its item, and comes to the same however often it is done: when a
worker is lost, Dask gives its pieces to others.
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
from dataclasses import dataclass
from importlib.metadata import version
from multiprocessing import resource_tracker
from pathlib import Path
from time import monotonic, sleep
from typing import Any

from sdm_deflect.deform.base.errors import InputError, LostError
from sdm_deflect.deform.base.threads import HERE, Runner
from sdm_deflect.meshing.files import hidden_folder

from .progress import Stopwatch

AHEAD = 3
"""Pieces for each thread of the workers that are handed out, or done and not taken: what limits the memory."""
LOSSES = 10
"""Workers that may be lost over one and the same piece; a next one ends the run."""
ANSWER, ARRIVAL = 15, 60
"""Seconds in which a scheduler must answer, and its first worker arrive."""
LEAST = 400_000_000
"""Bytes of memory of a worker: 200 MB are its libraries."""
STARTS = 3
"""How often workers are started while one of them ends before it has begun."""
SAME = ("sdm-deflect", "numpy", "numba")
"""Packages of which workers must have our version."""
QUIET = {"distributed": "critical", "distributed.client": "critical", "tornado": "critical"}
SETTINGS: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": LOSSES,
    "distributed.admin.large-graph-warning-threshold": "1GB",  # what all share is kept by the scheduler
    "distributed.scheduler.http.routes": [],  # pages, for which no certificate is needed
    "distributed.worker.http.routes": [],
    "distributed.nanny.pre-spawn-environ": {
        "MALLOC_TRIM_THRESHOLD_": 65536,
        "DASK_LOGGING__DISTRIBUTED": "critical",
        **dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), 1),
    },
}
"""Dask's own settings, for workers that are started here."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which workers are to do the work: so many processes here, those of a scheduler elsewhere, or none.

    Attributes
    ----------
    workers : number of processes to start on this machine.
    scheduler : address of a scheduler that runs, such as ``"tcp://node7:8786"``, or its file ``"scheduler.json"``.
    memory : bytes for each worker that is started, such as ``"2GB"``; by default all have as much as this process.
    """

    workers: int | None = None
    scheduler: str | None = None
    memory: str | None = None

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers {self.workers}: must be at least 1")
        if self.workers is not None and self.scheduler is not None:
            raise InputError("--workers starts processes here and --scheduler joins others: give one of them")
        if self.memory is not None and self.workers is None:
            raise InputError("--worker-memory is for workers that are started here: give --workers as well")


class Cluster:
    """The workers of a scheduler (`Runner`)."""

    shares_memory = False

    def __init__(self, client: Any) -> None:
        self.client = client
        self._sent: tuple[Any, Any] = None, None

    def map(self, work: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any]) -> Iterator[Any]:
        """See `Runner.map`; LostError if the scheduler is gone, or a piece has cost too many workers."""
        with _losses(self.client):
            room, waiting = AHEAD * max(1, sum(self.client.nthreads().values())), deque[Any]()
            common = self._common(shared)
            try:
                for item in items:
                    waiting.append(self.client.submit(work, common, item, pure=False))
                    if len(waiting) > room:
                        yield waiting.popleft().result()
                while waiting:
                    yield waiting.popleft().result()
            finally:
                for one in waiting:
                    one.release()

    def _common(self, shared: Any) -> Any:
        """Send what pieces share, unless it was the last that was sent.

        It is the result of a task: if the workers that hold it are lost, the scheduler has others make it again.
        """
        if self._sent[1] is None or self._sent[0] is not shared:
            self._sent = shared, self.client.submit(pickle.loads, pickle.dumps(shared), pure=False)
        return self._sent[1]

    def check(self, source: Path, out: Path) -> None:
        """Raise InputError unless all workers have our versions, see the file, and the folder for what is written."""
        python = ".".join(platform.python_version_tuple()[:2])
        with _losses(self.client):
            found = self.client.run(platform.python_version)
            _alike("Python", python, {name: own.rpartition(".")[0] for name, own in found.items()})
            for package in SAME:
                _alike(package, version(package), self.client.run(version, package, on_error="return"))
            files = source.resolve(), source.stat().st_size, out.resolve()
            seen = self.client.run(_missing, *files)
        blind = {name: why for name, why in seen.items() if why}
        for name, why in blind.items():
            raise InputError(
                f"{len(blind)} of {len(seen)} workers cannot {why}, such as {name}: put it on a file system that all "
                "of them see"
            )


@contextmanager
def workers(wanted: Wanted, watch: Stopwatch, source: Path, out: Path) -> Iterator[Runner]:
    """Give the workers that are wanted for a file and the folder of what is written; threads where none are.

    Raises InputError if they cannot be had, or are not fit for the work.
    """
    if wanted.workers is None and wanted.scheduler is None:
        yield HERE
        return
    with ExitStack() as stack:
        with watch.stage("workers") as progress:
            _load()
            with suppress(ValueError):  # not the main thread
                # Python's own setting, which Gmsh undoes: else a connection that is closed would end this process
                signal.signal(signal.SIGPIPE, signal.SIG_IGN)
            client = stack.enter_context(_joined(wanted.scheduler) if wanted.scheduler else _started(wanted))
            cluster = Cluster(client)
            if wanted.scheduler:
                cluster.check(source, out)
            dashboard = f", dashboard {client.dashboard_link}" if wanted.scheduler else ""
            progress(f"{len(client.nthreads())} workers{dashboard}", 1.0)
        yield cluster


def _load() -> None:
    """Load Dask, silent unless it was loaded already; InputError if it is not installed."""
    try:
        import cryptography  # noqa: F401
        import dask

        with dask.config.set({"logging": QUIET}):
            import distributed  # noqa: F401
    except ImportError as error:
        raise InputError(f"workers need a library ({error.name}): in your clone, pip install '.[cluster]'") from None


@contextmanager
def _started(wanted: Wanted) -> Iterator[Any]:
    """Start processes on this machine, which end with this one, however it ends, and which speak to no one else."""
    import dask
    from distributed import Client, LocalCluster, Security
    from distributed.system import MEMORY_LIMIT

    count = wanted.workers or 1
    most = max(1, int(MEMORY_LIMIT) // LEAST - 1)
    if count > most:
        raise InputError(
            f"--workers {count}: this machine has memory for {most}, each with {LEAST // 10**6} MB at least"
        )
    memory = _bytes(wanted.memory) if wanted.memory else MEMORY_LIMIT // (count + 1)
    with dask.config.set(SETTINGS), hidden_folder() as folder:
        own: dict[str, Any] = {"local_directory": str(folder), "memory_limit": memory, "security": Security.temporary()}
        own |= {"dashboard_address": None, "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"}}
        with _interrupts_kept():
            cluster = _begun(lambda: LocalCluster(n_workers=count, threads_per_worker=1, **own))
        try:
            with Client(cluster, set_as_default=False, direct_to_workers=True) as client:
                yield client
        finally:
            cluster.close()


def _bytes(size: str) -> int:
    """Return a size as a number; InputError if it is none, or less than a worker needs before it works."""
    from dask.utils import parse_bytes

    with suppress(ValueError):
        if (found := int(parse_bytes(size))) >= LEAST:
            return found
    raise InputError(f"--worker-memory {size}: must be a size such as 2GB, and at least {LEAST // 10**6}MB")


def _begun(start: Callable[[], Any]) -> Any:
    """Start workers, anew if one is killed before it has begun; LostError if they do not start."""
    for _ in range(STARTS - 1):
        with suppress(RuntimeError):
            return start()
    try:
        return start()
    except RuntimeError as error:
        raise LostError(f"workers cannot be started: {error.__cause__ or error}") from None


@contextmanager
def _joined(named: str) -> Iterator[Any]:
    """Join a scheduler that runs."""
    import dask
    from distributed import Client

    with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1GB"}):
        try:
            client = Client(_address(named), timeout=ANSWER, set_as_default=False)
        except (OSError, ValueError, KeyError) as error:
            raise InputError(
                f"--scheduler {named}: no scheduler answers there ({error}); start one by: dask scheduler"
            ) from None
        with client:
            try:
                client.wait_for_workers(1, timeout=ARRIVAL)
            except TimeoutError:
                start = f"dask worker {client.scheduler.address}"
                raise InputError(f"--scheduler {named}: has no workers; start some by: {start}") from None
            yield client


def _address(named: str) -> str:
    """Return the address of a scheduler, which may be in the file that it writes when it starts."""
    if not named.endswith(".json"):
        return named
    end = monotonic() + ANSWER
    while not Path(named).exists() and monotonic() < end:
        sleep(0.1)
    return str(json.loads(Path(named).read_text(encoding="utf-8"))["address"])


@contextmanager
def _losses(client: Any) -> Iterator[None]:
    """Say what it means when the scheduler or workers are gone."""
    from distributed import KilledWorker

    try:
        yield
    except KilledWorker as error:
        raise LostError(
            f"{error.allowed_failures + 1} workers ended over one piece of the mesh, perhaps for want of memory: give "
            "each more, or start fewer"
        ) from None
    except (CancelledError, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        where = client.scheduler.address if client.scheduler else "there"
        raise LostError(f"the scheduler at {where} is gone: start it again, and then this command") from None


def _alike(package: str, own: str, found: dict[str, Any]) -> None:
    """Raise InputError that names the first worker with another version than our own of a package."""
    for name, other in found.items():
        if other != own:
            has = "has none" if isinstance(other, Exception) else f"has {other}"
            raise InputError(f"worker {name} {has} of {package}, but {own} is needed: start it in this environment")


def _missing(source: Path, size: int, out: Path) -> str:
    """Return what a worker cannot do, or nothing."""
    try:
        if source.is_dir():
            next(source.iterdir(), None)
        elif source.stat().st_size != size:
            return f"read {source}, of which they see another"
        else:
            source.open("rb").close()
        return "" if os.access(out, os.W_OK | os.X_OK) else f"write to {out}"
    except OSError as error:
        return f"read {source} ({error.strerror})"


@contextmanager
def _interrupts_kept() -> Iterator[None]:
    """Let threads and processes that begin here never see an interruption from the terminal: it is for us alone."""
    shown = os.environ.get("PYTHONWARNINGS", "")
    os.environ["PYTHONWARNINGS"] = f"{shown},ignore:resource_tracker".lstrip(",")  # what it says when we are killed
    resource_tracker.ensure_running()  # whose start lets interruptions in again
    os.environ["PYTHONWARNINGS"] = shown
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
