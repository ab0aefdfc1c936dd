"""What every mesh format can do, and errors that name the file."""

import errno
import os
import re
from collections.abc import Container, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import numpy as np

from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.deform.progress import Progress, silent
from sdm_deflect.meshing.mesh import FloatArray

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of writing alone: no space, a quota, a limit of the size."""
RATIO_VARIABLE = "SDM_DEFLECT_UNPACK_RATIO"
"""The environment variable for a larger ratio of what a file's data take in memory to the file's size."""
RATIO, ALWAYS = 100.0, 1 << 26
"""That ratio where the variable is not set, and bytes that any file may take."""


class MeshFileError(RuntimeError):
    """A mesh file is damaged, or holds what we cannot read; the message names the file and what is wrong."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


def printable(text: str) -> str:
    """Return text in which characters that command a terminal are shown as escapes: names in files may hold any."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


class Format(Protocol):
    """Reads, rewrites and writes the files of one format."""

    @property
    def name(self) -> str:
        """What users call it, such as ``"su2"``."""

    @property
    def suffixes(self) -> tuple[str, ...]:
        """The suffixes of its files, such as ``(".su2",)``; an OpenFOAM case is a folder."""

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """Return the mesh in a file.

        Raises MeshFileError if the file is missing, truncated, damaged, or not of this format.
        """

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """Write a copy of the file `source` with coordinates `points` (N, 3); all other bytes stay.

        `out` appears whole or not at all, and is never `source`. Coordinates that did not change keep their bytes.
        """

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """Write a mesh that came from elsewhere; return a sentence for each thing that the format cannot hold."""


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Name the file in every error that its content causes in the block.

    Raises MeshFileError: in place of a MeshFileError, a ValueError, a MemoryError or an OSError, as ``"file: what is
    wrong"``; an OSError of a full disk passes, because it is of another file.
    """
    try:
        yield
    except OSError as error:
        if error.errno in FULL:
            raise
        raise MeshFileError(f"{path}: {error.strerror or error}") from error
    except MemoryError as error:
        raise MeshFileError(f"{path}: its data need more memory than there is") from error
    except (MeshFileError, ValueError) as error:
        raise MeshFileError(f"{path}: {error}") from error


def unpack_limit(stored: int) -> int:
    """Return how many bytes of memory the data of a file of `stored` bytes may take; MeshFileError as `check_unpacked`.

    Packed data of meshes seldom take less than a tenth of what they take in memory; damage may claim anything.
    """
    given = os.environ.get(RATIO_VARIABLE) or RATIO
    try:
        return max(ALWAYS, int(float(given) * stored))
    except (ValueError, OverflowError):
        raise MeshFileError(f"{RATIO_VARIABLE} is {given!r}, expected a number such as {RATIO:g}") from None


def check_unpacked(size: int, stored: int, what: str) -> None:
    """Refuse `what` if it would take `size` bytes of memory, too many for a file of `stored` bytes.

    Raises MeshFileError: also if the ratio that the environment gives is no number.
    """
    if size > unpack_limit(stored):
        raise MeshFileError(
            f"{what} would take {size / 1e6:.3g} MB of memory from a file of {stored / 1e6:.3g} MB; the file is "
            f"damaged, or set {RATIO_VARIABLE} to more than {size / max(stored, 1):.3g}"
        )


def fitting_names(names: Sequence[str], unfit: str, reserved: Container[str] = ()) -> dict[str, str]:
    """Name of each patch in a file: its own where nothing in it matches `unfit`, else one that is not taken."""
    found: dict[str, str] = {}
    for name in names:
        fitting = re.sub(unfit, "_", name) or "_"
        while fitting in reserved or (fitting != name and (fitting in names or fitting in found.values())):
            fitting += "_"
        found[name] = fitting
    return found


def check_points(points: FloatArray, count: int) -> None:
    """Refuse coordinates of another number of points than `count`, and such as are not finite, with a ValueError."""
    if points.shape != (count, 3):
        raise ValueError(f"the file has {count} points, but coordinates {points.shape} were given")
    if bad := np.count_nonzero(~np.isfinite(points).all(axis=1)):
        raise ValueError(f"{bad} of the {count} points to write are not finite")
