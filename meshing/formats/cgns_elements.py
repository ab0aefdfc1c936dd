"""Element sections of a CGNS zone: one shape each, or mixed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sdm_deflect.deform.mesh import CORNERS, VOLUMES, Cells
from sdm_deflect.meshing.formats.cgns_nodes import child, children, data, integers
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.orientation import mirrored
from sdm_deflect.meshing.mesh import IntArray

SHAPES = {5: "triangle", 7: "quad", 10: "tetra", 12: "pyramid", 14: "wedge", 17: "hexahedron"}
IGNORED = {2: 1, 3: 2}
"""Number of nodes of points and edges, which are no cells and no faces."""
MIXED, NGON, NFACE = 20, 22, 23
SIZES = {number: CORNERS[shape] for number, shape in SHAPES.items()} | IGNORED


@dataclass(frozen=True, slots=True)
class Section:
    """Elements of one kind (SIDS' number), numbered first to last."""

    name: str
    kind: int
    first: int
    last: int
    node: Any = field(repr=False)

    def __len__(self) -> int:
        return self.last - self.first + 1


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Elements of one shape in a section, and the numbers (M,) of boundary faces (of cells: none)."""

    section: str
    elements: Cells
    numbers: IntArray = field(repr=False)


def sections(zone: Any) -> list[Section]:
    """Return the sections of a zone by their elements' numbers.

    Raises
    ------
    MeshFileError
        If a section is damaged, or of a kind that has no linear cells.
    """
    found = []
    for name, node in children(zone, "Elements_t"):
        kind, bounds = int(data(node)[0]), integers(child(node, "ElementRange"))
        if kind not in (*SIZES, MIXED, NGON, NFACE):
            raise MeshFileError(
                f"section {name} holds elements of SIDS type {kind}; only linear elements, MIXED, NGON_n and NFACE_n "
                "can be read"
            )
        if len(bounds) != 2 or bounds[1] < bounds[0]:
            raise MeshFileError(f"section {name} has the range {bounds.tolist()}; the file is damaged")
        found.append(Section(name, kind, int(bounds[0]), int(bounds[1]), node))
    return sorted(found, key=lambda section: section.first)


def blocks(section: Section, points: int) -> Iterator[Block]:
    """Yield the elements of a section by shape, in the order in which the shapes first appear.

    Raises
    ------
    MeshFileError
        If the section is damaged, or names points beyond the `points` of the zone.
    """
    if section.kind == MIXED:
        yield from _mixed(section, points)
    elif section.kind in SHAPES:
        nodes = connectivity(section)
        size = SIZES[section.kind]
        if len(nodes) != size * len(section):
            raise MeshFileError(
                f"section {section.name} has {len(section)} elements of {size} nodes, but {len(nodes)} nodes; the file "
                "is damaged"
            )
        yield _block(section, section.kind, nodes.reshape(-1, size), slice(None), points)


def connectivity(section: Section) -> IntArray:
    """Return the nodes (K,) of a section as stored, counted from 1."""
    return integers(child(section.node, "ElementConnectivity"))


def starts(section: Section, stored: IntArray, sizes: dict[int, int] | None) -> IntArray:
    """Return where each element begins in the stored connectivity, and where the last one ends: (M + 1,).

    Files of CGNS before 3.4 hold no offsets: there each element is headed by its kind, of `sizes` nodes, or by its
    own size where `sizes` is None.

    Raises
    ------
    MeshFileError
        If offsets do not fit the connectivity.
    """
    if "ElementStartOffset" in section.node:
        offsets = integers(child(section.node, "ElementStartOffset"))
    else:
        offsets = np.fromiter(_walk(stored, sizes), dtype=np.intp)
    if len(offsets) != len(section) + 1 or offsets[-1] != len(stored) or np.any(np.diff(offsets) < 1):
        raise MeshFileError(f"section {section.name}: its elements do not fit its connectivity; the file is damaged")
    return offsets


def _walk(connectivity: IntArray, sizes: dict[int, int] | None) -> Iterator[int]:
    at, stored = 0, connectivity.data  # numbers of a memoryview are read faster than those of an array
    while at < len(stored):
        yield at
        at += 1 + (stored[at] if sizes is None else sizes.get(stored[at], len(stored)))
    yield at


def _mixed(section: Section, points: int) -> Iterator[Block]:
    stored = connectivity(section)
    begin = starts(section, stored, SIZES)[:-1]
    kinds = stored[begin]
    distinct, first = np.unique(kinds, return_index=True)
    for kind in distinct[np.argsort(first)].tolist():
        if kind not in SIZES:
            raise MeshFileError(
                f"section {section.name} holds elements of SIDS type {kind}; only linear ones can be read"
            )
        if kind in SHAPES:
            rows = np.flatnonzero(kinds == kind)
            nodes = stored[begin[rows, None] + np.arange(1, SIZES[kind] + 1)]
            yield _block(section, kind, nodes, rows, points)


def _block(section: Section, kind: int, nodes: IntArray, rows: IntArray | slice, points: int) -> Block:
    """Elements with their nodes counted from 0 in VTK's order; `nodes` is overwritten."""
    bad = int(np.count_nonzero(((nodes < 1) | (nodes > points)).any(axis=1)))
    if bad:
        raise MeshFileError(
            f"section {section.name}: {bad} {SHAPES[kind]} elements name points that are not among the {points}"
        )
    nodes -= 1
    shape = SHAPES[kind]
    if shape in VOLUMES:
        turned = mirrored(shape, nodes) if shape == "wedge" else nodes
        return Block(section.name, Cells(shape, turned), np.empty(0, dtype=np.intp))
    return Block(section.name, Cells(shape, nodes), np.arange(section.first, section.last + 1)[rows])
