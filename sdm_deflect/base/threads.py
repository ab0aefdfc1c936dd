"""Sharing work among threads, sizes of pieces, and progress.

Compiled code runs without the interpreter lock, so Python's threads suffice. There is no OpenMP pool, which may not
survive a fork, and an interrupt is noticed between two chunks.
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
import scipy.linalg  # noqa: F401 - loads SciPy's BLAS for the controller below
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped, unused-ignore]

# Called with a short text and the fraction done (0 to 1, or nan when unknown).
Progress = Callable[[str, float], None]


# Shows a stage of a run while its context lasts; the context gives the stage's `Progress`.
Stage = Callable[[str], AbstractContextManager[Progress]]
# Number of pairs (about 0.4 ms) below which a second thread costs more than it saves.
SERIAL_PAIRS = 1_000_000
# Number of pairs (about 2 ms) in a chunk: few enough to share evenly, enough to hide the cost of a hand-over.
CHUNK_PAIRS = 4_000_000


def unseen(_: str) -> AbstractContextManager[Progress]:
    """Show nothing."""
    return nullcontext(silent)


def silent(text: str, fraction: float) -> None:
    """Report nothing."""


def in_chunks(
    work: Callable[[int, int], None],
    rows: int,
    pairs_per_row: int,
    threads: int | None = None,
    progress: Progress = silent,
) -> None:
    """Call work(low, high) for consecutive chunks of range(rows), on `threads` threads."""
    count = threads or available_threads()
    if (count == 1 and progress is silent) or rows * pairs_per_row < SERIAL_PAIRS:
        work(0, rows)
        return
    size = max(1, min(CHUNK_PAIRS // max(1, pairs_per_row), -(-rows // count)))
    starts = range(0, rows, size)
    jobs = [_pool(os.getpid(), count).submit(work, i, min(rows, i + size)) for i in starts]
    _wait(jobs, progress)


def available_threads() -> int:
    """Return the number of threads: the cores, or NUMBA_NUM_THREADS."""
    return int(numba.config.NUMBA_NUM_THREADS)


class Runner(Protocol):
    """Processes pieces of a mesh."""

    @property
    def shares_memory(self) -> bool:
        """Whether the work shares this process's memory."""

    def map(self, work: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any]) -> Iterator[Any]:
        """Yield work(shared, item) for each item in order; `shared` is sent once."""


class Threads:
    """Threads of this process; no more results wait than there are threads."""

    shares_memory = True

    def map(self, work: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any]) -> Iterator[Any]:
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


# The default runner.
HERE = Threads()


def _wait(jobs: list[Future[None]], progress: Progress) -> None:
    """Wait for all jobs; after an error or an interrupt cancel those that have not begun."""
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
    """Return the pool of a process: a forked child does not inherit its parent's threads."""
    return ThreadPoolExecutor(threads, thread_name_prefix="deform")


@contextmanager
def single_threaded_blas() -> Iterator[None]:
    """Limit BLAS to one thread: its threads compete with the program's, and its sums depend on their number."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@dataclass(frozen=True, slots=True)
class SizeLimits:
    """Largest sizes of data in memory, in one message, or in a page.

    Attributes
    ----------
    file : Bytes of a mesh file that is read in one piece.
    in_memory : Points in memory while cells are read, by a runner that shares it.
    points, cells : Points and cells in one piece.
    sent, sent_pairs : Points sent to be evaluated at a time, and pairs with centres below which none are sent.
    matrix : Entries of a view's evaluation matrix, 256 MB; larger sums are computed at every angle.
    shown : Cells of a mesh that a report's file holds completely.
    """

    file: int = 1 << 25
    in_memory: int = 1 << 23
    points: int = 1 << 20
    cells: int = 1 << 19
    sent: int = 1 << 18
    sent_pairs: int = 1 << 28
    matrix: int = 1 << 25
    shown: int = 100_000


# Limits of this process.
LIMITS = SizeLimits()
