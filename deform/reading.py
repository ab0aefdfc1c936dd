"""How much memory a file may take, and arrays read from .npz files within that."""

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
from math import prod
from pathlib import Path

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from sdm_deflect.deform.errors import InputError

VARIABLE = "SDM_DEFLECT_READ_RATIO"
RATIO = 64.0
SMALLEST = 1 << 18
"""Bytes: shorter files are allowed as much as one of this length."""
HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
DAMAGED = (
    OSError, EOFError, ValueError, TypeError, AttributeError, LookupError, ArithmeticError, MemoryError, RuntimeError,
    SyntaxError, Warning, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error, lzma.LZMAError,
)  # fmt: skip
"""All that NumPy, zipfile and what they rest on raise for damaged files."""


def ratio() -> float:
    """Return how many times its own length a file may take in memory; InputError if the variable is no such number."""
    text = os.environ.get(VARIABLE, str(RATIO))
    try:
        found = float(text)
    except ValueError:
        found = 0.0
    if not 1.0 <= found < 1e9:
        raise InputError(f"{VARIABLE} = {text}: must be a number from 1 on, such as {RATIO:g}")
    return found


def allowed(length: int) -> int:
    """Return how many bytes of memory the content of a file of `length` bytes may take."""
    return int(ratio() * max(length, SMALLEST))


def check_size(size: int, length: int, what: str) -> None:
    """Refuse `what`, which takes `size` bytes in memory, in a file of `length` bytes, with an InputError."""
    if size > allowed(length):
        raise InputError(
            f"{what} would take more than {ratio():g} times the {length} bytes of the file; if it is sound, set "
            f"{VARIABLE} to a larger number"
        )


@contextmanager
def damaged(path: Path, what: str) -> Iterator[None]:
    """Name a file, and `what` it should be, in place of whatever reading it raises or warns of, with an InputError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except DAMAGED as error:
        reason = error.strerror if isinstance(error, OSError) else " ".join(str(error).split())[:200]
        raise InputError(f"{path}: no {what}: {reason or 'it is damaged'}") from None


def read_arrays(path: Path, names: tuple[str, ...]) -> list[NDArray[np.generic]]:
    """Return arrays of real numbers of an .npz file; to be called within `damaged`."""
    length, found = path.stat().st_size, []
    with zipfile.ZipFile(path) as packed:
        for name in names:
            entry = packed.getinfo(f"{name}.npy")
            check_size(entry.file_size, length, name)
            found.append(_array(packed.read(entry), name))
    return found


def _array(data: bytes, name: str) -> NDArray[np.generic]:
    file = BytesIO(data)
    shape, by_columns, kind = HEADERS[npy.read_magic(file)](file)
    if kind.kind not in "biuf":
        raise InputError(f"{name} must be real numbers, not {kind}")
    if min(shape, default=0) < 0 or prod(shape) * kind.itemsize != len(data) - file.tell():
        raise InputError(f"{name} {shape} does not fill its place; the file is damaged")
    return np.frombuffer(data, kind, offset=file.tell()).reshape(shape, order="F" if by_columns else "C")
