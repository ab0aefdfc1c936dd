"""A mesh that is read in pieces, because it may be larger than memory, and whoever works on the pieces."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.base.threads import available_threads
from sdm_deflect.deform.mesh.cells import Cells, Patch, Periodic, Zone
from sdm_deflect.deform.mesh.polyhedra import SomePolyhedra
from sdm_deflect.deform.mesh.unchanged import States


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
                for one in waiting:
                    one.cancel()


HERE = Threads()
"""The runner of whoever names no other."""


class Pieces(Protocol):
    """Points and cells of a mesh file, none of them in memory: a small value, which other processes can be sent."""

    @property
    def source(self) -> str:
        """Path of the file."""

    @property
    def files(self) -> States:
        """The files that are read, as they were at first (`check_unchanged`)."""

    @property
    def points(self) -> int:
        """Number of points."""

    @property
    def blocks(self) -> tuple[tuple[str, int], ...]:
        """Shape and number of the cells of each block; the shape of polyhedra is ``"polyhedron"``."""

    def coordinates(self, start: int, stop: int) -> FloatArray:
        """Return the coordinates (stop - start, 3) of points start to stop - 1."""

    def places(self, nodes: IntArray) -> FloatArray:
        """Return the coordinates (K, 3) of points in any order, as often as they are named."""

    def cells_of(self, block: int, start: int, stop: int) -> Cells | SomePolyhedra:
        """Return cells start to stop - 1 of a block, with the mesh's numbers of nodes, counted from 0."""

    def rewrite(
        self, nodes: IntArray, points: FloatArray, out: Path, progress: Progress = silent, runner: Runner = HERE
    ) -> None:
        """Write a copy of the file with sorted nodes (K,) at `points` (K, 3); all other bytes stay.

        `out` appears whole or not at all. Coordinates that did not change keep their bytes.
        """


@dataclass(frozen=True, slots=True, eq=False)
class MeshInPieces:
    """A mesh of which the boundary is in memory, and all else in a file.

    Attributes
    ----------
    name : the file, for messages.
    pieces : points and cells.
    patches, zones, notes, periodic : those of `Mesh`, as reading the whole file gives them.
    """

    name: str
    pieces: Pieces
    patches: tuple[Patch, ...] = field(repr=False)
    zones: tuple[Zone, ...]
    notes: tuple[str, ...] = ()
    periodic: tuple[Periodic, ...] = field(default=(), repr=False)
