"""The mesh of an open CGNS file: its base, its zones, and how they fit together."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, partial
from math import prod

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError, short_list
from sdm_deflect.meshing.mesh.cells import Cells, Polyhedra
from sdm_deflect.meshing.mesh.mesh import Mesh, Warned

from .cgns_blocks import Size, block_border, cells, equal_neighbours, no_cells, size_of, wide
from .cgns_boundary import PART, Fault, NumberedFaces, notes_of, without, zone_border
from .cgns_elements import NFACE, NGON, ElementSection, blocks, read_polyhedra, sections
from .cgns_interfaces import Interface, interfaces, meeting, pairs, periodic_pairs
from .cgns_nodes import AXES, Node, Stored, child, children, data, has, integers, text
from .conforming_zones import Fitted, ZoneMesh, fit_zones, simple
from .shapes import all_of, check_faces, chosen, orient
from .zones import Listed, with_pairs

# Dimensions of the cells and of the points; those of points in a plane mesh may be three, with one z.
DIMENSIONS = (3, 3), (2, 2), (2, 3)
NONE = np.empty((0, 2), dtype=np.intp)
TYPES = ("Structured", "Unstructured")
UNPAIRED = "zone {}: interface {} is periodic, and not every point has an image in zone {}; the pair is left out"
GRID = "GridCoordinates_t"
STAYS = (
    "the coordinates in {} stay as they are: what reads them has the undeflected mesh; remove them, or make them again"
)
PLANE = "the mesh is plane: its x and y are {} and {} of the file"


@dataclass(frozen=True, slots=True)
class Base:
    """The base of a file that holds the mesh.

    Attributes
    ----------
    node : its node.
    zones : its zones by name, in the file's order.
    sizes : by zone, the number of points along each axis of a block, or of all points of an unstructured zone.
    dimension : dimension of the cells; 2 also for blocks with one point along one of three axes.
    axes : names of the coordinates in the mesh's order; in a plane mesh the two in its plane come first.
    """

    node: Node = field(repr=False)
    dimension: int
    axes: tuple[str, ...]
    zones: dict[str, Node] = field(repr=False)
    sizes: dict[str, Size]


@dataclass(frozen=True, slots=True, eq=False)
class _CgnsZone:
    """A zone with its interfaces, pairs (K, 2) of equal points, and faces (F, k) without a condition.

    `faults` are its conditions and interfaces that could not be read.
    """

    part: ZoneMesh
    interfaces: Sequence[Interface]
    collapsed: IntArray
    free: IntArray
    faults: Sequence[Fault]


def read_base(file: Node, report: Callable[[float], None]) -> Fitted:
    """Return the mesh of an open file, its zones put together where interfaces say that they fit.

    MeshFileError or ValueError if the file is damaged, or its mesh has no cells in space or in a plane.
    """
    base = base_of(file)
    zones = []
    for i, name in enumerate(base.zones):
        report(i / len(base.zones))
        with _about(name):
            zones.append(_zone(base, name))
    together = _join_zones(_without_absent(zones))
    notes = notes_of({zone.part.name: zone.faults for zone in zones})
    notes = (*notes, *coordinates_beside(file, base))
    if base.dimension < len(base.axes) and base.axes != AXES:
        notes = (PLANE.format(*base.axes), *notes)
    report(1.0)
    return replace(together, mesh=replace(together.mesh, notes=(*notes, *together.mesh.notes))) if notes else together


def base_of(file: Node) -> Base:
    """Return the base of a file: the one with volume cells, else the one with plane cells.

    MeshFileError if there are several or none, or no zone in it.
    """
    node, (dimension, axes) = _only_base(file)
    zones = dict(children(node, "Zone_t"))
    if not zones:
        raise MeshFileError("the file has no zones")
    sizes = {}
    for name, zone in zones.items():
        with _about(name):
            sizes[name] = _size(zone, dimension)
    base = Base(node, _dimension(sizes, dimension), AXES[:axes], zones, sizes)
    return replace(base, axes=_plane_first(base)) if base.dimension < axes else base


def _only_base(file: Node) -> tuple[Node, tuple[int, int]]:
    """Return the base with cells, with their dimension and that of the points."""
    bases = [base for _, base in children(file, "CGNSBase_t")]
    if not bases:
        raise MeshFileError("the file has no CGNSBase_t; it is no CGNS file")
    each = [tuple(integers(base).tolist()) for base in bases]
    solid = [i for i, pair in enumerate(each) if pair == (3, 3)]
    chosen = solid or [i for i, pair in enumerate(each) if pair in DIMENSIONS]
    if len(chosen) != 1:
        needed = "cells in three dimensions" if solid else "cells in three dimensions, or in a plane"
        raise MeshFileError(f"{len(chosen)} of {len(bases)} bases have {needed}; one is needed")
    return bases[chosen[0]], each[chosen[0]]


def coordinates_beside(file: Node, base: Base) -> tuple[str, ...]:
    """Return warnings about coordinates that do not move: those of other bases, and of other times in the zones."""
    used = base.node.name
    zones = {f"base {name}": children(grid, "Zone_t") for name, grid in children(file, "CGNSBase_t") if name != used}
    others = [name for name, those in zones.items() if any(any(children(zone, GRID)) for _, zone in those)]
    for name, zone in base.zones.items():
        others += [f"{grid} of zone {name}" for grid, _ in children(zone, GRID) if grid != "GridCoordinates"]
    return tuple(Warned(STAYS.format(other)) for other in others)


def _dimension(sizes: dict[str, Size], dimension: int) -> int:
    """Return the dimension of the cells: 2 where all zones are plane blocks; MeshFileError if only some are."""
    flat = [name for name, size in sizes.items() if len(wide(size)) < len(size)]
    if not flat:
        return dimension
    if len(flat) < len(sizes):
        with _about(flat[0]):
            raise no_cells(sizes[flat[0]])
    return 2


def _plane_first(base: Base) -> tuple[str, ...]:
    """Return the coordinates in the mesh's order: a constant one comes last."""
    for last in reversed(base.axes):
        values = []
        for name in base.zones:
            with _about(name):
                stored = coordinate_data(base, name)[base.axes.index(last)].read()
            values += [stored.min(initial=np.inf), stored.max(initial=-np.inf)]
        if min(values) == max(values):
            return (*(axis for axis in base.axes if axis != last), last)
    return base.axes


def may_fit(base: Base) -> bool:
    """Whether points of the file may coincide: in blocks, and where zones have interfaces."""
    return any(len(size) > 1 for size in base.sizes.values()) or any(
        True for zone in base.zones.values() for _ in children(zone, "ZoneGridConnectivity_t")
    )


def coordinate_data(base: Base, name: str) -> list[Stored]:
    """Return the data of x, y and z of a zone; MeshFileError if one is missing, or is not a number for each point."""
    grid = child(base.zones[name], "GridCoordinates")
    expected = base.sizes[name][::-1]
    if any(integers(node).any() for _, node in children(grid, "Rind_t")):
        raise MeshFileError("its coordinates have rind planes, which would stay behind; export the mesh without them")
    arrays = [data(child(grid, axis)) for axis in base.axes]
    for axis, stored in zip(base.axes, arrays, strict=True):
        if stored.shape != expected or stored.dtype.kind != "f":
            raise MeshFileError(f"{axis} holds {stored.shape} {stored.dtype}, expected {expected} real numbers")
        if not stored.is_real:
            raise MeshFileError(f"the kind of real numbers that {axis} holds is not supported")
    return arrays


@contextmanager
def _about(name: str) -> Iterator[None]:
    try:
        yield
    except (MeshFileError, ValueError) as error:
        raise MeshFileError(f"zone {name}: {error}") from error


def _size(zone: Node, dimension: int) -> Size:
    kind = text(child(zone, "ZoneType")) if has(zone, "ZoneType") else "Structured"  # files of version 1.0 do not say
    if kind not in TYPES:
        raise MeshFileError(f"it is of type {kind!r}, expected one of {', '.join(TYPES)}")
    if kind == "Structured":
        return size_of(zone, dimension)
    sizes = integers(zone)
    if len(sizes) != 3:
        raise MeshFileError(f"its size has {len(sizes)} numbers, expected 3; the file is damaged")
    return (int(sizes[0]),)


def _without_absent(zones: Sequence[_CgnsZone]) -> list[_CgnsZone]:
    """Return the zones; patches that lack faces get another name, those of a family in all zones."""
    families = {fault.patch for zone in zones for fault in zone.faults if fault.of_family}
    kept = []
    for zone in zones:
        absent = {fault.patch for fault in zone.faults} | (families & zone.part.families)
        mesh = replace(zone.part.mesh, patches=without(zone.part.mesh.patches, absent)) if absent else zone.part.mesh
        renamed = frozenset(PART.format(name) if name in absent else name for name in zone.part.families)
        kept.append(replace(zone, part=replace(zone.part, mesh=mesh, families=renamed)))
    return kept


def _join_zones(zones: Sequence[_CgnsZone]) -> Fitted:
    """Join the zones at their interfaces, and blocks where faces without a condition are at the same places.

    Points that are images of one another become periodic pairs.
    """
    starts = np.cumsum([0, *(len(zone.part.mesh.points) for zone in zones)])
    joints = _joints(zones, starts)
    parts = [_without_touching(zone) for zone in zones]
    free = [zone.free + starts[i] for i, zone in enumerate(zones) if len(zone.free)]
    if free:
        met = meeting(np.concatenate([zone.part.mesh.points for zone in zones]), np.concatenate(free))
        joints.same.append(met)
        joints.touching.extend(np.unique(np.searchsorted(starts, met, side="right") - 1, axis=0).tolist())
    together = fit_zones(parts, joints.touching, [rows for rows in joints.same if len(rows)])
    if not (joints.listed or joints.notes):
        return together
    pairs_of_mesh = ((name, together.index[rows]) for name, rows in joints.listed)
    return replace(together, mesh=with_pairs(together.mesh, pairs_of_mesh, tuple(joints.notes)))


@dataclass(frozen=True, slots=True)
class _Joints:
    """Zones that touch, pairs of points (K, 2) that are one, periodic pairs, and what could not be read."""

    touching: list[tuple[int, int]] = field(default_factory=list)
    same: list[IntArray] = field(default_factory=list)
    listed: list[Listed] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def _joints(zones: Sequence[_CgnsZone], starts: IntArray) -> _Joints:
    """Return what the interfaces of zones say; points are counted through all zones, which begin at `starts`."""
    number = {zone.part.name: i for i, zone in enumerate(zones)}
    tree = cache(lambda j: cKDTree(zones[j].part.mesh.points))
    out = _Joints()
    for i, zone in enumerate(zones):
        out.same.append(zone.collapsed + starts[i])
        for interface in zone.interfaces:
            j = number[interface.donor]
            places = zone.part.mesh.points, zones[j].part.mesh.points
            rows = None if interface.is_periodic else pairs(*places, interface, partial(tree, j))
            if rows is not None:
                out.same.append(rows + np.array([starts[i], starts[j]]))
            if rows is not None or not (interface.matching or interface.is_periodic):
                out.touching.append((i, j))
            elif (images := periodic_pairs(*places, interface, partial(tree, j))) is not None:
                out.listed.append((interface.name, images + np.array([starts[i], starts[j]])))
            elif interface.is_periodic:
                out.notes.append(UNPAIRED.format(zone.part.name, interface.name, interface.donor))
    return out


def _without_touching(zone: _CgnsZone) -> ZoneMesh:
    """Return a zone's part; its patches lose the faces that only touch another zone."""
    nodes = [interface.nodes for interface in zone.interfaces if not (interface.matching or interface.is_periodic)]
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


def _zone(base: Base, name: str) -> _CgnsZone:
    size = base.sizes[name]
    axes = coordinate_data(base, name)
    points = np.zeros((prod(size), 3))
    for column, axis in enumerate(axes):
        points[:, column] = axis.read().reshape(len(points))
    return (_block if len(size) > 1 else _unstructured)(base, name, points)


def _block(base: Base, name: str, points: FloatArray) -> _CgnsZone:
    zone, size = base.zones[name], base.sizes[name]
    block = cells(size)
    turned = orient(points, block)
    left_handed = bool(2 * np.count_nonzero(turned.nodes[:, 1] != block.nodes[:, 1]) > len(block))
    border, rest = block_border(base.node, zone, size, left_handed)
    part = ZoneMesh(name, Mesh(points, (turned,), without([*border.patches, *rest], ())), border.families, block=True)
    free = [faces.nodes for patch in rest for faces in patch.faces]
    joints, faults = interfaces(zone, name, base.sizes, ())
    same = equal_neighbours(points, size)
    return _CgnsZone(part, joints, same, np.concatenate(free) if free else NONE, [*border.faults, *faults])


def _unstructured(base: Base, name: str, points: FloatArray) -> _CgnsZone:
    zone = base.zones[name]
    elements = sections(zone)
    if not elements:
        raise MeshFileError("it has no elements")
    polyhedral = any(section.kind in (NGON, NFACE) for section in elements)
    if polyhedral and base.dimension == 2:
        raise MeshFileError("cells by their faces (NGON_n) in two dimensions; triangles and quads can be read")
    volume, faces = _polyhedral(elements, points) if polyhedral else _cells_and_faces(elements, points, base.dimension)
    border = zone_border(base.node, zone, faces, elements[-1].last, len(points), base.dimension)
    patches = tuple(replace(patch, faces=tuple(simple(patch.faces))) for patch in border.patches)
    mesh = Mesh(points, tuple(simple(volume)), patches)
    check_faces(mesh)
    meets, faults = interfaces(zone, name, base.sizes, faces)
    return _CgnsZone(ZoneMesh(name, mesh, border.families), meets, NONE, NONE, [*border.faults, *faults])


def _cells_and_faces(
    elements: Sequence[ElementSection], points: FloatArray, dimension: int
) -> tuple[tuple[Cells, ...], list[NumberedFaces]]:
    cells, faces = [], []
    for section in elements:
        for block, numbers in blocks(section, len(points), dimension):
            if len(numbers):
                faces.append(NumberedFaces(section.name, block, numbers))
            else:
                cells.append(orient(points, block))
    return tuple(cells), faces


def _polyhedral(elements: Sequence[ElementSection], points: FloatArray) -> tuple[tuple[Polyhedra], list[NumberedFaces]]:
    if others := [section.name for section in elements if section.kind not in (NGON, NFACE)]:
        raise MeshFileError(f"cells by their faces (NGON_n) and other elements ({short_list(others)}) in one zone")
    block, numbers = read_polyhedra(elements, len(points))
    inner = len(block.neighbour)
    faces = [
        NumberedFaces(None, block.faces.rows(0, inner), numbers[:inner], outer=False),
        NumberedFaces(None, block.faces.rows(inner, len(block.faces)), numbers[inner:]),
    ]
    return (block,), faces
