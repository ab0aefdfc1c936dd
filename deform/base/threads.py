"""How work is shared out among threads, how large pieces of it are, and who is told of its progress.

Compiled code runs without the interpreter lock, so Python's own threads serve: no second pool of OpenMP
threads that survives a fork badly, and an interrupt is noticed between two chunks.
"""

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import numba
import scipy.linalg  # noqa: F401 - loads SciPy's BLAS, so that the controller below finds it
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped, unused-ignore]

Progress = Callable[[str, float], None]
"""Called with a short text and the fraction done (0 to 1, or nan when unknown)."""


Stage = Callable[[str], AbstractContextManager[Progress]]
"""Shows a stage of a run while its context lasts, which gives what takes the stage's progress."""


def unseen(_: str) -> AbstractContextManager[Progress]:
    """Show nothing."""
    return nullcontext(silent)


def silent(text: str, fraction: float) -> None:
    """Report nothing."""


SERIAL_PAIRS = 400_000  # below about 0.2 ms of work a second thread costs more than it saves
CHUNK_PAIRS = 4_000_000  # about 2 ms: short enough to share evenly, long enough to hide the hand-over


def in_chunks(
    work: Callable[[int, int], None],
    rows: int,
    pairs_per_row: int,
    threads: int | None = None,
    progress: Progress = silent,
) -> None:
    """Call work(low, high) for consecutive chunks that cover range(rows), on `threads` threads."""
    count = threads or available_threads()
    if (count == 1 and progress is silent) or rows * pairs_per_row < SERIAL_PAIRS:
        work(0, rows)
        return
    size = max(1, min(CHUNK_PAIRS // max(1, pairs_per_row), -(-rows // count)))
    starts = range(0, rows, size)
    jobs = [_pool(os.getpid(), count).submit(work, i, min(rows, i + size)) for i in starts]
    _wait(jobs, progress)


def available_threads() -> int:
    """Return how many threads work is shared among: the cores, or what NUMBA_NUM_THREADS says."""
    return int(numba.config.NUMBA_NUM_THREADS)


class Runner(Protocol):
    """Whoever works on pieces; whether that is done in the memory of this process."""

    @property
    def shares_memory(self) -> bool:
        """Whether arrays are not sent anywhere."""

    def map(self, work: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any]) -> Iterator[Any]:
        """Yield work(shared, item) for each item, in their order; `shared` is sent once."""


class Threads:
    """Threads of this process; only as many results as there are threads wait to be taken."""

    shares_memory = True

    def map(self, work: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any]) -> Iterator[Any]:
        """See `Runner.map`."""
        count = available_threads()
        waiting: deque[Future[Any]] = deque()
        with ThreadPoolExecutor(count, thread_name_prefix="pieces") as pool:
            try:
                for item in items:
                    waiting.append(pool.submit(work, shared, item))
                    if len(waiting) > count:
                        yield waiting.popleft().result()
                while waiting:
                    yield waiting.popleft().result()
            finally:
                for future in waiting:
                    future.cancel()


HERE = Threads()
"""The default runner."""


def _wait(jobs: list[Future[None]], progress: Progress) -> None:
    """Wait for all jobs; on an error or an interrupt drop those that have not begun."""
    try:
        for done, job in enumerate(as_completed(jobs), start=1):
            job.result()
            progress("kernel sums", done / len(jobs))
    except BaseException:
        for job in jobs:
            job.cancel()
        raise


@cache
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """One pool per process: a forked child has none of its parent's threads."""
    return ThreadPoolExecutor(threads, thread_name_prefix="deform")


@contextmanager
def single_threaded_blas() -> Iterator[None]:
    """Keep BLAS on one thread: its pool fights with ours for the cores, and its sums depend on its size."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@dataclass(frozen=True, slots=True)
class SizeLimits:
    """What is held in memory, sent to workers or shown at a time.

    Attributes
    ----------
    file : Bytes of a mesh file from which on it is read in pieces.
    held : Points up to so many are held in memory while cells are read, by a runner that shares it.
    points, cells : Points and cells of a piece.
    sent, sent_pairs : Points sent at a time to be evaluated elsewhere, and pairs with centres from which on they are.
    matrix : Entries of the evaluation matrix of a view, 256 MB; beyond, sums are computed at every angle.
    shown : Cells of the largest mesh that a report's file holds whole.
    """

    file: int = 1 << 25
    held: int = 1 << 23
    points: int = 1 << 20
    cells: int = 1 << 19
    sent: int = 1 << 18
    sent_pairs: int = 1 << 28
    matrix: int = 1 << 25
    shown: int = 100_000


LIMITS = SizeLimits()
"""Those of this process."""
