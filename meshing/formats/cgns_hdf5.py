"""Nodes of a CGNS file in HDF5: groups with a label, and data in a dataset named ``" data"``."""

from collections.abc import Container, Iterable
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike

from .cgns_nodes import LINK, Array, Node, Stored, linked
from .hdf5 import check_stored, is_real

DATA = " data"
# CGNS names of NumPy's types.
KINDS = {"int8": "C1", "int32": "I4", "int64": "I8", "float32": "R4", "float64": "R8"}
# Bytes of a node's name by the SIDS.
NAME_LENGTH = 32
Integer = type[np.int32] | type[np.int64]


class HdfStored(Stored):
    """A dataset; `path` is its name in the file."""

    def __init__(self, dataset: Any) -> None:
        self.dataset, self.shape, self.dtype, self.path = dataset, dataset.shape, dataset.dtype, dataset.name
        self.begin = dataset.id.get_offset() or 0

    @property
    def is_real(self) -> bool:
        return is_real(self.dataset)

    def read(self, kind: DTypeLike | None = None) -> Array:
        if kind is None:
            return np.asarray(self.dataset[()])
        values = np.empty(self.shape, kind)
        if values.size:
            self.dataset.read_direct(values)
        return values

    def first(self) -> int | None:
        found = np.ravel(self.dataset[:1])[:1].tolist()
        return found[0] if found else None


class HdfNode(Node):
    """A group."""

    def __init__(self, group: Any) -> None:
        self.group, self.name, self.label = group, group.name.strip("/"), _attribute(group, "label")
        self.file_size = int(group.file.id.get_filesize())

    def __contains__(self, name: str) -> bool:
        return name in self.group

    def names(self) -> list[str]:
        tracked = self.group.id.get_create_plist().get_link_creation_order() & h5py.h5p.CRT_ORDER_TRACKED
        names: list[bytes] = []
        order = h5py.h5.INDEX_CRT_ORDER if tracked else h5py.h5.INDEX_NAME
        self.group.id.links.iterate(names.append, idx_type=order)
        return [name.decode("utf-8", "surrogateescape") for name in names]

    def find(self, name: str) -> "HdfNode | None":
        found = self._own(name)
        return HdfNode(found) if isinstance(found, h5py.Group) else None

    def stored(self) -> HdfStored | None:
        found = self._own(DATA)
        if not isinstance(found, h5py.Dataset) or found.shape is None:
            return None
        if found.external or found.is_virtual:
            raise linked(f"the data of {self.name}")
        check_stored(found, self.name)
        return HdfStored(found)

    def _own(self, name: str) -> Any:
        """Return what the group holds by that name, None if it is missing; MeshFileError if it is a link."""
        if _attribute(self.group, "type") == LINK:
            raise linked(self.name)
        if not isinstance(self.group.get(name, getlink=True), h5py.HardLink | None):
            raise linked(f"{self.name}/{name}".strip("/"))
        return self.group.get(name)


def create(parent: Any, name: str, label: str, values: Array | str | None = None) -> Any:
    """Add a node with data (a string is stored as characters) to a group and return its group."""
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


def _attribute(node: Any, key: str) -> str:
    value = node.attrs.get(key, b"")
    return value.decode("ascii", "replace").strip(" \0") if isinstance(value, bytes) else str(value)
