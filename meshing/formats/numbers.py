"""Numbers in text and bytes: they are found, read and replaced.

Plain numbers are whole or decimal and stand between blanks. Compiled code reads them without the interpreter lock.
`numbers` reads or refuses all else: comments, ``nan``, damage.
"""

import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.compiled import compiled_exactly
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.threads import available_threads

# Bytes up to this one separate numbers.
SPACE = 32
COMMENT = re.compile(rb"%[^\r\n]*")
# Bytes of text handled at a time.
CHUNK = 1 << 18
# Lines written at a time.
ROWS = 1 << 15
Bytes = NDArray[np.uint8]
Result = TypeVar("Result")
# Largest number of digits of a whole number below 2^64; one digit fewer is below 2^63.
MOST_DIGITS = 19
# Largest power of ten that is parsed; words with larger ones are left to `float`.
MOST_POWER = 9999
# Largest power of ten in the table of `_scaled`; numbers beyond are left to `float`.
LARGEST_POWER = 64
# Factor that splits a double into two halves of 26 bits (Dekker 1971).
SPLIT = 2.0**27 + 1.0
# More than the relative error of `_scaled` before it rounds, which is below 2^-102.
DOUBT = 2.0**-98
TEN = [Fraction(10) ** power for power in range(-LARGEST_POWER, LARGEST_POWER + 1)]
# 10^-64 to 10^64 (129, 2): the nearest number, and the one nearest to what is left.
POWERS = np.array([(float(power), float(power - Fraction(float(power)))) for power in TEN])


@dataclass(frozen=True, slots=True, eq=False)
class NumberLines:
    """Numbers on lines of text; lines without numbers are left out.

    Parameters
    ----------
    values : (T,) all numbers.
    first : (L + 1,) where each line begins in `values`, and where the last one ends.
    begin, end : (T,) the bytes of the text that each number takes.
    """

    values: FloatArray | IntArray = field(repr=False)
    first: IntArray = field(repr=False)
    begin: IntArray = field(repr=False)
    end: IntArray = field(repr=False)

    def __len__(self) -> int:
        return len(self.first) - 1

    def columns(self, of: Any, start: int, stop: int, rows: Any = slice(None)) -> Any:
        """Return entries start to stop - 1 of each line (L, stop - start) of `of` (T,), values of all numbers."""
        sizes = np.diff(self.first)
        if len(sizes) and (sizes == sizes[0]).all():
            return of.reshape(-1, sizes[0])[rows, start:stop]
        return of[self.first[:-1][rows, None] + np.arange(start, stop)]


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Numbers of a file; number i stands in bytes begin[i] to end[i] - 1. The three arrays have one shape."""

    values: FloatArray = field(repr=False)
    begin: IntArray = field(repr=False)
    end: IntArray = field(repr=False)

    def with_values(self, data: bytes, values: FloatArray, kind: np.dtype[np.generic] | None) -> bytes:
        """Return `data` with its numbers replaced by `values`: in binary of type `kind`, or in text if that is None."""
        changed = self.values != values
        rising = np.argsort(self.begin[changed])
        begin, end, new = (each[changed][rising] for each in (self.begin, self.end, values))
        if kind is None:
            return with_numbers(data, begin, end, new)
        copy = np.frombuffer(data, dtype=np.uint8).copy()
        raw = np.ascontiguousarray(new, dtype=kind).view(np.uint8).reshape(len(new), kind.itemsize)
        for column in range(kind.itemsize):
            copy[begin + column] = raw[:, column]
        return copy.tobytes()


def numbers(text: bytes, kind: type[np.float64 | np.int64]) -> NumberLines:
    """Read the numbers on lines of text (``%`` begins a comment); MeshFileError with the first other word."""
    if b"%" in text:
        text = COMMENT.sub(lambda comment: b" " * len(comment[0]), text)
    letters = np.frombuffer(text, dtype=np.uint8)
    solid = np.concatenate([[False], letters > SPACE, [False]])
    edges = np.flatnonzero(solid[1:] != solid[:-1])
    begin, end = edges[0::2], edges[1::2]
    line = np.searchsorted(np.flatnonzero(letters == ord("\n")), begin)
    first = np.append(np.flatnonzero(np.diff(line, prepend=-1)), len(begin))
    values: Any = np.empty(0, kind)
    with suppress(ValueError, DeprecationWarning):  # NumPy before 2.3 warns, and reads in part
        values = np.fromstring(text, dtype=kind, sep=" ")[: len(begin)]  # blank text reads as one 0
    if len(values) != len(begin):
        raise MeshFileError(f"{_not_number(text, kind)!r} is not a number")
    return NumberLines(values, first, begin, end)


def _not_number(text: bytes, kind: type[np.float64 | np.int64]) -> str:
    for word in text.split():
        try:
            (int if kind is np.int64 else float)(word)
        except ValueError:
            return word[:40].decode("utf-8", "replace")
    return text[:20].decode("utf-8", "replace")


def with_numbers(data: bytes, begin: IntArray, end: IntArray, values: FloatArray) -> bytes:
    """Return a text with numbers `values` (K,), in all digits that they need, in the bytes begin[i] to end[i] - 1."""
    if not len(values):
        return data
    first, last = begin.tolist(), end.tolist()
    pieces = [b""] * (2 * len(first) + 1)
    pieces[0::2] = [data[a:b] for a, b in zip([0, *last], [*first, len(data)], strict=True)]
    pieces[1::2] = [repr(value).encode() for value in values.tolist()]
    return b"".join(pieces)


def chunks(file: BinaryIO, begin: int, end: int) -> Iterator[tuple[int, bytes]]:
    """Yield bytes begin to end - 1 as pieces of whole lines, each with the offset of its first byte."""
    carried, at = [b""], begin
    while at < end:
        file.seek(at)  # another pass may have read in between
        text = file.read(min(CHUNK, end - at))
        if not text:
            break
        at += len(text)
        cut = text.rfind(b"\n") + 1 if at < end else len(text)
        carried.append(text[:cut])
        if cut:
            whole = b"".join(carried)
            yield begin, whole
            begin += len(whole)
            carried.clear()
        carried.append(text[cut:])
    if any(carried):
        yield begin, b"".join(carried)


def copy_text(file: BinaryIO, pieces: Iterator[tuple[int, bytes, Placed]], values: FloatArray, out: BinaryIO) -> None:
    """Copy a file of text with other numbers; only the characters of those that changed differ.

    Parameters
    ----------
    pieces : Rising parts of the text: where each begins, its bytes, and the numbers in it that may change.
    values : The new numbers (K,), in the order of those in the pieces.
    """
    at = done = 0
    for begin, text, placed in pieces:
        copy_bytes(file, at, begin, out)
        new = values[done : done + placed.values.size].reshape(placed.values.shape)
        done += new.size
        changed = placed.values != new
        first, last = (each[changed] for each in (placed.begin, placed.end))
        out.write(with_numbers(text, first, last, new[changed]))
        at = begin + len(text)
    copy_bytes(file, at, file.seek(0, 2), out)


def copy_bytes(file: BinaryIO, begin: int, end: int, out: BinaryIO) -> None:
    """Copy bytes begin to end - 1 of a file."""
    for at in range(begin, end, CHUNK):
        file.seek(at)  # another pass may have read in between
        out.write(file.read(min(CHUNK, end - at)))


def table(prefix: str, rows: FloatArray | IntArray, number: int | None) -> Iterator[str]:
    """Return lines of a prefix, a row's values in all digits, and the row's number if wanted."""
    words = [prefix] * bool(prefix) + ["%r"] * rows.shape[1] + ["%d"] * (number is not None)
    line = " ".join(words) + "\n"
    width = line.count("%")
    for start in range(0, len(rows), ROWS):
        block = rows[start : start + ROWS]
        values: list[float] = [0] * (width * len(block))
        for i, column in enumerate(block.T):
            values[i::width] = column.tolist()
        if number is not None:
            values[width - 1 :: width] = range(number + start, number + start + len(block))
        yield (line * len(block)) % tuple(values)


def ahead(work: Callable[[bytes], Result], texts: Iterable[bytes]) -> Iterator[Result]:
    """Apply a function to texts on all cores, and yield the results in order."""
    threads = available_threads()
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[Result]] = deque()
        for text in texts:
            waiting.append(pool.submit(work, text))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def many_numbers(text: bytes, kind: type[np.float64 | np.int64]) -> NumberLines:
    """Return the same as `numbers` for whole lines; plain ones are read much faster."""
    plain = plain_numbers(text, kind)
    return numbers(text, kind) if plain is None else plain


def plain_numbers(text: bytes, kind: type[np.float64 | np.int64]) -> NumberLines | None:
    """Return the same as `numbers` for lines of plain numbers; None for other lines and negative whole numbers."""
    letters = np.frombuffer(text if text.endswith(b"\n") else text + b"\n", dtype=np.uint8)
    begin, end = np.empty((2, len(letters) // 2), dtype=np.intp)
    first = np.zeros(text.count(b"\n") + 2, dtype=np.intp)
    lines = _lines(letters, first, begin, end)
    words = first[lines]
    begin, end = begin[:words], end[:words]
    values = np.empty(words, dtype=kind)
    if lines < 0 or not (_whole_numbers if kind is np.int64 else _decimals)(letters, begin, end, values):
        return None
    if kind is np.float64:
        unsure = np.flatnonzero(np.isnan(values))
        bounds = zip(begin[unsure].tolist(), end[unsure].tolist(), strict=True)
        values[unsure] = [float(text[a:b]) for a, b in bounds]
    return NumberLines(values, first[: lines + 1], begin, end)


@compiled_exactly
def _lines(text: Bytes, first: IntArray, begin: IntArray, end: IntArray) -> int:  # pragma: no cover - machine code
    """Find lines and numbers for `NumberLines`, and return the number of lines; -1 if a letter is unusual."""
    words = lines = 0
    start = -1
    for i in range(len(text)):
        if text[i] > 32:
            start = i if start < 0 else start
            continue
        if start >= 0:
            begin[words], end[words] = start, i
            words += 1
            start = -1
        if text[i] == 10:
            lines += words > first[lines]
            first[lines] = words
        elif not (text[i] == 32 or 9 <= text[i] <= 13):
            return -1
    return lines


@compiled_exactly
def _whole_numbers(text: Bytes, begin: IntArray, end: IntArray, values: IntArray) -> bool:  # pragma: no cover
    """Read whole numbers; False if a word is no whole number."""
    for i in range(len(values)):
        values[i] = _whole(text, begin[i], end[i])
        if values[i] < 0:
            return False
    return True


@compiled_exactly
def _decimals(text: Bytes, begin: IntArray, end: IntArray, values: FloatArray) -> bool:  # pragma: no cover
    """Read decimal numbers, NaN where `_scaled` is not sure; False if a word is no number."""
    for i in range(len(values)):
        values[i] = _decimal(text, begin[i], end[i])
        if values[i] == np.inf:
            return False
    return True


@compiled_exactly
def _whole(text: Bytes, begin: int, end: int) -> np.int64:  # pragma: no cover - machine code
    """Return the whole number in bytes begin to end - 1; -1 for other text."""
    value = np.int64(0)
    for i in range(begin, end):
        digit = np.uint8(text[i] - np.uint8(48))
        if digit > 9:
            return np.int64(-1)
        value = np.int64(10) * value + digit
    return value if end - begin < MOST_DIGITS else np.int64(-1)


@compiled_exactly
def _decimal(text: Bytes, begin: int, end: int) -> float:  # pragma: no cover - machine code
    """Return the decimal number in bytes begin to end - 1; NaN where `_scaled` is not sure, infinity for other text."""
    sign = -1.0 if text[begin] == ord("-") else 1.0
    first = begin + 1 if text[begin] in (ord("-"), ord("+")) else begin
    whole, figures, point, stop = np.uint64(0), 0, -1, end  # the number without its point
    for i in range(first, end):
        digit = np.uint8(text[i] - np.uint8(48))
        if digit <= 9:
            whole = whole * np.uint64(10) + np.uint64(digit)
            figures += int((figures > 0) | (digit > 0))
        elif text[i] == ord(".") and point < 0:
            point = i
        else:
            stop = i
            break
    power = 0 if stop == end else _power(text, stop, end)
    if stop - first == (point >= 0) or power > MOST_POWER:
        return np.inf
    after = (stop - point - 1) * (point >= 0)
    return sign * _scaled(whole, power - after) if figures <= MOST_DIGITS else np.nan


@compiled_exactly
def _power(text: Bytes, begin: int, end: int) -> int:  # pragma: no cover - machine code
    """Return the power of ten in a text such as ``e-12``; above `MOST_POWER` for other text."""
    if text[begin] not in (ord("e"), ord("E")) or begin + 1 == end:
        return MOST_POWER + 1
    sign = -1 if text[begin + 1] == ord("-") else 1
    first = begin + 2 if text[begin + 1] in (ord("-"), ord("+")) else begin + 1
    value = _whole(text, first, end)
    return int(sign * value) if first < end and 0 <= value <= MOST_POWER else MOST_POWER + 1


@compiled_exactly
def _scaled(digits: np.uint64, power: int) -> float:  # pragma: no cover - machine code
    """Return the product digits 10^power, correctly rounded; NaN if the rounding is not certain.

    Both factors are sums of two numbers, the product of their first ones is split without loss (Dekker 1971), and the
    sum rounds the same with the error added and taken away.
    """
    if digits == 0:
        return 0.0
    if not -LARGEST_POWER <= power <= LARGEST_POWER:
        return np.nan
    high = np.float64(digits)
    low = np.float64(np.int64(digits - np.uint64(high)))
    ten, rest = POWERS[power + LARGEST_POWER]
    product = high * ten
    a = SPLIT * high
    a -= a - high
    b = SPLIT * ten
    b -= b - ten
    c, d = high - a, ten - b
    error = ((a * b - product) + a * d + c * b) + c * d
    error += high * rest + low * ten
    doubt = DOUBT * product
    value = product + (error - doubt)
    return value if value == product + (error + doubt) else np.nan
