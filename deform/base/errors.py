"""Errors that a user sees as one sentence instead of a traceback.

Also how much memory a file may take, and arrays read from .npz files within that.
"""

import lzma
import os
import signal
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

REQUESTS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that ask a command to end; Windows knows no SIGHUP."""
LONGEST, MOST, FEW = 80, 900, 5
"""Largest number of letters of a value and of a message, and of names in a list: damaged files may hold anything."""
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


def printable(text: str) -> str:
    """Return text with control characters escaped: names in files may hold any."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def sentence(text: str) -> str:
    """Return a message for printing; a very long one loses its middle."""
    shown = printable(text)
    return shown if len(shown) <= MOST else f"{shown[: MOST // 2]} ... {shown[-MOST // 3 :]}"


class InputError(ValueError):
    """An input cannot be used; the message says which value, and what would be right."""

    def __init__(self, message: str) -> None:
        super().__init__(sentence(message))


class LostError(RuntimeError):
    """Something that a run needs was lost; the same command may succeed again."""


def shortened(value: object) -> str:
    """Return `repr(value)`, shortened to a line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def short_list(names: Iterable[object]) -> str:
    """Return names with commas; a long list ends with the number of further names."""
    own = [str(name) for name in names]
    return ", ".join(own[:FEW]) + (f" and {len(own) - FEW} more" if len(own) > FEW else "")


def nearest(name: str, known: Collection[str], noun: str = "known are") -> str:
    """Return the end of a sentence about an unknown name: the most similar known ones, or all."""
    close = get_close_matches(name, list(known), n=3)
    return f"did you mean {', '.join(close)}?" if close else f"{noun} {short_list(known) or 'none'}"


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


def read_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays of an .npz file by name.

    Raises InputError for a file that is unreadable, damaged, too large when unpacked, or that holds objects.
    """
    with damaged(path, "archive of arrays"), zipfile.ZipFile(path) as packed:
        entries = packed.infolist()
        check_unpacked(sum(entry.file_size for entry in entries), path.stat().st_size, "what is packed in it")
        arrays = ((one.filename, np.load(BytesIO(packed.read(one)), allow_pickle=False)) for one in entries)
        return {name.removesuffix(".npy"): values for name, values in arrays}
