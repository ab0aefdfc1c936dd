"""The mesh of an open CGNS file: its base, its zones, and how they fit together."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, partial
from math import prod
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.mesh import Cells, Mesh, Patch, Polyhedra
from sdm_deflect.meshing.formats import adf
from sdm_deflect.meshing.formats.cgns_blocks import Size, block_patches, cells, collapsed, size_of
from sdm_deflect.meshing.formats.cgns_boundary import NumberedFaces, conditions, patches
from sdm_deflect.meshing.formats.cgns_elements import NFACE, NGON, Section, blocks, read_polyhedra, sections
from sdm_deflect.meshing.formats.cgns_interfaces import Interface, interfaces, meeting, pairs
from sdm_deflect.meshing.formats.cgns_nodes import AXES, child, children, data, has, integers, text
from sdm_deflect.meshing.formats.fitted import Fitted, Part, fitted
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.hdf5 import is_real
from sdm_deflect.meshing.formats.shapes import all_of, check_faces, chosen, oriented
from sdm_deflect.meshing.mesh import FloatArray, IntArray

DIMENSIONS = (3, 3), (2, 2), (2, 3)
"""Dimensions of the cells and of the points; those of points in a plane mesh may be three, with one z."""
NONE = np.empty((0, 2), dtype=np.intp)
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


@dataclass(frozen=True, slots=True, eq=False)
class _Zone:
    """A zone by itself, its interfaces, pairs (K, 2) of its points that are one, and its faces (F, k) on nothing."""

    part: Part
    interfaces: Sequence[Interface]
    collapsed: IntArray
    free: IntArray


def read_base(file: Any, report: Callable[[float], None]) -> Fitted:
    """Return the mesh of an open file, its zones put together where interfaces say that they fit.

    MeshFileError or ValueError if the file is damaged, or holds what is no mesh in three dimensions.
    """
    base = base_of(file)
    parts = []
    for i, name in enumerate(base.zones):
        report(i / len(base.zones))
        with _about(name):
            parts.append(_zone(base, name))
    found = _put_together(parts)
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


def may_fit(base: Base) -> bool:
    """Whether points of the file may be one: in blocks, and where zones have interfaces."""
    return any(len(size) > 1 for size in base.sizes.values()) or any(
        True for zone in base.zones.values() for _ in children(zone, "ZoneGridConnectivity_t")
    )


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
    kind = text(child(zone, "ZoneType")) if has(zone, "ZoneType") else "Structured"  # files of version 1.0 do not say
    if kind not in TYPES:
        raise MeshFileError(f"it is of type {kind!r}, expected one of {', '.join(TYPES)}")
    if kind == "Structured":
        return size_of(zone, dimension)
    sizes = integers(zone)
    if len(sizes) != 3:
        raise MeshFileError(f"its size has {len(sizes)} numbers, expected 3; the file is damaged")
    return (int(sizes[0]),)


def _put_together(zones: Sequence[_Zone]) -> Fitted:
    """Join the zones at their interfaces, and blocks where faces without a condition are at the same places."""
    number = {zone.part.name: i for i, zone in enumerate(zones)}
    starts = np.cumsum([0, *(len(zone.part.mesh.points) for zone in zones)])
    tree = cache(lambda j: cKDTree(zones[j].part.mesh.points))
    touching, same = [], []
    for i, zone in enumerate(zones):
        same.append(zone.collapsed + starts[i])
        for interface in zone.interfaces:
            j = number[interface.donor]
            if interface.matching:
                rows = pairs(zone.part.mesh.points, zones[j].part.mesh.points, interface, partial(tree, j))
                if rows is None:
                    continue
                same.append(rows + np.array([starts[i], starts[j]]))
            touching.append((i, j))
    parts = [_without_touching(zone) for zone in zones]
    free = [zone.free + starts[i] for i, zone in enumerate(zones) if len(zone.free)]
    if free:
        found = meeting(np.concatenate([zone.part.mesh.points for zone in zones]), np.concatenate(free))
        same.append(found)
        touching += np.unique(np.searchsorted(starts, found, side="right") - 1, axis=0).tolist()
    return fitted(parts, touching, [rows for rows in same if len(rows)])


def _without_touching(zone: _Zone) -> Part:
    """Return a zone's part without the faces, on its patches, that only touch those of another zone."""
    nodes = [interface.nodes for interface in zone.interfaces if not interface.matching]
    if not nodes:
        return zone.part
    marked = np.zeros(len(zone.part.mesh.points), dtype=np.bool_)
    marked[np.concatenate(nodes)] = True
    patches = []
    for patch in zone.part.mesh.patches:
        kept = [chosen(faces, np.flatnonzero(~all_of(marked, faces))) for faces in patch.faces]
        patches.append(replace(patch, faces=tuple(faces for faces in kept if len(faces))))
    mesh = replace(zone.part.mesh, patches=tuple(patch for patch in patches if patch.faces))
    return replace(zone.part, mesh=mesh)


def _zone(base: Base, name: str) -> _Zone:
    size = base.sizes[name]
    axes = coordinate_data(base, name)
    points = np.zeros((prod(size), 3))
    for column, axis in enumerate(axes):
        points[:, column] = axis[()].reshape(len(points))
    return (_block if len(size) > 1 else _unstructured)(base, name, points)


def _block(base: Base, name: str, points: FloatArray) -> _Zone:
    zone, size = base.zones[name], base.sizes[name]
    own = cells(size)
    turned = oriented(points, own)
    left_handed = bool(2 * np.count_nonzero(turned.nodes[:, 1] != own.nodes[:, 1]) > len(own))
    named, rest, families = block_patches(base.node, zone, size, left_handed)
    part = Part(name, Mesh(points, (turned,), _by_name([*named, *rest])), frozenset(families), block=True)
    free = [faces.nodes for patch in rest for faces in patch.faces]
    own_interfaces = interfaces(zone, name, base.sizes, ())
    return _Zone(part, own_interfaces, collapsed(points, size), np.concatenate(free) if free else NONE)


def _unstructured(base: Base, name: str, points: FloatArray) -> _Zone:
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
    return _Zone(Part(name, mesh, families), interfaces(zone, name, base.sizes, faces), NONE, NONE)


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
