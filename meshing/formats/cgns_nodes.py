"""The tree of nodes in a CGNS file, as its readers know it: the same in HDF5 (`cgns_hdf5`) and in ADF (`adf`)."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from sdm_deflect.base.arrays import IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.unpacking import check_unpacked

AXES = ("CoordinateX", "CoordinateY", "CoordinateZ")
# Type of the data of a node that is a link.
LINK = "LK"
Array = NDArray[Any]


class Stored(ABC):
    """The numbers of a node, not read yet.

    Attributes
    ----------
    shape : numbers in each direction, the last one fastest: the reverse of the SIDS.
    dtype : their type, with the file's order of bytes.
    begin : first byte of the numbers in the file; 0 if they do not stand there in one run.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    begin: int

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return int(np.prod(self.shape, dtype=object))

    @property
    def is_real(self) -> bool:
        """Whether they are real numbers of a kind that NumPy has."""
        return self.dtype.kind == "f"

    @abstractmethod
    def read(self, kind: DTypeLike | None = None) -> Array:
        """Return all numbers, of another type if `kind` is given."""

    @abstractmethod
    def first(self) -> int | None:
        """Return the first number, which must be whole; None if there is none."""


class Node(ABC):
    """A node.

    Attributes
    ----------
    name : its path from the root, such as ``Base/Zone``.
    label : its label by the SIDS, such as ``Zone_t`` or ``BC_t``.
    file_size : bytes of the file.
    """

    name: str
    label: str
    file_size: int

    @abstractmethod
    def __contains__(self, name: str) -> bool:
        """Whether there is a child of that name."""

    @abstractmethod
    def names(self) -> list[str]:
        """Return the names of the children, in order of creation."""

    @abstractmethod
    def find(self, name: str) -> "Node | None":
        """Return the child of that name, None if it is missing; MeshFileError if it, or this node, is a link."""

    @abstractmethod
    def stored(self) -> Stored | None:
        """Return the data, None if there are none.

        MeshFileError if they stand elsewhere, are not complete, or would take much more memory than the file is large.
        """


def children(node: Node, label: str) -> Iterator[tuple[str, Node]]:
    """Yield name and node of each child with that label, in order of creation; MeshFileError for links."""
    for name in node.names():
        found = node.find(name)
        if found is not None and found.label == label:
            yield name, found


def child(node: Node, name: str) -> Node:
    """Return the child of that name; MeshFileError if it is missing or a link."""
    found = node.find(name)
    if found is None:
        raise MeshFileError(f"{node.name or 'the file'} has no {name}")
    return found


def has(node: Node, name: str) -> bool:
    """Whether a node has a child of that name."""
    return name in node


def label_of(node: Node) -> str:
    """Return the label of a node by the SIDS, such as ``Zone_t`` or ``BC_t``."""
    return node.label


def data(node: Node) -> Stored:
    """Return the data of a node, not read yet; MeshFileError if there are none, and as `Node.stored`."""
    stored = node.stored()
    if stored is None:
        raise MeshFileError(f"{node.name} holds no data; the file is damaged")
    return stored


def check_taken(node: Node, size: int, what: str) -> None:
    """Raise InputError if data of `size` bytes are too large for a file as long as the node's."""
    check_unpacked(size, node.file_size, what)


def integers(node: Node) -> IntArray:
    """Return the data (K,) of a node of integers, flat, in the order of the file; MeshFileError for other data."""
    return _of_kind(node, "iu", "integers").read(np.intp).reshape(-1)


def reals(node: Node) -> Stored:
    """Return the data of a node of real numbers, not read yet; MeshFileError for other data."""
    stored = _of_kind(node, "f", "real numbers")
    if not stored.is_real:
        raise MeshFileError(f"{node.name} holds real numbers of an unknown kind; the file is damaged")
    return stored


def text(node: Node) -> str:
    """Return the data of a node of characters, without blanks at its end; MeshFileError for other data."""
    letters: bytes = _of_kind(node, "iu", "characters").read().astype(np.uint8).tobytes()
    return letters.decode("utf-8", "replace").rstrip(" \0")


def linked(what: str) -> MeshFileError:
    """Return the error for a node that is a link."""
    return MeshFileError(f"{what} is a link; `cgnsconvert -f -l IN.cgns OUT.cgns` puts all in one file")


def _of_kind(node: Node, kinds: str, what: str) -> Stored:
    stored = data(node)
    if stored.dtype.kind not in kinds:
        raise MeshFileError(f"{node.name} holds {stored.dtype}, expected {what}; the file is damaged")
    return stored
