"""Bytes changed at random, as damage and malice change them."""

import gzip
import io
import re
import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from random import Random

import h5py
import numpy as np

# What stands in the place of a number in text.
NUMBERS = (
    b"0", b"-1", b"1", b"2", b"3", b"7", b"100", b"255", b"65536", b"2147483647", b"2147483648", b"-2147483648",
    b"4294967295", b"999999999999", b"9223372036854775807", b"9223372036854775808", b"-9223372036854775808",
    b"18446744073709551615", b"1e5", b"1e20", b"1e160", b"1e300", b"-1e308", b"1e-300", b"5e-324", b"1e999", b"nan",
    b"-inf", b"", b"-", b"0x10", b"1_0", b"1.5", b"-0.0", b"007", b"1,5", "²".encode(), "٣".encode(),
)  # fmt: skip
WHOLE = (0, 1, -1, 2, 127, 128, 255, 256, -128, 2**15, 2**16 - 1, 2**20, 2**24, 2**31 - 1, 2**31, -(2**31), 2**32 - 1,
         2**40, 2**62, 2**63 - 1, -(2**63), 2**64 - 1)  # fmt: skip
REAL = (float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 1e160, 1e-310, 0.0, -0.0, 1.0, 1e9)
NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
LONGEST = 1 << 20
WINDOW = 1 << 13

Operation = Callable[["Damage", bytes], bytes]


@dataclass(slots=True)
class Damage:
    """A source of changes.

    Attributes
    ----------
    random : what decides.
    words : words that the format knows.
    others : further inputs, of which parts may be taken.
    """

    random: Random
    words: Sequence[bytes] = ()
    others: Sequence[bytes] = field(default=(), repr=False)

    def of(self, data: bytes) -> bytes:
        """Return a damaged copy: one change mostly, sometimes many."""
        if data[:2] == b"\x1f\x8b" and self.random.random() < 0.8:
            return self._within_gzip(data)
        for _ in range(self.random.choice((1, 1, 1, 2, 2, 3, 5, 12))):
            data = self.random.choice(OPERATIONS)(self, data)[:LONGEST]
        return data

    def _within_gzip(self, data: bytes) -> bytes:
        try:
            inner = zlib.decompressobj(wbits=31).decompress(data, LONGEST)
        except zlib.error:
            return data[: self.random.randrange(len(data))]
        return gzip.compress(self.of(inner), 1, mtime=0)

    def place(self, data: bytes) -> int:
        """Return a place in the data; more often one that is not empty, or near the beginning."""
        if not data:
            return 0
        found = self.random.randrange(len(data))
        if self.random.random() < 0.2:
            found %= 512
        for _ in range(4):
            if data[found] or self.random.random() < 0.4:
                break
            found = self.random.randrange(len(data))
        return found

    def span(self, data: bytes) -> tuple[int, int]:
        """Return where a part begins and ends; short mostly."""
        start = self.place(data)
        size = self.random.choice((1, 2, 4, 8, 16, 64, 256, len(data)))
        return start, min(len(data), start + self.random.randint(1, size) if size else start)


def flip_bit(damage: Damage, data: bytes) -> bytes:
    """Flip a bit."""
    at = damage.place(data)
    return data[:at] + bytes([data[at] ^ 1 << damage.random.randrange(8)]) + data[at + 1 :] if data else data


def set_byte(damage: Damage, data: bytes) -> bytes:
    """Set a byte."""
    at = damage.place(data)
    return data[:at] + bytes([damage.random.randrange(256)]) + data[at + 1 :]


def set_number(damage: Damage, data: bytes) -> bytes:
    """Set the bytes of a binary number, aligned mostly."""
    random, order = damage.random, damage.random.choice("<<<>")
    if random.random() < 0.3:
        new = struct.pack(order + random.choice("fd"), random.choice(REAL[:3] + REAL[7:]))
    else:
        size = random.choice((1, 2, 4, 4, 8, 8))
        new = (random.choice(WHOLE) % 2 ** (8 * size)).to_bytes(size, "little" if order == "<" else "big")
    at = damage.place(data)
    at -= at % len(new) if random.random() < 0.6 else 0
    return data[:at] + new + data[at + len(new) :]


def truncate(damage: Damage, data: bytes) -> bytes:
    """Cut the end off."""
    return data[: damage.random.randint(0, len(data))]


def delete(damage: Damage, data: bytes) -> bytes:
    """Leave a part out."""
    start, end = damage.span(data)
    return data[:start] + data[end:]


def duplicate(damage: Damage, data: bytes) -> bytes:
    """Put a part twice, or very often."""
    start, end = damage.span(data)
    times = damage.random.choice((1, 1, 2, 8, 100, 5000))
    part = data[start:end]
    times = min(times, 1 + LONGEST // 4 // max(len(part), 1))
    return data[:end] + (part * times)[: LONGEST // 4] + data[end:]


def swap(damage: Damage, data: bytes) -> bytes:
    """Exchange two parts."""
    (a, b), (c, d) = sorted((damage.span(data), damage.span(data)))
    return data if c < b else data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def overwrite(damage: Damage, data: bytes) -> bytes:
    """Overwrite a part with zeros, ones, random bytes, or another part."""
    (start, end), other = damage.span(data), damage.place(data)
    size = end - start
    kinds = (bytes(size), b"\xff" * size, damage.random.randbytes(size), data[other : other + size])
    return data[:start] + damage.random.choice(kinds) + data[end:]


def insert_word(damage: Damage, data: bytes) -> bytes:
    """Put in a word of the format, or something nasty."""
    words = (*damage.words, b"\0", b"\n", b" ", b"\r", b"%", b"\xff\xfe", b"\x1b[31m", b"{" * 3000, b"(" * 3000)
    at, new = damage.place(data), damage.random.choice(words)
    end = damage.span(data)[1] if damage.random.random() < 0.3 else at
    return data[:at] + new + data[max(at, end) :]


def replace_number(damage: Damage, data: bytes) -> bytes:
    """Replace a number in text by another one."""
    start = max(0, damage.place(data) - WINDOW // 2) if len(data) > WINDOW else 0
    found = list(NUMBER.finditer(data, start, min(len(data), start + WINDOW)))
    if not found:
        return set_number(damage, data)
    one = damage.random.choice(found)
    new = damage.random.choice(NUMBERS)
    if damage.random.random() < 0.3:
        new = damage.random.choice(found)[0]
    return data[: one.start()] + new + data[one.end() :]


def change_lines(damage: Damage, data: bytes) -> bytes:
    """Leave a line out, put it twice, or exchange two."""
    lines = data.split(b"\n")
    i, j = (damage.random.randrange(len(lines)) for _ in range(2))
    kind = damage.random.randrange(3)
    if kind == 0:
        lines[i : min(i + damage.random.choice((1, 1, 3)), len(lines))] = []
    elif kind == 1:
        lines.insert(j, lines[i])
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def splice(damage: Damage, data: bytes) -> bytes:
    """Go on with the end of another input."""
    other = damage.random.choice(damage.others) if damage.others else data
    if damage.random.random() < 0.5:
        return data[: damage.place(data)] + other[damage.place(other) :]
    start, end = damage.span(other)
    at = damage.place(data)
    return data[:at] + other[start:end] + data[at:]


OPERATIONS: tuple[Operation, ...] = (
    flip_bit, flip_bit, set_byte, set_number, set_number, truncate, delete, duplicate, swap, overwrite, insert_word,
    insert_word, replace_number, replace_number, replace_number, change_lines, splice,
)  # fmt: skip


def damaged_hdf5(random: Random, data: bytes, damage: Damage) -> bytes:
    """Return a file of HDF5 with other values, shapes or attributes, or without a node; or with other bytes."""
    if random.random() < 0.3:
        return damage.of(data)
    buffer = io.BytesIO(data)
    with h5py.File(buffer, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        node = file[random.choice(names)]
        if random.random() < 0.2:
            del file[node.name]
        elif node.attrs and random.random() < 0.3:
            node.attrs[random.choice(list(node.attrs))] = random.choice((np.bytes_(b"X4"), *WHOLE[:16], *REAL))
        elif isinstance(node, h5py.Dataset) and node.size:
            values = np.array(node[()]).reshape(-1)
            with np.errstate(all="ignore"):
                number = random.choice(REAL if values.dtype.kind == "f" else WHOLE)
                values[random.randrange(values.size)] = np.array(number).astype(values.dtype)
            kept, name, parent = dict(node.attrs), node.name, node.parent
            shape = node.shape if random.random() < 0.7 else (random.randrange(values.size),)
            del file[name]
            new = parent.create_dataset(name, data=np.resize(values, shape))
            new.attrs.update(kept)
    return buffer.getvalue()
