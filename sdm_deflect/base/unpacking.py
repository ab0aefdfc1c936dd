"""Safe reading of packed arrays: limits of memory, and errors that name the file."""

import csv
import lzma
import os
import re
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from .errors import InputError

# Environment variable for the largest ratio of a file's data in memory to its size on disk.
RATIO_VARIABLE = "SDM_DEFLECT_UNPACK_RATIO"
# That ratio by default, and the bytes that any file may take.
RATIO, ALWAYS = 100.0, 1 << 26
# Largest number of letters in a line of titles: a file without line ends is no table.
LONGEST_LINE = 1 << 16
# Titles of coordinates: ours, those of ParaView, and those of CGNS.
PLACES = {name: (name, f"Points:{i}", f"Coordinate{name}", f"Coordinates:{i}") for i, name in enumerate("xyz")}
Array = NDArray[Any]
# All that NumPy, zipfile and their libraries raise for damaged files.
DAMAGED = (
    OSError, EOFError, ValueError, TypeError, AttributeError, LookupError, ArithmeticError, MemoryError, RuntimeError,
    SyntaxError, Warning, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error, lzma.LZMAError,
)  # fmt: skip


def unpack_limit(stored: int) -> int:
    """Return the largest size in memory of data in a file of `stored` bytes; InputError as for `check_unpacked`.

    Packed meshes seldom take less than a tenth of their size in memory, but a damaged file may claim anything.
    """
    given = os.environ.get(RATIO_VARIABLE) or RATIO
    try:
        return max(ALWAYS, int(float(given) * stored))
    except (ValueError, OverflowError):
        raise InputError(f"{RATIO_VARIABLE} is {given!r}, expected a number such as {RATIO:g}") from None


def check_unpacked(size: int, stored: int, what: str) -> None:
    """Raise InputError if `size` bytes in memory are too many for `what` from a file of `stored` bytes.

    Also if the ratio in the environment is no number.
    """
    if size > unpack_limit(stored):
        raise InputError(
            f"{what} would take {size / 1e6:.3g} MB of memory from a file of {stored / 1e6:.3g} MB; the file is "
            f"damaged, or set {RATIO_VARIABLE} to more than {size / max(stored, 1):.3g}"
        )


@contextmanager
def damaged(path: Path, what: str) -> Iterator[None]:
    """Turn any error or warning in the block into an InputError that names the file and the expected content `what`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            refuse_device(path)
            yield
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    except DAMAGED as error:
        reason = (
            error.strerror if isinstance(error, OSError) else " ".join(str(error).partition(': "<')[0].split())[:200]
        )
        raise InputError(f"{path}: no {what}: {reason or 'it is damaged'}") from None


def refuse_device(path: Path) -> None:
    """Raise InputError for a device or a pipe, which may be endless."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: a device or a pipe is no file to read")


def read_titles(text: TextIO, example: str) -> list[str]:
    """Return the titles in the first line of a .csv; ValueError for a line of numbers, or no line.

    NumPy begins such a line with ``#``. `example` is a line of titles, for the message.
    """
    line = text.readline(LONGEST_LINE).removeprefix("#")
    if len(line) >= LONGEST_LINE - 1:
        raise ValueError("the line of titles is too long")
    try:
        (titles,) = csv.reader([line], strict=True, skipinitialspace=True)
    except (csv.Error, ValueError) as error:
        raise ValueError(f"the line of titles cannot be read: {error or 'it is empty'}") from None
    if any(map(_is_number, titles)):
        raise InputError(f"the first line has numbers; add a line of titles above it, such as {example}")
    return [title.strip() for title in titles]


def read_rows(path: Path, what: str, example: str) -> tuple[list[str], NDArray[np.float64]]:
    """Return titles and numbers (rows, columns) of a .csv with a title line; InputError if it is no `what`.

    `example` is a line of titles, for the message.
    """
    with damaged(path, what), path.open(encoding="utf-8-sig") as text:
        titles = read_titles(text, example)
        rows = np.loadtxt(text, delimiter=",", ndmin=2, comments=None)
        if rows.shape[1] != len(titles):
            raise InputError(f"{len(titles)} titles stand above {rows.shape[1]} columns")
        return titles, rows


def columns_of(titles: Sequence[str], names: Mapping[str, Sequence[str]]) -> dict[str, int]:
    """Return the index of the column that has each name; names without a column are left out.

    A title is one of the spellings of a name; case, spaces and ``_ : . -`` do not matter: ``Points:0``, ``Points_0``
    and ``points 0`` are alike. An exact spelling comes before others.

    Raises InputError if a name has two columns.
    """
    columns: dict[str, int] = {}
    for name, spellings in names.items():
        matching = [i for i, title in enumerate(titles) if _plain(title) in map(_plain, spellings)]
        if len({_plain(titles[i]) for i in matching}) == 1:
            matching = [i for i in matching if titles[i] in spellings] or matching
        if len(matching) > 1:
            raise InputError(f"the titles {titles[matching[0]]} and {titles[matching[1]]} mean the same: leave one out")
        if matching:
            columns[name] = matching[0]
    return columns


def _plain(title: str) -> str:
    return re.sub(r"[\s_:.-]", "", title).casefold()


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def read_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays of an .npz file by name.

    Raises InputError for a file that is unreadable, damaged, too large when unpacked, or that holds objects.
    """
    with damaged(path, "archive of arrays"), zipfile.ZipFile(path) as packed:
        entries = packed.infolist()
        check_unpacked(sum(entry.file_size for entry in entries), path.stat().st_size, "what is packed in it")
        arrays = ((entry.filename, np.load(BytesIO(packed.read(entry)), allow_pickle=False)) for entry in entries)
        return {name.removesuffix(".npy"): values for name, values in arrays}
