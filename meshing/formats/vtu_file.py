"""Files of VTK's unstructured grids (.vtu): where their arrays are, what they hold, and other values in their place.

Only the arrays that are asked for are read. All sizes are checked before memory is taken, so that a damaged file is an
error and nothing worse.
"""

import binascii
import lzma
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Literal
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.reading import check_unpacked
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.numbers import numbers, with_numbers

Array = NDArray[Any]
Edit = tuple[int, int, bytes]
"""Bytes begin to end - 1 of a file, and what is to stand there."""

APPENDED = re.compile(rb"<AppendedData\b([^<>]*)>\s*_")
TAG = re.compile(rb"<\w+(?:\s+[\w:]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*\s*/?>")
LZ4_RATIO = 256
"""LZ4 packs no bytes better than this."""
KINDS = ("Int8", "Int16", "Int32", "Int64", "UInt8", "UInt16", "UInt32", "UInt64", "Float32", "Float64")


@dataclass(slots=True)
class DataArray:
    """An array: its attributes, where its tag begins and ends, its text (if it is not appended), its closing tag."""

    attributes: dict[str, str]
    tag: tuple[int, int]
    text: tuple[int, int]
    close: int


@dataclass(slots=True)
class GridPiece:
    """A part of the grid: its numbers of points and cells, and its arrays by section and name."""

    points: int
    cells: int
    sections: dict[str, dict[str, DataArray]] = field(default_factory=dict)


class VtuFile:
    """The bytes of a file, and where its arrays are.

    MeshFileError if the bytes are no unstructured grid, or are truncated or damaged.

    Attributes
    ----------
    pieces : the parts of the grid.
    fields : arrays of the grid as a whole, by name.
    """

    def __init__(self, data: bytes) -> None:
        self.data, self.pieces, self.fields = data, [], {}  # type: tuple[bytes, list[GridPiece], dict[str, DataArray]]
        self._stack: list[str] = []
        self._open: DataArray | None = None
        self._arrays: list[DataArray] = []
        found = APPENDED.search(data)
        self._appended = found.end() if found else len(data)
        self._raw = found is not None and b"base64" not in found[1]
        self._head: dict[str, str] = {}
        self._parse(data[: found.start()] if found else data, whole=found is None)
        if not self.pieces or not data.rstrip().endswith(b"</VTKFile>"):
            raise MeshFileError("is damaged: it is truncated, or has no <Piece>")
        self._order: Literal["<", ">"] = ">" if self._head.get("byte_order") == "BigEndian" else "<"
        self._size = np.dtype(f"{self._order}u{8 if self._head.get('header_type') == 'UInt64' else 4}")
        self._packing = _packing(self._head.get("compressor", ""))
        self._taken = 0

    def _parse(self, text: bytes, whole: bool) -> None:
        parser = expat.ParserCreate()
        parser.StartElementHandler = lambda name, given: self._started(name, given, parser.CurrentByteIndex)
        parser.EndElementHandler = lambda _: self._ended(parser.CurrentByteIndex)
        parser.StartDoctypeDeclHandler = _refused
        try:
            parser.Parse(text, whole)
        except expat.ExpatError as error:
            start = b"<VTKFile" in text[:1000]
            raise MeshFileError(f"is damaged: {error}" if start else "is not a VTK unstructured grid (.vtu)") from error
        if self._head.get("type") != "UnstructuredGrid":
            raise MeshFileError("is not a VTK unstructured grid (.vtu)")

    def _started(self, name: str, given: dict[str, str], at: int) -> None:
        if self._open and not self._open.close:
            self._open.text = (self._open.text[0], self._open.text[1] or at)  # further elements follow its numbers
        if name == "VTKFile":
            self._head = given
        elif name == "Piece":
            self.pieces.append(GridPiece(_count(given, "NumberOfPoints"), _count(given, "NumberOfCells")))
        elif name in ("DataArray", "Array"):
            tag = TAG.match(self.data, at)
            end = tag.end() if tag else at
            self._open = DataArray(given, (at, end), (end, 0), 0)
            self._arrays.append(self._open)
            section = self._stack[-1] if self._stack else ""
            of_grid = section == "FieldData" or not self.pieces
            home = self.fields if of_grid else self.pieces[-1].sections.setdefault(section, {})
            home[given.get("Name", "")] = self._open
        self._stack.append(name)

    def _ended(self, at: int) -> None:
        if self._stack.pop() in ("DataArray", "Array") and self._open:
            begin, end = self._open.text
            self._open.text, self._open.close = (begin, max(end or at, begin)), max(at, begin)
            self._open = None

    def values(self, array: DataArray, rows: int | None = None) -> Array:
        """Return the values (K,) or (K, columns) of an array.

        MeshFileError if it is damaged, or does not have so many `rows`.
        """
        given = array.attributes
        if given.get("type") not in KINDS:
            raise MeshFileError(f"array {given.get('Name')} is of the type {given.get('type')}, which cannot be read")
        kind = np.dtype(given["type"].lower()).newbyteorder(self._order)
        columns = max(_count(given, "NumberOfComponents") if given.get("NumberOfComponents") else 1, 1)
        if given.get("format") == "ascii":
            found = numbers(self.data[slice(*array.text)], np.float64 if kind.kind == "f" else np.int64).values
        else:
            body, _ = self._body(array)
            if len(body) % kind.itemsize:
                raise MeshFileError(f"array {given.get('Name')} is damaged: {len(body)} bytes of {given['type']}")
            found = np.frombuffer(body, kind)
        if len(found) % columns or (rows is not None and len(found) != rows * columns):
            expected = f"{rows} rows of {columns}" if rows is not None else f"rows of {columns}"
            raise MeshFileError(f"is damaged: array {given.get('Name')} has {len(found)} values, expected {expected}")
        self._taken += found.nbytes
        check_unpacked(self._taken, len(self.data), "its arrays")
        own = found.astype(kind.newbyteorder("="), copy=False)
        return own.reshape(-1, columns) if columns > 1 else own

    def strings(self, array: DataArray) -> tuple[str, ...]:
        """Return the strings of an array of the type String."""
        if array.attributes.get("format") == "ascii":
            body = numbers(self.data[slice(*array.text)], np.int64).values.astype(np.uint8).tobytes()
        else:
            body, _ = self._body(array)
        return tuple(body.decode("utf-8", "replace").split("\0")[:-1])

    def replaced(self, arrays: Sequence[tuple[DataArray, FloatArray]]) -> bytes:
        """Return the file with other values (K, 3) in some arrays, encoded as the old ones; all other bytes stay.

        Ranges that the file states for these arrays follow; keys with further statements on them are left out.
        """
        edits: list[Edit] = []
        grown: list[tuple[int, int]] = []
        for array, values in arrays:
            old = self.values(array)
            if np.array_equal(old, values.astype(old.dtype)):
                continue
            begin, end, new = self._encoded(array, old, values)
            edits += [(begin, end, new), *self._ranges(array, values)]
            if array.attributes.get("format") == "appended":
                grown.append((begin - self._appended, len(new) - (end - begin)))
            else:
                edits.append((array.text[1], array.close, b"\n" if array.close > array.text[1] else b""))
        for array in self._arrays:
            if array.attributes.get("format") == "appended":
                at = _count(array.attributes, "offset")
                by = sum(more for place, more in grown if place < at)
                edits += self._attribute(array, "offset", str(at + by)) if by else []
        pieces, at = [], 0
        for begin, end, new in sorted(edits):
            pieces += [self.data[at:begin], new]
            at = end
        return b"".join([*pieces, self.data[at:]])

    def _encoded(self, array: DataArray, old: Array, values: FloatArray) -> Edit:
        if array.attributes.get("format") == "ascii":
            begin, end = array.text
            text = self.data[begin:end]
            changed = (old != values).ravel()
            words = numbers(text, np.float64)
            own = values.astype(old.dtype).astype(np.float64).ravel()[changed]
            return begin, end, with_numbers(text, words.begin[changed], words.end[changed], own)
        _, (begin, end) = self._body(array)
        kind = old.dtype.newbyteorder(self._order)
        return begin, end, self._wrapped(np.ascontiguousarray(values, kind).tobytes(), begin, end)

    def _ranges(self, array: DataArray, values: FloatArray) -> Iterator[Edit]:
        lengths = np.sqrt(np.einsum("ij,ij->i", values, values))
        for name, value in (("RangeMin", lengths.min(initial=np.inf)), ("RangeMax", lengths.max(initial=0.0))):
            if array.attributes.get(name):
                yield from self._attribute(array, name, repr(float(value)))

    def _attribute(self, array: DataArray, name: str, value: str) -> list[Edit]:
        begin, end = array.tag
        found = re.search(rf"\b{name}\s*=\s*[\"']([^\"']*)".encode(), self.data[begin:end])
        return [(begin + found.start(1), begin + found.end(1), value.encode())] if found else []

    def _body(self, array: DataArray) -> tuple[bytes, tuple[int, int]]:
        """The bytes of a binary array, unpacked, and where it lies in the file."""
        form = array.attributes.get("format")
        begin, limit = array.text
        if form == "appended":
            begin, limit = self._appended + _count(array.attributes, "offset"), len(self.data)
        elif form != "binary":
            raise MeshFileError(f"array {array.attributes.get('Name')} has the format {form}, which is not known")
        cursor = _Cursor(self.data, begin, limit, raw=form == "appended" and self._raw)
        unit = self._size.itemsize
        if self._packing is None:
            count = int(np.frombuffer(cursor.peek(unit), self._size)[0])
            return cursor.after(unit, count), (cursor.begin, cursor.at)
        blocks, size, last = np.frombuffer(cursor.peek(3 * unit), self._size).tolist()
        head = np.frombuffer(cursor.take((3 + blocks) * unit), self._size)
        packed = cursor.take(int(head[3:].sum(dtype=np.uint64)))
        ends = np.cumsum(head[3:].astype(np.intp))
        parts = [packed[a:b] for a, b in zip([0, *ends.tolist()], ends.tolist(), strict=False)]
        sizes = [size] * (blocks - 1) + [last or size] * bool(blocks)
        check_unpacked(self._taken + sum(sizes), len(self.data), "what is packed in it")
        return _unpacked(parts, sizes, self._packing[0]), (cursor.begin, cursor.at)

    def _wrapped(self, body: bytes, begin: int, end: int) -> bytes:
        """The bytes as a binary array in the encoding of the one that lies at bytes begin to end - 1."""
        raw = begin >= self._appended and self._raw
        unit = self._size.itemsize
        if self._packing is None:
            whole = np.array([len(body)], self._size).tobytes() + body
            return whole if raw else binascii.b2a_base64(whole, newline=False)
        cursor = _Cursor(self.data, begin, end, raw)
        size = max(int(np.frombuffer(cursor.peek(3 * unit), self._size)[1]), 1 << 12)
        blocks = [body[start : start + size] for start in range(0, len(body), size)]
        packed = [self._packing[1](block) for block in blocks]
        head = np.array([len(blocks), size, len(body) % size, *map(len, packed)], self._size).tobytes()
        parts = (head, b"".join(packed))
        return b"".join(parts if raw else (binascii.b2a_base64(part, newline=False) for part in parts))


class _Cursor:
    """Bytes of a file from `begin` on, as they are or in base64."""

    def __init__(self, data: bytes, begin: int, limit: int, raw: bool) -> None:
        while not raw and data[begin : begin + 1].isspace():
            begin += 1
        self.data, self.begin, self.at, self.limit, self.raw = data, begin, begin, limit, raw

    def peek(self, count: int) -> bytes:
        """The next `count` bytes, to be read again."""
        end = self.at + (count if self.raw else -(-count // 3) * 4)
        if end > self.limit:
            raise MeshFileError("is damaged: an array ends before its time")
        part = self.data[self.at : end]
        try:
            found = (part if self.raw else binascii.a2b_base64(part))[:count]
        except binascii.Error as error:
            raise MeshFileError(f"is damaged: {error}") from error
        if len(found) < count:
            raise MeshFileError("is damaged: an array holds letters that are not base64")
        return found

    def take(self, count: int) -> bytes:
        """The next `count` bytes, which are encoded by themselves."""
        part = self.peek(count)
        self.at += count if self.raw else -(-count // 3) * 4
        return part

    def after(self, head: int, count: int) -> bytes:
        """`count` bytes after a head, with which they are encoded together if it does not end in padding."""
        if self.raw or b"=" in self.data[self.at : self.at + -(-head // 3) * 4]:
            self.take(head)
            return self.take(count)
        return self.take(head + count)[head:]


Unpack = Callable[[bytes, int], bytes]
Pack = Callable[[bytes], bytes]


def _packing(name: str) -> tuple[Unpack, Pack] | None:
    """How to unpack bytes to a known size, and to pack them; None if they are as they are."""
    known: dict[str, tuple[Unpack, Pack]] = {
        "vtkZLibDataCompressor": (
            lambda part, size: zlib.decompressobj().decompress(part, size + 1),
            lambda body: zlib.compress(body, 1),
        ),
        "vtkLZMADataCompressor": (lambda part, size: lzma.LZMADecompressor().decompress(part, size + 1), lzma.compress),
        "vtkLZ4DataCompressor": (
            lambda part, size: _lz4("Uncompress", part, size) if size <= LZ4_RATIO * len(part) else b"",
            lambda body: _lz4("Compress", body),
        ),
    }
    if name and name not in known:
        raise MeshFileError(f"is packed by {name}, which is not known")
    return known.get(name)


def _lz4(task: str, data: bytes, *size: int) -> bytes:
    """Pack or unpack as VTK does; nothing if the data are damaged."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOCore import vtkLZ4DataCompressor

    vtk = vtkLZ4DataCompressor()
    vtk.AddObserver("ErrorEvent", lambda *_: None)  # else it prints
    found = getattr(vtk, task)(data, len(data), *size)
    return vtk_to_numpy(found).tobytes() if found else b""


def _unpacked(parts: Sequence[bytes], sizes: Sequence[int], unpack: Unpack) -> bytes:
    try:
        with ThreadPoolExecutor() as pool:
            found = list(pool.map(unpack, parts, sizes))
    except (zlib.error, lzma.LZMAError) as error:
        raise MeshFileError(f"is damaged: {error}") from error
    if [len(part) for part in found] != list(sizes):
        raise MeshFileError("is damaged: a packed block is of another size than is announced")
    return b"".join(found)


def _count(given: dict[str, str], name: str) -> int:
    text = given.get(name, "").strip()
    if not text.isdecimal():
        raise MeshFileError(f"is damaged: {name} = {text!r} is no count")
    return int(text)


def _refused(*_: object) -> None:
    raise MeshFileError("has a document type, which no grid of VTK needs")
