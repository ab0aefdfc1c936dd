"""How a file keeps coordinates, and that files which were read stay what they were."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError

DOUBLE = np.dtype(np.float64)


@dataclass(frozen=True, slots=True)
class Precision:
    """How the file that is to be written keeps coordinates.

    Attributes
    ----------
    real : type of its numbers; of a file that has several types, the one with the fewest bits.
    every : whether all coordinates are rounded: those of a file that is a copy of the one that was read keep their
        bits where they do not change.
    advice : where coordinates of more bits could be written.
    """

    real: np.dtype[Any] = DOUBLE
    every: bool = False
    advice: str = ""

    @property
    def is_double(self) -> bool:
        """True if the file keeps every bit."""
        return self.real.itemsize >= DOUBLE.itemsize

    def rounded(self, points: FloatArray, before: FloatArray) -> FloatArray:
        """Return points (N, 3) as the file holds them; `before` (N, 3) are those of the undeflected mesh.

        Raises InputError for coordinates that are too large for its numbers.
        """
        if self.is_double:
            return points
        with np.errstate(over="ignore"):
            found = points.astype(self.real).astype(np.float64)
        if not np.isfinite(found).all():
            raise InputError(f"coordinates up to {np.abs(points).max():.3g} are too large for {self}")
        return found if self.every else np.where(points == before, before, found)

    def resolution(self, points: FloatArray) -> float:
        """Return how far rounding moves any of some points (N, 3) at most, in any direction; 0 in double precision."""
        return 0.0 if self.is_double else float(np.finfo(self.real).eps * np.abs(points).max(initial=0.0))

    def __str__(self) -> str:
        return f"coordinates of {8 * self.real.itemsize} bits, which the file keeps; {self.advice}"


EVERY_BIT = Precision()
"""That of a file in double precision."""


State = tuple[int, int, int, int]
"""Bytes, time of the last change in nanoseconds, number of the file, device."""
States = Mapping[str, State | None]
"""By path; None: there was no such file."""
HELD = 64
"""Files that are held open, at most: a process may have no more than some hundreds."""


def states_of(paths: Iterable[Path]) -> dict[str, State | None]:
    """Return how files are now."""
    return {str(path.absolute()): _state(str(path)) for path in paths}


def check_unchanged(files: States, elsewhere: bool = False) -> None:
    """Raise InputError if a file is no longer what it was; `elsewhere`: seen from another machine, maybe."""
    for path, state in files.items():
        now = _state(path)
        if now != state and not (elsewhere and now and state and now[:2] == state[:2]):
            raise InputError(f"{path}: was changed or replaced while it was in use; run the command again")


@contextmanager
def held(paths: Iterable[Path]) -> Iterator[None]:
    """Hold files open for the block, so that no new file can get the number of one of them."""
    with ExitStack() as stack:
        for path in list(paths)[:HELD]:
            with suppress(OSError):  # reading it says what is wrong
                stack.enter_context(path.open("rb"))
        yield


def _state(path: str) -> State | None:
    try:
        found = Path(path).stat()
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns, found.st_ino, found.st_dev
