"""Nodes of a CGNS file: groups with a label, and data in a dataset named ``" data"``."""

from collections.abc import Container, Iterable, Iterator
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.unpacking import check_unpacked

from .hdf5 import check_stored, is_real

DATA = " data"
# CGNS names of NumPy's types.
KINDS = {"int8": "C1", "int32": "I4", "int64": "I8", "float32": "R4", "float64": "R8"}
# Bytes of a node's name by the SIDS.
NAME_LENGTH = 32
Array = NDArray[Any]
Integer = type[np.int32] | type[np.int64]
AXES = ("CoordinateX", "CoordinateY", "CoordinateZ")


def children(node: Any, label: str) -> Iterator[tuple[str, Any]]:
    """Yield name and group of each child with that label, in order of creation; MeshFileError for links of HDF5."""
    for name in _names(node):
        child = _own(node, name)
        if isinstance(child, h5py.Group) and label_of(child) == label:
            yield name, child


def child(node: Any, name: str) -> Any:
    """Return the child of that name; MeshFileError if it is missing or a link."""
    group = _own(node, name)
    if not isinstance(group, h5py.Group):
        raise MeshFileError(f"{node.name.strip('/') or 'the file'} has no {name}")
    return group


def has(node: Any, name: str) -> bool:
    """Whether a node has a child of that name."""
    return name in node


def label_of(node: Any) -> str:
    """Return the label of a node by the SIDS, such as ``Zone_t`` or ``BC_t``."""
    return _attribute(node, "label")


def data(node: Any) -> Any:
    """Return the dataset of a node.

    MeshFileError if it is absent, a link, stored in another file or dataset, or much larger than the file.
    """
    name = node.name.strip("/")
    stored = _own(node, DATA)
    if not isinstance(stored, h5py.Dataset) or stored.shape is None:
        raise MeshFileError(f"{name} holds no data; the file is damaged")
    if stored.external or stored.is_virtual:
        raise _linked(f"the data of {name}")
    check_stored(stored, name)
    return stored


def check_taken(node: Any, size: int, what: str) -> None:
    """Raise InputError if data of `size` bytes are too large for a file as long as the node's."""
    check_unpacked(size, node.file.id.get_filesize(), what)


def integers(node: Any) -> IntArray:
    """Return the data (K,) of a node of integers, flat, in the order of the file; MeshFileError for other data."""
    stored = _of_kind(node, "iu", "integers")
    values = np.empty(stored.shape, dtype=np.intp)
    if values.size:
        stored.read_direct(values)
    return values.reshape(-1)


def reals(node: Any) -> Any:
    """Return the data of a node of real numbers, not read yet; MeshFileError for other data."""
    stored = _of_kind(node, "f", "real numbers")
    if not is_real(stored):
        raise MeshFileError(f"{node.name.strip('/')} holds real numbers of an unknown kind; the file is damaged")
    return stored


def text(node: Any) -> str:
    """Return the data of a node of characters, without blanks at its end; MeshFileError for other data."""
    letters: bytes = _of_kind(node, "iu", "characters")[()].astype(np.uint8).tobytes()
    return letters.decode("utf-8", "replace").rstrip(" \0")


def _of_kind(node: Any, kinds: str, what: str) -> Any:
    stored = data(node)
    if stored.dtype.kind not in kinds:
        raise MeshFileError(f"{node.name.strip('/')} holds {stored.dtype}, expected {what}; the file is damaged")
    return stored


def create(parent: Any, name: str, label: str, values: Array | str | None = None) -> Any:
    """Add a node with data (a string is stored as characters) and return it."""
    stored = np.frombuffer(values.encode(), dtype=np.int8) if isinstance(values, str) else values
    node = _empty(parent, name, label, "MT" if stored is None else KINDS[stored.dtype.name])
    if stored is not None:
        node.create_dataset(DATA, data=stored)
    return node


def create_sized(parent: Any, name: str, size: int, kind: type[np.generic]) -> Any:
    """Add a node DataArray_t of `size` numbers that are written later, and return its dataset."""
    return _empty(parent, name, "DataArray_t", KINDS[np.dtype(kind).name]).create_dataset(DATA, (size,), dtype=kind)


def node_names(names: Iterable[str], taken: Container[str]) -> list[str]:
    """Return valid names of nodes (32 bytes, no slash or null), distinct from one another and from the names taken."""
    fitted: list[str] = []
    for name in names:
        plain = name.replace("/", "_").replace("\0", "_").strip(" .")
        stem = plain.encode()[:NAME_LENGTH].decode("utf-8", "ignore") or "unnamed"
        fitting, i = stem, 2
        while fitting in fitted or fitting in taken:
            fitting = f"{stem.encode()[: NAME_LENGTH - 1 - len(str(i))].decode('utf-8', 'ignore')} {i}"
            i += 1
        fitted.append(fitting)
    return fitted


def _empty(parent: Any, name: str, label: str, kind: str) -> Any:
    node = parent.create_group(name, track_order=True)
    describe(node, name, label, kind)
    node.attrs.create("flags", np.array([1], dtype=np.int32))
    return node


def describe(node: Any, name: str, label: str, kind: str) -> None:
    """Set the three attributes of fixed length that every node has."""
    for key, value, length in (("name", name, NAME_LENGTH), ("label", label, NAME_LENGTH), ("type", kind, 2)):
        letters = h5py.h5t.C_S1.copy()
        letters.set_size(length + 1)
        place = h5py.h5a.create(node.id, key.encode(), letters, h5py.h5s.create(h5py.h5s.SCALAR))
        place.write(np.array(value.encode(), dtype=f"S{length + 1}"))


def _own(node: Any, name: str) -> Any:
    """Return the child of that name, None if it is missing; MeshFileError if it is a link."""
    if _attribute(node, "type") == "LK":
        raise _linked(node.name.strip("/"))
    if not isinstance(node.get(name, getlink=True), h5py.HardLink | None):
        raise _linked(f"{node.name}/{name}".strip("/"))
    return node.get(name)


def _linked(what: str) -> MeshFileError:
    return MeshFileError(f"{what} is a link; `cgnsconvert -f -l IN.cgns OUT.cgns` puts all in one file")


def _attribute(node: Any, key: str) -> str:
    value = node.attrs.get(key, b"")
    return value.decode("ascii", "replace").strip(" \0") if isinstance(value, bytes) else str(value)


def _names(node: Any) -> list[str]:
    tracked = node.id.get_create_plist().get_link_creation_order() & h5py.h5p.CRT_ORDER_TRACKED
    names: list[bytes] = []
    node.id.links.iterate(names.append, idx_type=h5py.h5.INDEX_CRT_ORDER if tracked else h5py.h5.INDEX_NAME)
    return [name.decode("utf-8", "surrogateescape") for name in names]
