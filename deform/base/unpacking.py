"""Reading packed arrays safely: how much memory a file may take, and errors that name the file."""

import lzma
import os
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError

RATIO_VARIABLE = "SDM_DEFLECT_UNPACK_RATIO"
"""Environment variable for the largest ratio of a file's data in memory to its size on disk."""
RATIO, ALWAYS = 100.0, 1 << 26
"""That ratio by default, and the bytes that any file may take."""
Array = NDArray[Any]
DAMAGED = (
    OSError, EOFError, ValueError, TypeError, AttributeError, LookupError, ArithmeticError, MemoryError, RuntimeError,
    SyntaxError, Warning, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error, lzma.LZMAError,
)  # fmt: skip
"""All that NumPy, zipfile and their libraries raise for damaged files."""


def unpack_limit(stored: int) -> int:
    """Return the bytes of memory that data of a file of `stored` bytes may take; InputError as for `check_unpacked`.

    Packed meshes seldom take less than a tenth of their size in memory, but a damaged file may claim anything.
    """
    given = os.environ.get(RATIO_VARIABLE) or RATIO
    try:
        return max(ALWAYS, int(float(given) * stored))
    except (ValueError, OverflowError):
        raise InputError(f"{RATIO_VARIABLE} is {given!r}, expected a number such as {RATIO:g}") from None


def check_unpacked(size: int, stored: int, what: str) -> None:
    """Raise InputError if `what` takes `size` bytes of memory, too many for a file of `stored` bytes.

    Also if the ratio in the environment is not a number.
    """
    if size > unpack_limit(stored):
        raise InputError(
            f"{what} would take {size / 1e6:.3g} MB of memory from a file of {stored / 1e6:.3g} MB; the file is "
            f"damaged, or set {RATIO_VARIABLE} to more than {size / max(stored, 1):.3g}"
        )


@contextmanager
def damaged(path: Path, what: str) -> Iterator[None]:
    """Turn any error or warning in the block into an InputError that names the file and `what` it should be."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            if path.exists() and not (path.is_file() or path.is_dir()):
                raise InputError("a device or a pipe is no file to read")
            yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except DAMAGED as error:
        reason = (
            error.strerror if isinstance(error, OSError) else " ".join(str(error).partition(': "<')[0].split())[:200]
        )
        raise InputError(f"{path}: no {what}: {reason or 'it is damaged'}") from None


def read_rows(path: Path, what: str) -> tuple[list[str], NDArray[np.float64]]:
    """Return the titles and the numbers (rows, columns) of a .csv with a title line; InputError if it is no `what`."""
    with damaged(path, what), path.open(encoding="utf-8-sig") as text:
        titles = [title.strip() for title in text.readline().split(",")]
        return titles, np.loadtxt(text, delimiter=",", ndmin=2)


def read_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays of an .npz file by name.

    Raises InputError for a file that is unreadable, damaged, too large when unpacked, or that holds objects.
    """
    with damaged(path, "archive of arrays"), zipfile.ZipFile(path) as packed:
        entries = packed.infolist()
        check_unpacked(sum(entry.file_size for entry in entries), path.stat().st_size, "what is packed in it")
        arrays = ((one.filename, np.load(BytesIO(packed.read(one)), allow_pickle=False)) for one in entries)
        return {name.removesuffix(".npy"): values for name, values in arrays}
