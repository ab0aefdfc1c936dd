"""Element sections of a CGNS zone: of one shape, mixed, or of polyhedra given by their faces."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import BoolArray, IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.mesh.cells import CORNERS, PLANE, VOLUMES, Cells, Polygons, Polyhedra, take_faces

from .cgns_nodes import child, children, has, integers
from .shapes import mirror_nodes, places, polygons, turn_faces

SHAPES = {3: "line", 5: "triangle", 7: "quad", 10: "tetra", 12: "pyramid", 14: "wedge", 17: "hexahedron"}
# Kinds of elements that are neither cells nor faces.
POINT = 2
# Cells and faces by the dimension of cells.
KINDS = {3: (VOLUMES, ("triangle", "quad")), 2: (PLANE, ("line",))}
# SIDS' numbers of sections with several shapes, of polygons, and of polyhedra.
MIXED, NGON, NFACE = 20, 22, 23
SIZES = {number: CORNERS[shape] for number, shape in SHAPES.items()} | {POINT: 1}
# Owner (F,), neighbour (F,) or -1, and whether the face's normal points into its owner.
Sides = tuple[IntArray, IntArray, BoolArray]


@dataclass(frozen=True, slots=True)
class ElementSection:
    """Elements of one kind (SIDS' number), numbered first to last."""

    name: str
    kind: int
    first: int
    last: int
    node: Any = field(repr=False)

    def __len__(self) -> int:
        return self.last - self.first + 1


def sections(zone: Any) -> list[ElementSection]:
    """Return the sections of a zone in the order of their elements' numbers; MeshFileError if damaged or not linear."""
    elements = []
    for name, node in children(zone, "Elements_t"):
        head, bounds = integers(node).tolist(), integers(child(node, "ElementRange")).tolist()
        kind = head[0] if head else None
        if kind not in (*SIZES, MIXED, NGON, NFACE):
            raise MeshFileError(
                f"section {name} holds elements of SIDS type {kind}; only linear elements, MIXED, NGON_n and NFACE_n "
                "can be read"
            )
        if len(bounds) != 2 or not 1 <= bounds[0] <= bounds[1]:
            raise MeshFileError(f"section {name} has the range {bounds}; the file is damaged")
        elements.append(ElementSection(name, kind, bounds[0], bounds[1], node))
    elements.sort(key=lambda section: section.first)
    for first, second in pairwise(elements):
        if second.first <= first.last:
            raise MeshFileError(f"elements of the sections {first.name} and {second.name} have the same numbers")
    return elements


def blocks(section: ElementSection, points: int, dimension: int) -> Iterator[tuple[Cells, IntArray]]:
    """Yield the elements of a section shape by shape, with the numbers (M,) of faces; cells have no numbers.

    Elements of fewer dimensions than the faces of cells of that `dimension` are left out. MeshFileError if the section
    is damaged, names points beyond the `points` of the zone, or holds cells of more dimensions.
    """
    cells, faces = KINDS[dimension]
    for block, numbers in _elements(section, points):
        if block.shape in cells:
            yield block, numbers[:0]
        elif block.shape in faces:
            yield block, numbers
        elif block.shape in VOLUMES:
            raise MeshFileError(f"section {section.name} holds {block.shape} cells in a base of two dimensions")


def _elements(section: ElementSection, points: int) -> Iterator[tuple[Cells, IntArray]]:
    if section.kind == MIXED:
        yield from _mixed_elements(section, points)
    elif section.kind in SHAPES:
        nodes = connectivity(section)
        size = SIZES[section.kind]
        if len(nodes) != size * len(section):
            raise MeshFileError(
                f"section {section.name} has {len(section)} elements of {size} nodes, but {len(nodes)} nodes; the file "
                "is damaged"
            )
        yield _block(section, section.kind, nodes.reshape(-1, size), slice(None), points)


def connectivity(section: ElementSection) -> IntArray:
    """Return the nodes (K,) of a section as stored, counted from 1."""
    return integers(child(section.node, "ElementConnectivity"))


def starts(section: ElementSection, stored: IntArray, sizes: dict[int, int] | None) -> IntArray:
    """Return where each element begins in the stored connectivity, and where the last one ends: (M + 1,).

    CGNS before 3.4 stores no offsets: there each element begins with its kind, of `sizes` nodes, or with its own size
    if `sizes` is None. MeshFileError if offsets do not fit the connectivity.
    """
    if has(section.node, "ElementStartOffset"):
        offsets = integers(child(section.node, "ElementStartOffset"))
    else:
        offsets = np.fromiter(_walk(stored, sizes), dtype=np.intp)
    whole = len(offsets) == len(section) + 1 and offsets[0] == 0 and offsets[-1] == len(stored)
    if not whole or np.any(np.diff(offsets) < 1):
        raise MeshFileError(f"section {section.name}: its elements do not fit its connectivity; the file is damaged")
    return offsets


def _walk(connectivity: IntArray, sizes: dict[int, int] | None) -> Iterator[int]:
    at, stored = 0, connectivity.data  # numbers of a memoryview are read faster than those of an array
    while at < len(stored):
        yield at
        at += 1 + max(stored[at] if sizes is None else sizes.get(stored[at], len(stored)), 0)
    yield at


def _mixed_elements(section: ElementSection, points: int) -> Iterator[tuple[Cells, IntArray]]:
    stored = connectivity(section)
    offsets = starts(section, stored, SIZES)
    begin = offsets[:-1]
    kinds = stored[begin]
    distinct, first = np.unique(kinds, return_index=True)
    for kind in distinct[np.argsort(first)].tolist():
        if kind not in SIZES:
            fault = f"section {section.name} holds elements of SIDS type {kind}"
            raise MeshFileError(f"{fault}; only linear ones can be read")
        rows = np.flatnonzero(kinds == kind)
        if np.any(offsets[rows + 1] - begin[rows] != 1 + SIZES[kind]):
            raise MeshFileError(f"section {section.name}: its offsets do not fit its elements; the file is damaged")
        if kind in SHAPES:
            nodes = stored[begin[rows, None] + np.arange(1, SIZES[kind] + 1)]
            yield _block(section, kind, nodes, rows, points)


def _block(
    section: ElementSection, kind: int, nodes: IntArray, rows: IntArray | slice, points: int
) -> tuple[Cells, IntArray]:
    """Return elements with nodes counted from 0 in VTK's order; `nodes` is overwritten."""
    if bad := np.count_nonzero(((nodes < 1) | (nodes > points)).any(axis=1)):
        raise MeshFileError(
            f"section {section.name}: {bad} {SHAPES[kind]} elements name points that are not among the {points}"
        )
    nodes -= 1
    shape = SHAPES[kind]
    block = Cells(shape, mirror_nodes(shape, nodes) if shape == "wedge" else nodes)
    return block, np.arange(section.first, section.last + 1)[rows]


def read_polyhedra(elements: Sequence[ElementSection], points: int) -> tuple[Polyhedra, IntArray]:
    """Return the polyhedra of a zone, and the number in the file (F,) of each of their faces.

    MeshFileError if the sections are damaged or do not fit one another.
    """
    surfaces = [section for section in elements if section.kind == NGON]
    if not surfaces:
        raise MeshFileError("there are cells by their faces (NFACE_n), but no faces (NGON_n)")
    faces = _faces(surfaces, points)
    numbers = np.concatenate([np.arange(section.first, section.last + 1) for section in surfaces])
    cells = [section for section in elements if section.kind == NFACE]
    owner, neighbour, inward = _sides_by_cell(cells, numbers) if cells else _sides_by_face(surfaces)
    if len(owner) and max(owner.max(), neighbour.max()) >= 2 * len(owner):
        raise MeshFileError("there are more cells than sides of faces; the file is damaged")
    if unused := np.count_nonzero(owner < 0):
        raise MeshFileError(f"{unused} of {len(owner)} faces are of no cell")
    inner, outer = np.flatnonzero(neighbour >= 0), np.flatnonzero(neighbour < 0)
    order = np.concatenate([inner, outer])
    return Polyhedra(take_faces(turn_faces(faces, inward), order), owner[order], neighbour[inner]), numbers[order]


def _faces(surfaces: Sequence[ElementSection], points: int) -> Polygons:
    nodes, sizes = [], []
    for section in surfaces:
        stored, offsets = _split(section)
        bad = int(np.count_nonzero((stored < 1) | (stored > points)))
        if bad or np.any(np.diff(offsets) < 3):
            raise MeshFileError(
                f"section {section.name}: faces of fewer than 3 corners, or of points that are not there"
            )
        nodes.append(stored - 1)
        sizes.append(np.diff(offsets))
    return polygons(np.concatenate(nodes), np.concatenate(sizes))


def _split(section: ElementSection) -> tuple[IntArray, IntArray]:
    """Return the connectivity without the sizes that old files store before each element, and offsets (M + 1,)."""
    stored = connectivity(section)
    offsets = starts(section, stored, None)
    if has(section.node, "ElementStartOffset"):
        return stored, offsets
    return np.delete(stored, offsets[:-1]), offsets - np.arange(len(offsets))


def _sides_by_cell(cells: Sequence[ElementSection], numbers: IntArray) -> Sides:
    faces, owners, first = [], [], 0
    for section in cells:
        stored, offsets = _split(section)
        faces.append(stored)
        owners.append(np.repeat(np.arange(first, first + len(section)), np.diff(offsets)))
        first += len(section)
    signed, cell = np.concatenate(faces), np.concatenate(owners)
    row, there = places(np.abs(signed), numbers)
    if bad := np.count_nonzero(~there):
        raise MeshFileError(f"{bad} faces of cells are not in the file; the file is damaged")
    return _sides_of(row, cell, signed < 0, len(numbers))


def _sides_of(row: IntArray, cell: IntArray, inward: BoolArray, faces: int) -> Sides:
    """Return the owner and neighbour of each face from (face, cell) pairs; the normal points out of the owner."""
    order = np.lexsort((inward, row))
    row, cell, inward = row[order], cell[order], inward[order]
    count = np.bincount(row, minlength=faces)
    if more := np.count_nonzero(count > 2):
        raise MeshFileError(f"{more} faces are of more than two cells")
    first = np.cumsum(count) - count
    owner, neighbour, backward = np.full(faces, -1), np.full(faces, -1), np.zeros(faces, dtype=np.bool_)
    used, both = count > 0, count == 2
    owner[used], backward[used] = cell[first[used]], inward[first[used]]
    neighbour[both] = cell[first[both] + 1]
    return owner, neighbour, backward


def _sides_by_face(surfaces: Sequence[ElementSection]) -> Sides:
    """Read the two cells of each face; its normal points from the first to the second."""
    stored = [integers(child(section.node, "ParentElements")) for section in surfaces]
    fit = all(len(values) == 2 * len(section) for section, values in zip(surfaces, stored, strict=True))
    parents = (
        np.concatenate([values.reshape(2, -1) for values in stored], axis=1) if fit else np.empty((2, 0), dtype=np.intp)
    )
    if not np.any(parents > 0):
        raise MeshFileError("ParentElements do not fit the faces (NGON_n), and there is no NFACE_n")
    cells = np.where(parents > 0, parents - parents[parents > 0].min(), -1)
    backward = cells[0] < 0
    return np.where(backward, cells[1], cells[0]), np.where(backward, -1, cells[1]), backward
