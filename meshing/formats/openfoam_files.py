"""Files of OpenFOAM: header, patches, and lists of labels, vectors and faces in text or binary."""

import gzip
import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.unpacking import check_unpacked, unpack_limit
from sdm_deflect.meshing.mesh.cells import Polygons

from .numbers import Placed, numbers
from .shapes import polygons

MESH = Path("constant", "polyMesh")
HEADER = re.compile(rb"FoamFile\s*\{([^{}]{0,10000}(?:\{[^{}]{0,1000}\}[^{}]{0,1000}){0,9})\}")
INNER = re.compile(rb"\w+\s*\{[^{}]*\}")
ENTRY = re.compile(rb"([\w.]+)\s+(\"[^\"]*\"|[^;]*);")
COMMENT = re.compile(rb"//[^\n]*|/\*.*?(?:\*/|\Z)", re.DOTALL)
COUNT = re.compile(rb"\s*(\d+)\s*([({])")
BINARY_COUNT = re.compile(rb"(?>(?:\s|//[^\n]*|/\*.*?(?:\*/|\Z))*)(\d+)\s*", re.DOTALL)
FLAT = bytes.maketrans(b"(){}", b"    ")
WORD = re.compile(rb"\"[^\"]*\"|[{}();]|[^\s{}();\"]+")
# Class of faces with offsets in a separate list: the only one in binary.
COMPACT = "faceCompactList"
# Bytes from the beginning of a file that contain its header.
HEAD = 10_000
# Upper limits: bytes of memory for a byte of packed text, numbers in a face, bytes of a number in text.
READING, CORNERS, WIDEST = 4, 16, 64


@dataclass(frozen=True, slots=True, eq=False)
class FoamFile:
    """The unpacked bytes of a file, and the entries of its header.

    Parameters
    ----------
    data : All bytes, header included.
    start : Where the content begins, after the header.
    entries : The header's entries, such as ``{"format": "binary", "class": "labelList"}``.
    stored : Length of the file, packed or not.
    """

    data: bytes = field(repr=False)
    start: int
    entries: dict[str, str]
    stored: int

    @property
    def binary(self) -> bool:
        """Whether lists are binary."""
        return self.entries.get("format", "ascii") == "binary"

    def kind(self, what: str) -> np.dtype[np.generic]:
        """Type of a binary ``label`` or ``scalar``; 32 and 64 bits unless the file's `arch` says otherwise."""
        arch = self.entries.get("arch", "")
        stated = re.search(rf"{what}=(\d+)", arch)
        bits = int(stated[1]) if stated else {"label": 32, "scalar": 64}[what]
        if bits not in (32, 64):
            raise MeshFileError(f"arch has {what}={bits}; only 32 and 64 are read")
        order = ">" if "MSB" in arch else "<"
        return np.dtype(f"{order}{'i' if what == 'label' else 'f'}{bits // 8}")

    def text(self) -> bytes:
        """The content with blanks in place of comments, so that every other byte stays where it was."""
        return COMMENT.sub(lambda comment: b" " * len(comment[0]), self.data[self.start :])


def open_foam(folder: Path, name: str) -> FoamFile:
    """Read ``folder/name`` or ``folder/name.gz``; MeshFileError if neither is there, or it has no header."""
    packed = folder / f"{name}.gz"
    try:
        plain = (folder / name).is_file() or not packed.is_file()
        stored = (folder / name if plain else packed).read_bytes()
        data = stored if plain else _unpack(stored)
    except (OSError, EOFError, zlib.error) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "is truncated or damaged"
        raise MeshFileError(f"{name}: {reason}") from error
    return read_header(data, name, len(stored))


def read_header(data: bytes, name: str, stored: int) -> FoamFile:
    """Return a file of `stored` bytes with its header read; MeshFileError if it has none."""
    header = HEADER.search(data)
    if not header:
        raise MeshFileError(f"{name}: has no FoamFile header; it is truncated, or not a file of OpenFOAM")
    pairs = ENTRY.findall(INNER.sub(b"", header[1]))
    entries = {key.decode(): value.decode("utf-8", "replace").strip('"') for key, value in pairs}
    return FoamFile(data, header.end(), entries, stored)


def _unpack(packed: bytes) -> bytes:
    """Unpack text; MeshFileError if it would need too much memory: a byte of text takes several once it is read."""
    with gzip.GzipFile(fileobj=BytesIO(packed)) as file:
        data = file.read(unpack_limit(len(packed)) // READING + 1)
    check_unpacked(READING * len(data), len(packed), "what is packed in it")
    return data


def labels(file: FoamFile) -> IntArray:
    """Return a list (K,) of labels, such as `owner`; ``5{0}`` is five zeros."""
    if file.binary:
        return _binary(file, file.start, "label", 1)[0][:, 0].astype(np.intp)
    text = file.text()
    count, uniform, begin = _count(file, text, 1)
    values = numbers(text[begin:].translate(FLAT), np.int64).values.astype(np.intp)
    _check(len(values), 1 if uniform else count)
    return np.repeat(values, count) if uniform else values


def vectors(file: FoamFile) -> Placed:
    """Return the list (N, 3) of vectors in `points`."""
    if file.binary:
        values, first = _binary(file, file.start, "scalar", 3)
        size = file.kind("scalar").itemsize
        begin = first + size * np.arange(values.size).reshape(-1, 3)
        return Placed(values.astype(np.float64), begin, begin + size)
    text = file.text()
    count, _, start = _count(file, text, 3)
    words = numbers(text[start:].translate(FLAT), np.float64)
    _check(len(words.values), 3 * count)
    offset = file.start + start
    begin, end = (offset + at.reshape(-1, 3) for at in (words.begin, words.end))
    return Placed(words.values.astype(np.float64).reshape(-1, 3), begin, end)


def faces(file: FoamFile) -> Polygons:
    """Return a list of faces: ``4(0 1 2 3)`` each in text, offsets and nodes in binary."""
    if file.binary:
        if file.entries.get("class") != COMPACT:
            raise MeshFileError(f"a binary {file.entries.get('class')} cannot be read; run foamFormatConvert")
        offsets, first = _binary(file, file.start, "label", 1)
        nodes, _ = _binary(file, first + offsets.nbytes + 1, "label", 1)
        return Polygons(nodes[:, 0].astype(np.intp), offsets[:, 0].astype(np.intp))
    text = file.text()
    count, _, start = _count(file, text, CORNERS)
    body = text[start:]
    words = numbers(body.translate(FLAT), np.int64)
    opening = np.flatnonzero(np.frombuffer(body, dtype=np.uint8) == ord("("))
    heads = np.searchsorted(words.begin, opening) - 1
    _check(len(heads), count)
    if np.any(heads < 0):
        raise MeshFileError("a face has no number of corners; the file is damaged")
    sizes = words.values[heads].astype(np.intp)
    nodes = np.delete(words.values, heads).astype(np.intp)
    _check(len(nodes), int(sizes.sum()))
    return polygons(nodes, sizes)


def _count(file: FoamFile, text: bytes, columns: int) -> tuple[int, bool, int]:
    """Return the length of the list at the beginning of a text, whether it is uniform, and where its content begins.

    MeshFileError if rows of `columns` numbers do not fit the length of the text.
    """
    match = COUNT.match(text)
    if not match:
        raise MeshFileError("no list follows the header; the file is truncated or damaged")
    count = int(match[1])
    check_unpacked(count * columns * 8, file.stored, f"a list of {count}")
    if len(text) > WIDEST * (count * columns + 1000):
        raise MeshFileError(f"holds {len(text)} bytes where {count} numbers or faces should be; the file is damaged")
    return count, match[2] == b"{", match.end()


class BinaryList(NamedTuple):
    """A binary list: type of numbers, number of rows, first byte, and whether one row stands for all."""

    kind: np.dtype[np.generic]
    rows: int
    begin: int
    uniform: bool


def locate_list(file: FoamFile, at: int, what: str, columns: int) -> BinaryList:
    """Find the rows of the binary list that follows a byte; MeshFileError if the file is shorter.

    A file without `arch` may have labels of either size; the size with which the list ends properly counts.
    """
    kind = file.kind(what)
    match = BINARY_COUNT.match(file.data, at)
    if not match:
        raise MeshFileError("no list follows the header; the file is truncated or damaged")
    count, begin = int(match[1]), match.end() + 1
    if count == 0:
        return BinaryList(kind, 0, match.end(), False)
    uniform = file.data[match.end() : begin] == b"{"
    rows = 1 if uniform else count
    if what == "label" and "label=" not in file.entries.get("arch", "") and not _ends(file, begin + 4 * rows * columns):
        kind = np.dtype("<i8") if _ends(file, begin + 8 * rows * columns) else kind
    end = begin + rows * columns * kind.itemsize
    if end >= len(file.data) or file.data[end : end + 1] not in b")}":
        raise MeshFileError(f"{count} values should follow, but the file ends before or goes on; it is damaged")
    return BinaryList(kind, count, begin, uniform)


def _ends(file: FoamFile, at: int) -> bool:
    """Return whether a list ends at a byte: with a bracket, before another list, a comment or the file's end."""
    return bool(re.compile(rb"[)}]\s*(?:\d+\s*[({]|//|\Z)").match(file.data, at))


def _binary(file: FoamFile, at: int, what: str, columns: int) -> tuple[FloatArray | IntArray, int]:
    """Return the rows (K, columns) of a binary list, and the byte where they begin."""
    kind, count, begin, uniform = locate_list(file, at, what, columns)
    size = (1 if uniform else count) * columns * kind.itemsize
    rows = np.frombuffer(file.data[begin : begin + size], kind).reshape(-1, columns)
    if uniform:
        check_unpacked(count * rows.nbytes, file.stored, f"a list of {count}")
        rows = np.repeat(rows, count, axis=0)
    return rows, begin


def _check(count: int, expected: int) -> None:
    if count != expected:
        cause = "truncated or damaged" if count < expected else "damaged"
        raise MeshFileError(f"holds {count} numbers or faces where {expected} should be; the file is {cause}")


@dataclass(frozen=True, slots=True)
class FoamPatch:
    """A patch: faces start to start + count - 1, and its dictionary."""

    name: str
    type: str
    count: int
    start: int
    entries: Mapping[str, str] = field(default_factory=dict, repr=False)


def parse(text: bytes) -> list[FoamPatch]:
    """Read the patches of a `boundary` file without its header and comments.

    MeshFileError if an entry is missing, or if the file has more or fewer patches than it announces.
    """
    words = iter(WORD.findall(text))
    patches = []
    try:
        count, _ = int(next(words)), next(words)
        for word in words:
            if word == b")":
                break
            _ = next(words)
            name, entries = word.decode("utf-8", "replace").strip('"'), _entries(words)
            if missing := {"type", "nFaces", "startFace"} - entries.keys():
                raise MeshFileError(f"patch {name} has no {', '.join(sorted(missing))}")
            size, first = int(entries["nFaces"]), int(entries["startFace"])
            patches.append(FoamPatch(name, entries["type"], size, first, entries))
    except (StopIteration, ValueError):
        raise MeshFileError("the list of patches is truncated or damaged") from None
    if len(patches) != count:
        raise MeshFileError(f"{len(patches)} patches follow where there should be {count}; the file is damaged")
    return patches


def _entries(words: Iterator[bytes]) -> dict[str, str]:
    """Return the entries of a dictionary up to its closing brace; inner dictionaries are skipped."""
    entries: dict[str, str] = {}
    key: list[bytes] = []
    depth = 1
    while depth:
        word = next(words)
        depth += (word == b"{") - (word == b"}")
        if word in (b"{", b"}"):
            key = []
        elif word == b";":
            if key and depth == 1:
                entries[key[0].decode("utf-8", "replace")] = b" ".join(key[1:]).decode("utf-8", "replace")
            key = []
        else:
            key.append(word)
    return entries
