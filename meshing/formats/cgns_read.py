"""The mesh of an open CGNS file: its base, its zones, and how they fit together."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np

from sdm_deflect.deform.mesh import Cells, Mesh, Patch, Polyhedra
from sdm_deflect.meshing.formats import adf
from sdm_deflect.meshing.formats.cgns_blocks import Size, block_patches, cells, size_of
from sdm_deflect.meshing.formats.cgns_boundary import NumberedFaces, conditions, patches
from sdm_deflect.meshing.formats.cgns_elements import NFACE, NGON, Section, blocks, read_polyhedra, sections
from sdm_deflect.meshing.formats.cgns_interfaces import Interface, interfaces, pairs
from sdm_deflect.meshing.formats.cgns_nodes import AXES, child, children, data, integers, text
from sdm_deflect.meshing.formats.fitted import Fitted, Part, fitted
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.hdf5 import is_real
from sdm_deflect.meshing.formats.shapes import check_faces, oriented
from sdm_deflect.meshing.mesh import FloatArray

DIMENSIONS = (3, 3), (2, 2), (2, 3)
"""Dimensions of the cells and of the points; those of points in a plane mesh may be three, with one z."""
TYPES = ("Structured", "Unstructured")


@dataclass(frozen=True, slots=True)
class Base:
    """The base of a file that holds the mesh.

    Attributes
    ----------
    node : its node.
    zones : its zones by name, in the file's order.
    sizes : by name, the points along each axis of a block, or all points of an unstructured zone.
    dimension : that of the cells.
    axes : names of the coordinates.
    """

    node: Any = field(repr=False)
    dimension: int
    axes: tuple[str, ...]
    zones: dict[str, Any] = field(repr=False)
    sizes: dict[str, Size]


def read_base(file: Any, report: Callable[[float], None]) -> Fitted:
    """Return the mesh of an open file, its zones put together where interfaces say that they fit.

    MeshFileError or ValueError if the file is damaged, or holds what is no mesh in three dimensions.
    """
    base = base_of(file)
    parts, ends = [], []
    for i, name in enumerate(base.zones):
        report(i / len(base.zones))
        with _about(name):
            part, own = _zone(base, name)
        parts.append(part)
        ends.append(own)
    found = _put_together(parts, ends)
    report(1.0)
    return found


def base_of(file: Any) -> Base:
    """Return the base of a file: the one with volume cells, else the one with plane cells.

    MeshFileError if there are several or none, or no zone in it.
    """
    bases = [base for _, base in children(file, "CGNSBase_t")]
    if not bases:
        kind = "ADF" if isinstance(file, adf.Node) else "HDF5"
        raise MeshFileError(f"this {kind} file has no CGNSBase_t; it is no CGNS file, or it is damaged")
    each = [tuple(integers(base).tolist()) for base in bases]
    solid = [i for i, own in enumerate(each) if own == (3, 3)]
    chosen = solid or [i for i, own in enumerate(each) if own in DIMENSIONS]
    if len(chosen) != 1:
        held = "cells in three dimensions" if solid else "cells in three dimensions, or in a plane"
        raise MeshFileError(f"{len(chosen)} of {len(bases)} bases have {held}; one is needed")
    node, (dimension, axes) = bases[chosen[0]], each[chosen[0]]
    zones = dict(children(node, "Zone_t"))
    if not zones:
        raise MeshFileError("the file has no zones")
    sizes = {}
    for name, zone in zones.items():
        with _about(name):
            sizes[name] = _size(zone, dimension)
    return Base(node, dimension, AXES[:axes], zones, sizes)


def connected(base: Base) -> bool:
    """Whether zones have interfaces."""
    return any(True for zone in base.zones.values() for _ in children(zone, "ZoneGridConnectivity_t"))


def coordinate_data(base: Base, name: str) -> list[Any]:
    """Return the data of x, y and z of a zone; MeshFileError if one is missing, or is not a number for each point."""
    grid = child(base.zones[name], "GridCoordinates")
    expected = base.sizes[name][::-1]
    if any(integers(node).any() for _, node in children(grid, "Rind_t")):
        raise MeshFileError("its coordinates have rind planes, which would stay behind; export the mesh without them")
    found = [data(child(grid, axis)) for axis in base.axes]
    for axis, stored in zip(base.axes, found, strict=True):
        if stored.shape != expected or stored.dtype.kind != "f":
            raise MeshFileError(f"{axis} holds {stored.shape} {stored.dtype}, expected {expected} real numbers")
        if not isinstance(stored, adf.Stored) and not is_real(stored):
            raise MeshFileError(f"{axis} holds real numbers of an unknown kind; the file is damaged")
    return found


@contextmanager
def _about(name: str) -> Iterator[None]:
    """Name a zone in the errors that it causes in the block."""
    try:
        yield
    except (MeshFileError, ValueError) as error:
        raise MeshFileError(f"zone {name}: {error}") from error


def _size(zone: Any, dimension: int) -> Size:
    kind = text(child(zone, "ZoneType"))
    if kind not in TYPES:
        raise MeshFileError(f"it is of type {kind!r}, expected one of {', '.join(TYPES)}")
    if kind == "Structured":
        return size_of(zone, dimension)
    sizes = integers(zone)
    if len(sizes) != 3:
        raise MeshFileError(f"its size has {len(sizes)} numbers, expected 3; the file is damaged")
    return (int(sizes[0]),)


def _put_together(parts: Sequence[Part], ends: Sequence[Sequence[Interface]]) -> Fitted:
    number = {part.name: i for i, part in enumerate(parts)}
    starts = np.cumsum([0, *(len(part.mesh.points) for part in parts)])
    touching, same = [], []
    for i, own in enumerate(ends):
        for interface in own:
            j = number[interface.donor]
            if interface.matching:
                rows = pairs(parts[i].mesh.points, parts[j].mesh.points, interface)
                if rows is None:
                    continue
                same.append(rows + np.array([starts[i], starts[j]]))
            touching.append((i, j))
    return fitted(parts, touching, same)


def _zone(base: Base, name: str) -> tuple[Part, list[Interface]]:
    size = base.sizes[name]
    axes = coordinate_data(base, name)
    points = np.zeros((prod(size), 3))
    for column, axis in enumerate(axes):
        points[:, column] = axis[()].reshape(len(points))
    return (_block if len(size) > 1 else _unstructured)(base, name, points)


def _block(base: Base, name: str, points: FloatArray) -> tuple[Part, list[Interface]]:
    zone, size = base.zones[name], base.sizes[name]
    own = cells(size)
    turned = oriented(points, own)
    left_handed = bool(2 * np.count_nonzero(turned.nodes[:, 1] != own.nodes[:, 1]) > len(own))
    named, rest, families = block_patches(base.node, zone, size, left_handed)
    part = Part(name, Mesh(points, (turned,), _by_name([*named, *rest])), frozenset(families))
    return part, interfaces(zone, name, base.sizes, ())


def _unstructured(base: Base, name: str, points: FloatArray) -> tuple[Part, list[Interface]]:
    zone = base.zones[name]
    found = sections(zone)
    if not found:
        raise MeshFileError("it has no elements")
    polyhedral = any(section.kind in (NGON, NFACE) for section in found)
    if polyhedral and base.dimension == 2:
        raise MeshFileError("cells by their faces (NGON_n) in two dimensions; triangles and quads can be read")
    volume, faces = _polyhedral(found, points) if polyhedral else _shaped(found, points, base.dimension)
    named = conditions(base.node, zone, found[-1].last, len(points), base.dimension)
    mesh = Mesh(points, volume, tuple(patches(named, faces, found[-1].last)))
    check_faces(mesh)
    families = frozenset(one.patch for one in named if one.of_family)
    return Part(name, mesh, families), interfaces(zone, name, base.sizes, faces)


def _by_name(found: Sequence[Patch]) -> tuple[Patch, ...]:
    """Patches of one name as one."""
    faces: dict[str, list[Any]] = {}
    for patch in found:
        faces.setdefault(patch.name, []).extend(patch.faces)
    return tuple(Patch(name, tuple(own)) for name, own in faces.items())


def _shaped(
    found: Sequence[Section], points: FloatArray, dimension: int
) -> tuple[tuple[Cells, ...], list[NumberedFaces]]:
    cells, faces = [], []
    for section in found:
        for block, numbers in blocks(section, len(points), dimension):
            if len(numbers):
                faces.append(NumberedFaces(section.name, block, numbers))
            else:
                cells.append(oriented(points, block))
    return tuple(cells), faces


def _polyhedral(found: Sequence[Section], points: FloatArray) -> tuple[tuple[Polyhedra], list[NumberedFaces]]:
    if others := [section.name for section in found if section.kind not in (NGON, NFACE)]:
        raise MeshFileError(f"cells by their faces (NGON_n) and other elements ({', '.join(others)}) in one zone")
    block, numbers = read_polyhedra(found, len(points))
    inner = len(block.neighbour)
    faces = [
        NumberedFaces(None, block.faces.rows(0, inner), numbers[:inner], outer=False),
        NumberedFaces(None, block.faces.rows(inner, len(block.faces)), numbers[inner:]),
    ]
    return (block,), faces
