"""What a user is told in one sentence instead of a traceback.

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


def printable(text: str) -> str:
    """Return text in which characters that command a terminal are shown as escapes: names in files may hold any."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


LONGEST, MOST, FEW = 80, 900, 5
"""Letters of a value and of a message, and names of a list: damaged files hold any number of names of any length."""


def sentence(text: str) -> str:
    """Return a message as it may be printed; of a very long one its beginning and its end."""
    shown = printable(text)
    return shown if len(shown) <= MOST else f"{shown[: MOST // 2]} ... {shown[-MOST // 3 :]}"


class InputError(ValueError):
    """A mesh, a name or a value that was given cannot be used; the message says which and what would be right."""

    def __init__(self, message: str) -> None:
        super().__init__(sentence(message))


class LostError(RuntimeError):
    """What a run needs was lost under way; its input may be right, and the same command may succeed."""


def shortened(value: object) -> str:
    """Return a value as Python writes it, at most a line of it."""
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def short_list(names: Iterable[object]) -> str:
    """Return names with commas; of many the first few and the number of the others."""
    own = [str(name) for name in names]
    return ", ".join(own[:FEW]) + (f" and {len(own) - FEW} more" if len(own) > FEW else "")


def nearest(name: str, known: Collection[str], noun: str = "known are") -> str:
    """Return the end of a sentence about a name that is not known: those that come near it, else all."""
    close = get_close_matches(name, list(known), n=3)
    return f"did you mean {', '.join(close)}?" if close else f"{noun} {short_list(known) or 'none'}"


RATIO_VARIABLE = "SDM_DEFLECT_UNPACK_RATIO"
"""The environment variable for a larger ratio of what a file's data take in memory to the file's size."""
RATIO, ALWAYS = 100.0, 1 << 26
"""That ratio where the variable is not set, and bytes that any file may take."""
Array = NDArray[Any]
DAMAGED = (
    OSError, EOFError, ValueError, TypeError, AttributeError, LookupError, ArithmeticError, MemoryError, RuntimeError,
    SyntaxError, Warning, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error, lzma.LZMAError,
)  # fmt: skip
"""All that NumPy, zipfile and what they rest on raise for damaged files."""


def unpack_limit(stored: int) -> int:
    """Return how many bytes of memory the data of a file of `stored` bytes may take; InputError as `check_unpacked`.

    Packed data of meshes seldom take less than a tenth of what they take in memory; damage may claim anything.
    """
    given = os.environ.get(RATIO_VARIABLE) or RATIO
    try:
        return max(ALWAYS, int(float(given) * stored))
    except (ValueError, OverflowError):
        raise InputError(f"{RATIO_VARIABLE} is {given!r}, expected a number such as {RATIO:g}") from None


def check_unpacked(size: int, stored: int, what: str) -> None:
    """Refuse `what` if it would take `size` bytes of memory, too many for a file of `stored` bytes.

    Raises InputError: also if the ratio that the environment gives is no number.
    """
    if size > unpack_limit(stored):
        raise InputError(
            f"{what} would take {size / 1e6:.3g} MB of memory from a file of {stored / 1e6:.3g} MB; the file is "
            f"damaged, or set {RATIO_VARIABLE} to more than {size / max(stored, 1):.3g}"
        )


@contextmanager
def damaged(path: Path, what: str) -> Iterator[None]:
    """Name a file, and `what` it should be, in place of whatever reading it raises or warns of, with an InputError."""
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

    Raises InputError if it cannot be read, is damaged or larger than its length makes likely, or holds objects.
    """
    with damaged(path, "archive of arrays"), zipfile.ZipFile(path) as packed:
        entries = packed.infolist()
        check_unpacked(sum(entry.file_size for entry in entries), path.stat().st_size, "what is packed in it")
        arrays = ((one.filename, np.load(BytesIO(packed.read(one)), allow_pickle=False)) for one in entries)
        return {name.removesuffix(".npy"): values for name, values in arrays}
