"""Variables of netCDF files: classic (CDF-1), with offsets of 64 bits (CDF-2), and in HDF5 (netCDF-4).

SciPy's reader takes headers at their word: 80 of 900 with one wrong number made it ask for up to 2 GB, others left
the file mapped. So they are read here.
Source: file format specifications of netCDF, https://docs.unidata.ucar.edu/netcdf-c/current/file_format_specifications.html
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np
from numpy.typing import NDArray

from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.hdf5 import Span, check_stored, damage, spans
from sdm_deflect.meshing.formats.tables import FileTable, Held

MAGIC = (b"CDF\1", b"CDF\2")
CDF5, HDF5 = b"CDF\5", b"\x89HDF"
DIMENSIONS, VARIABLES, ATTRIBUTES = 10, 11, 12
"""Tags of the three lists in a header."""
TEXT = 2
KINDS = {1: "i1", TEXT: "S1", 3: ">i2", 4: ">i4", 5: ">f4", 6: ">f8"}
MANY = 1 << 16
"""More dimensions, attributes, variables or letters of a name than any header has."""
Array = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Variable:
    """An array of a file, as its header describes it.

    Parameters
    ----------
    dtype : type of its numbers, with their byte order.
    shape : lengths of its dimensions.
    begin : offset of its first byte.
    grows : whether its first dimension is unlimited, so that it lies in pieces at the end of the file.
    """

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    begin: int
    grows: bool

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return prod(self.shape)

    @property
    def end(self) -> int:
        """Offset of the byte after its last one."""
        return self.begin + self.size * self.dtype.itemsize


@dataclass(frozen=True, slots=True, eq=False)
class Classic:
    """An open file of netCDF's own format."""

    file: BinaryIO
    dimensions: dict[str, int]
    attributes: dict[str, str]
    variables: dict[str, Variable] = field(repr=False)

    def __contains__(self, name: str) -> bool:
        return name in self.variables

    def length(self, dimension: str) -> int | None:
        """Return the length of a dimension, None if there is none of that name."""
        return self.dimensions.get(dimension)

    def text(self, attribute: str) -> str:
        """Return a text of the file as a whole, empty if there is none."""
        return self.attributes.get(attribute, "")

    def array(self, name: str) -> Array:
        """Return a variable; MeshFileError if it is in pieces."""
        found = self.stored(name)
        self.file.seek(found.begin)
        return np.frombuffer(self.file.read(found.end - found.begin), found.dtype).reshape(found.shape)

    def table(self, name: str) -> FileTable | Held:
        """Return where the rows of a variable are; errors as of `array`."""
        found = self.stored(name)
        return FileTable(
            Path(self.file.name).resolve(), found.begin, found.dtype.str, found.shape[0], prod(found.shape[1:])
        )

    def stored(self, name: str) -> Variable:
        """Return a variable, of which nothing is read; MeshFileError if it is in pieces."""
        found = self.variables[name]
        if found.grows:
            raise MeshFileError(f"{name} has an unlimited dimension; fix its length with `nccopy -u IN OUT`")
        return found

    def spans(self, name: str) -> list[Span]:
        """Return where the numbers of a variable are."""
        found = self.stored(name)
        return [(found.begin, 0, found.size)]


@dataclass(frozen=True, slots=True, eq=False)
class InHdf5:
    """An open file of netCDF-4: variables are datasets of the root group, and so are dimensions."""

    file: Any

    def __contains__(self, name: str) -> bool:
        return name in self.file

    def length(self, dimension: str) -> int | None:
        """Return the length of a dimension, None if there is none of that name."""
        found = self.file.get(dimension)
        return int(found.shape[0]) if isinstance(found, h5py.Dataset) and found.shape else None

    def text(self, attribute: str) -> str:
        """Return a text of the file as a whole, empty if there is none."""
        value = self.file.attrs.get(attribute, "")
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.item()
        text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
        return text.rstrip("\0") if isinstance(text, str) else ""

    def array(self, name: str) -> Array:
        """Return a variable; MeshFileError if it is elsewhere, or the file holds only a part of it."""
        return np.asarray(self.stored(name)[()])

    def table(self, name: str) -> FileTable | Held:
        """Return where the rows of a variable are; they are in memory if HDF5 has them in several places, or packed."""
        stored, places = self.stored(name), self.spans(name)
        width = prod(stored.shape[1:])
        if len(places) != 1:
            return Held(stored[()].reshape(-1, width))
        return FileTable(Path(stored.file.filename).resolve(), places[0][0], stored.dtype.str, len(stored), width)

    def spans(self, name: str) -> list[Span]:
        """Return where the numbers of a variable are; nothing if they are packed."""
        return spans(self.stored(name))

    def stored(self, name: str) -> Any:
        """Return a variable; errors as of `array`."""
        found = self.file.get(name)
        if not isinstance(found, h5py.Dataset) or found.shape is None:
            raise MeshFileError(f"{name} holds no data; the file is damaged")
        own = isinstance(self.file.get(name, getlink=True), h5py.HardLink)
        if not own or found.external or found.is_virtual:
            raise MeshFileError(f"{name} is a link; `nccopy IN OUT` puts all in one file")
        check_stored(found, name)
        return found


NetCdf = Classic | InHdf5


@contextmanager
def opened(path: Path) -> Iterator[NetCdf]:
    """Open a file of any of the three formats.

    MeshFileError if it is of another one, or its header is damaged or announces more than the file holds.
    """
    with path.open("rb") as file:
        magic = file.read(4)
        if magic in MAGIC:
            yield _Header(file, os.fstat(file.fileno()).st_size, magic[3]).read()
            return
    if magic[:4] == HDF5 and h5py.is_hdf5(path):
        with damage(), h5py.File(path) as opened_file:
            yield InHdf5(opened_file)
        return
    if magic == CDF5:
        raise MeshFileError("this is netCDF with sizes of 64 bits (CDF-5); run `nccopy -k 64-bit-offset IN OUT`")
    raise MeshFileError("this is no netCDF file: it begins with neither CDF nor the signature of HDF5")


@dataclass(slots=True, eq=False)
class _Header:
    """The header of a file of `length` bytes, read from its fifth byte on."""

    file: BinaryIO
    length: int
    version: int

    def read(self) -> Classic:
        self._number()  # of records
        dimensions = [(self._name(), self._size()) for _ in range(self._count(DIMENSIONS))]
        attributes = self._attributes()
        variables = dict(self._variable(dimensions) for _ in range(self._count(VARIABLES)))
        places = [(self.file.tell(), 0, "the header")]
        places += [(found.end, found.begin, name) for name, found in variables.items() if not found.grows]
        _check_places(sorted(places, key=lambda place: place[1]), self.length)
        return Classic(self.file, dict(dimensions), attributes, variables)

    def _bytes(self, count: int) -> bytes:
        data = self.file.read(count)
        if len(data) < count:
            raise MeshFileError("the file ends within its header; it is truncated or damaged")
        return data

    def _number(self, width: int = 4) -> int:
        return int.from_bytes(self._bytes(width), "big", signed=True)

    def _size(self, width: int = 4) -> int:
        size = self._number(width)
        if size < 0:
            raise MeshFileError(f"the header holds a length or an offset of {size}; the file is damaged")
        return size

    def _few(self) -> int:
        count = self._size()
        if count > MANY:
            raise MeshFileError(f"the header announces {count} entries or letters; the file is damaged")
        return count

    def _count(self, tag: int) -> int:
        found, count = self._number(), self._few()
        if found != tag and (found or count):
            raise MeshFileError(f"the header has a list of kind {found} where {tag} should be; the file is damaged")
        return count

    def _name(self) -> str:
        count = self._few()
        return self._bytes(count + -count % 4)[:count].decode("utf-8", "replace")

    def _kind(self) -> int:
        kind = self._number()
        if kind not in KINDS:
            raise MeshFileError(f"the header has numbers of kind {kind}, expected 1 to 6; the file is damaged")
        return kind

    def _attributes(self) -> dict[str, str]:
        """Texts by name; other attributes are passed over."""
        found = {}
        for _ in range(self._count(ATTRIBUTES)):
            name, kind, size = self._name(), self._kind(), self._size()
            size *= np.dtype(KINDS[kind]).itemsize
            if kind == TEXT and size <= MANY:
                found[name] = self._bytes(size + -size % 4)[:size].decode("utf-8", "replace").rstrip("\0")
            elif self.file.seek(size + -size % 4, os.SEEK_CUR) > self.length:
                raise MeshFileError("the file ends within its header; it is truncated or damaged")
        return found

    def _variable(self, dimensions: list[tuple[str, int]]) -> tuple[str, Variable]:
        name = self._name()
        own = [self._size() for _ in range(self._few())]
        if own and max(own) >= len(dimensions):
            raise MeshFileError(f"{name} has dimension {max(own)} of {len(dimensions)}; the file is damaged")
        self._attributes()
        kind = np.dtype(KINDS[self._kind()])
        self._number()  # its size, which does not hold for large variables
        begin = self._size(4 if self.version == 1 else 8)
        shape = tuple(dimensions[i][1] for i in own)
        return name, Variable(kind, shape, begin, bool(shape) and not shape[0])


def _check_places(places: list[tuple[int, int, str]], length: int) -> None:
    """Refuse (MeshFileError) variables that share bytes with another or the header, or end after the file."""
    for end, _, name in places:
        if end > length:
            raise MeshFileError(f"{name} ends at byte {end} of {length}; the file is truncated or damaged")
    for (end, _, name), (_, begin, after) in pairwise(places):
        if begin < end:
            raise MeshFileError(f"{after} begins within {name}; the file is damaged")
