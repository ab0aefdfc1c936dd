"""Cells, faces and patches: the arrays of a mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from sdm_deflect.base.arrays import FloatArray, IntArray, union
from sdm_deflect.base.errors import InputError, shortened

# Number of nodes of each shape. Names are meshio's; nodes are in the order of VTK's linear cells.
# The normal of a wedge's first triangle points outwards, opposite to Gmsh and CGNS; `MIRRORED` converts one to the
# other.
CORNERS = {
    "line": 2, "triangle": 3, "quad": 4, "tetra": 4, "pyramid": 5, "wedge": 6, "hexahedron": 8,
}  # fmt: skip
# The same corners in the order of the mirror image. For a wedge: from CGNS and Gmsh to VTK, and back.
MIRRORED = {
    "tetra": (0, 2, 1, 3), "pyramid": (0, 3, 2, 1, 4), "wedge": (0, 2, 1, 3, 5, 4),
    "hexahedron": (0, 3, 2, 1, 4, 7, 6, 5),
}  # fmt: skip
VOLUMES = ("tetra", "pyramid", "wedge", "hexahedron")
# Cells of a plane mesh, whose points share one coordinate; its boundary consists of lines.
PLANE = ("triangle", "quad")
RISING = "offsets must rise from 0 to {} in steps of 2 or more"
# Messages for wrong offsets of faces, and for wrong owners and neighbours.
OWNERS = "{} faces need as many owners, got {}, and no more neighbours, got {}"
# Largest difference of a rotation times its transpose from the identity: files have few digits.
ORTHOGONAL = 1e-6
# Larger coordinates would overflow in the sixth power of a length.
LARGEST = 1e40
# Constraint of a patch's nodes in the file: they stay in its plane; they are copies of the nodes on the other side of a
# plane case one cell thick; or the same of an axisymmetric case, by a rotation.
Constraint = Literal["", "symmetry", "empty", "wedge"]


def whole(values: ArrayLike, what: str) -> IntArray:
    """Return the values as an array; InputError, which names `what`, unless they are whole numbers."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise InputError(f"{what}: rows of different lengths") from None
    if array.dtype.kind in "iu":
        return array.astype(array.dtype.newbyteorder("="), copy=False)
    if array.size:
        raise InputError(f"{what} must be whole numbers, not {array.dtype}")
    return array.astype(np.intp)


def real(values: ArrayLike, what: str) -> FloatArray:
    """Return the values as an array; InputError, which names `what`, unless they are floating-point numbers."""
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "iufO":
            raise TypeError
        return array.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} must be real numbers, in rows of one length") from None


def bounded(values: ArrayLike, what: str) -> FloatArray:
    """Return the values as an array; InputError, which names `what`, unless they are finite and below `LARGEST`."""
    array = real(values, what)
    if not (array.min(initial=0.0) > -LARGEST and array.max(initial=0.0) < LARGEST):
        raise InputError(f"{what}: a coordinate is not finite, or beyond {LARGEST:g}")
    return array


def several(values: object, kinds: tuple[type, ...], what: str) -> tuple[Any, ...]:
    """Return objects as a tuple; InputError, which names `what`, unless all are of these kinds."""
    if not isinstance(values, list | tuple) or not all(isinstance(value, kinds) for value in values):
        names = " or ".join(kind.__name__ for kind in kinds)
        raise InputError(f"{what} = {shortened(values)} must be a list of {names}")
    return tuple(values)


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Cells, or boundary faces, of one shape.

    Parameters
    ----------
    shape : ``"triangle"``, ``"quad"``, ``"tetra"``, ``"pyramid"``, ``"wedge"`` or ``"hexahedron"``, or ``"line"``.
    nodes : (M, k) node indices, counted from 0, in VTK's order.

    Raises InputError if the shape is unknown, or the nodes are not whole numbers (M, k).
    """

    shape: str
    nodes: IntArray = field(repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.shape, str) or self.shape not in CORNERS:
            raise InputError(f"shape {shortened(self.shape)} is not one of {', '.join(CORNERS)}")
        object.__setattr__(self, "nodes", whole(self.nodes, f"{self.shape} nodes"))
        if self.nodes.ndim != 2 or self.nodes.shape[1] != CORNERS[self.shape]:
            raise InputError(f"{self.shape} nodes {self.nodes.shape} must be (M, {CORNERS[self.shape]})")

    def __len__(self) -> int:
        return len(self.nodes)


@dataclass(frozen=True, slots=True, eq=False)
class Polygons:
    """Faces with any number of corners; faces of two corners are the lines around a plane mesh.

    Parameters
    ----------
    nodes : (K,) node indices of all faces.
    offsets : (F + 1,) start of each face in `nodes`, and the end of the last one.
    """

    nodes: IntArray = field(repr=False)
    offsets: IntArray = field(repr=False)

    def __post_init__(self) -> None:
        o = self.offsets
        if o.ndim != 1 or not len(o) or o[0] != 0 or o[-1] != len(self.nodes) or np.any(np.diff(o) < 2):
            raise ValueError(RISING.format(len(self.nodes)))

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def rows(self, start: int, stop: int) -> Polygons:
        """Return faces start to stop - 1."""
        ends = self.offsets[start : stop + 1]
        return Polygons(self.nodes[ends[0] : ends[-1]], ends - ends[0])


@dataclass(frozen=True, slots=True, eq=False)
class Polyhedra:
    """Cells of any shape, given by their faces as in OpenFOAM.

    Parameters
    ----------
    faces : F faces; the normal of each (right-hand rule) points out of its owner.
    owner : (F,) cell on the back of each face.
    neighbour : (I,) cell in front of the first I faces; the others are on the boundary.
    kept : Results that are computed once, by name.
    """

    faces: Polygons
    owner: IntArray = field(repr=False)
    neighbour: IntArray = field(repr=False)
    kept: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if len(self.owner) != len(self.faces) or len(self.neighbour) > len(self.faces):
            raise ValueError(OWNERS.format(len(self.faces), len(self.owner), len(self.neighbour)))

    def __len__(self) -> int:
        return int(max(self.owner.max(initial=-1), self.neighbour.max(initial=-1))) + 1


Faces = Cells | Polygons
Volume = Cells | Polyhedra


@dataclass(frozen=True, eq=False)
class Patch:
    """A named part of the boundary, given by its faces or by its nodes alone.

    Parameters
    ----------
    name : Name, distinct within a mesh.
    faces : Blocks of faces of one shape, or polygons.
    loose : (K,) further nodes of the patch, which are on none of its faces.
    constraint : Constraint of its nodes in the file; empty for none.
    labels : By name, one number (F,) for each face, such as the face of the CAD that it lies on.
    part_of : Name of the patch that it was cut from for the motion, and that it belongs to in files.

    Raises InputError if the name is not text, or if faces, nodes or constraint are of another kind.
    """

    name: str
    faces: tuple[Faces, ...]
    loose: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)
    constraint: Constraint = ""
    labels: Mapping[str, IntArray] = field(default_factory=dict, repr=False)
    part_of: str = ""

    def __post_init__(self) -> None:
        if self.constraint not in get_args(Constraint):
            raise InputError(f"patch {self.name}: constraint {shortened(self.constraint)} is unknown")
        if not isinstance(self.name, str):
            raise InputError(f"name = {shortened(self.name)} of a patch must be text")
        object.__setattr__(self, "faces", several(self.faces, (Cells, Polygons), f"patch {self.name}: faces"))
        object.__setattr__(self, "loose", whole(self.loose, f"patch {self.name}: nodes").ravel())

    @cached_property
    def nodes(self) -> IntArray:
        """Sorted distinct indices (K,) of its nodes."""
        return union(self.loose, *(f.nodes for f in self.faces))

    def __len__(self) -> int:
        return sum(len(f) for f in self.faces)


@dataclass(frozen=True, slots=True, eq=False)
class Periodic:
    """Pairs of a node and its image by a rigid motion: ``image = rotation @ x + shift``.

    Parameters
    ----------
    name : Name, for messages and the check ``periodic_NAME``.
    patches : The two patches; the same name twice if the file has only one.
    nodes : (K, 2) node and image; no node occurs twice in a column. Empty if the faces of the two patches do not match
        one to one, as in OpenFOAM's ``cyclicAMI``.
    rotation : (3, 3) orthogonal, determinant +1.
    shift : (3,) in the mesh's unit of length.
    thin : Whether the patches are the two sides of a plane or axisymmetric case one cell thick.

    Raises InputError for arrays of other shapes, or if the matrix is not a rotation.
    """

    name: str
    patches: tuple[str, str]
    nodes: IntArray = field(repr=False)
    rotation: FloatArray = field(default_factory=lambda: np.eye(3), repr=False)
    shift: FloatArray = field(default_factory=lambda: np.zeros(3), repr=False)
    thin: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", whole(self.nodes, f"{self.name}: nodes").reshape(-1, 2))
        object.__setattr__(self, "rotation", real(self.rotation, f"{self.name}: rotation"))
        object.__setattr__(self, "shift", real(self.shift, f"{self.name}: shift"))
        if self.rotation.shape != (3, 3) or self.shift.shape != (3,):
            given = f"rotation {self.rotation.shape} and shift {self.shift.shape}"
            raise InputError(f"{self.name}: {given} must be (3, 3) and (3,)")
        off = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
        if not (off < ORTHOGONAL and np.linalg.det(self.rotation) > 0):
            raise InputError(f"{self.name}: the matrix of a periodic pair is no rotation")

    def image(self, points: FloatArray) -> FloatArray:
        """Return the images (K, 3) of points (K, 3)."""
        return points @ self.rotation.T + self.shift


@dataclass(frozen=True, slots=True, eq=False)
class Zone:
    """A part of a file with its own points start to stop - 1, such as one grid of an overset pair.

    If several zones fit together, `blocks` has the names of all, and `name` is the first.
    """

    name: str
    start: int
    stop: int
    blocks: tuple[str, ...] = ()


def take_faces(faces: Polygons, rows: IntArray) -> Polygons:
    """Return the faces of rows (R,), in that order."""
    sizes = np.diff(faces.offsets)[rows]
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp)
    return Polygons(faces.nodes[np.arange(offsets[-1]) + np.repeat(faces.offsets[rows] - offsets[:-1], sizes)], offsets)
