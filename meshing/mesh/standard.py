"""Polyhedra that are tetrahedra, pyramids, wedges or hexahedra: types, and nodes in VTK's order."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import IntArray
from sdm_deflect.base.compiled import compiled_exactly
from sdm_deflect.base.threads import in_chunks

from .cells import CORNERS, VOLUMES, Cells, Polyhedra, Volume

POLYHEDRON = "polyhedron"
# Work on one cell in kernel pairs, by which `in_chunks` divides it.
WEIGHT = 300
# Types as indices in `VOLUMES`; -1 for any other cell.
TETRA, WEDGE, HEXAHEDRON = 0, 2, 3
# Type, block, rows (M,) in it, and their places among the rows asked for.
Part = tuple[str, Volume, IntArray, IntArray | slice]


class CellTypes(NamedTuple):
    """The types of polyhedra.

    Attributes
    ----------
    shape : (C,) type of each cell, an index in `VOLUMES` or -1.
    corners : (C, 8) nodes of each cell in VTK's order, in as many columns as its type has nodes.
    """

    shape: NDArray[np.int8]
    corners: IntArray


def types_of(block: Polyhedra) -> CellTypes:
    """Return the types of cells by their faces; computed once and stored with the block."""
    if "types" not in block.kept:
        shape, corners = np.empty(len(block), dtype=np.int8), np.empty((len(block), 8), dtype=np.intp)
        start, side = np.zeros(len(block) + 1, np.intp), np.empty(len(block.owner) + len(block.neighbour), np.intp)
        nodes, offsets = block.faces.nodes, block.faces.offsets
        _sort_sides(block.owner, block.neighbour, start, side)

        def find(low: int, high: int) -> None:
            _find_types(nodes, offsets, start[low : high + 1], side, shape[low:high], corners[low:high])

        in_chunks(find, len(block), WEIGHT)
        block.kept["types"] = CellTypes(shape, corners)
    types: CellTypes = block.kept["types"]
    return types


def parts_of(block: Volume, rows: IntArray | None = None) -> Iterator[Part]:
    """Yield the cells of each type in a block, or in R rows of it, and their places among these rows.

    Polyhedra of a standard type come as one block per type; all others come last.
    """
    some = np.arange(len(block)) if rows is None else rows
    if isinstance(block, Cells):
        if len(some):
            yield block.shape, block, some, slice(None)
        return
    types = types_of(block)
    kinds = types.shape[some]
    for number, name in (*enumerate(VOLUMES), (-1, POLYHEDRON)):
        at = np.flatnonzero(kinds == number)
        if len(at):
            yield name, Cells(name, types.corners[:, : CORNERS[name]]) if number >= 0 else block, some[at], at


def type_of(block: Volume, row: int) -> str:
    """Return the type of the cell of a row."""
    return next(parts_of(block, np.array([row])))[0]


@compiled_exactly
def _sort_sides(
    owner: IntArray, neighbour: IntArray, start: IntArray, side: IntArray
) -> None:  # pragma: no cover - machine code
    """Fill in the sides (S,) of cells, as twice the face plus 1 if reversed, and their begin (C + 1,) for each cell."""
    for i in range(len(owner)):
        start[owner[i] + 1] += 1
    for i in range(len(neighbour)):
        start[neighbour[i] + 1] += 1
    for cell in range(len(start) - 1):
        start[cell + 1] += start[cell]
    place = start.copy()
    for i in range(len(owner)):
        side[place[owner[i]]] = 2 * i
        place[owner[i]] += 1
    for i in range(len(neighbour)):
        side[place[neighbour[i]]] = 2 * i + 1
        place[neighbour[i]] += 1


@compiled_exactly
def _find_types(
    nodes: IntArray, offsets: IntArray, start: IntArray, side: IntArray, shape: NDArray[np.int8], corners: IntArray
) -> None:  # pragma: no cover - machine code
    """Fill in the types (C,) of cells and their corners (C, 8)."""
    for cell in range(len(shape)):
        sides, cell_nodes = side[start[cell] : start[cell + 1]], corners[cell]
        kind = _kind(offsets, sides)
        if kind >= 0:
            size, ends = 3 if kind in (TETRA, WEDGE) else 4, kind >= WEDGE
            _fill_base(nodes, offsets, sides, size, cell_nodes)
            single = _fill_opposite(nodes, offsets, sides, size, ends, cell_nodes)
            if kind != WEDGE:  # VTK's wedge has its first face outwards, the others inwards
                _turn(cell_nodes, size, ends)
            if not single or not _is_whole(nodes, offsets, sides, 2 * size if ends else size + 1, cell_nodes):
                kind = -1
        shape[cell] = kind


@compiled_exactly
def _kind(offsets: IntArray, sides: IntArray) -> int:  # pragma: no cover - machine code
    """Return the type that a cell may have, by its numbers of triangles and quadrilaterals."""
    triangles, quads = 0, 0
    for s in range(len(sides)):
        triangles += _size(offsets, sides[s]) == 3
        quads += _size(offsets, sides[s]) == 4
    if triangles + quads < len(sides):
        return -1
    if triangles == 4 and quads < 2:
        return TETRA + quads  # a pyramid has one quadrilateral
    if triangles == 2 and quads == 3:
        return WEDGE
    return HEXAHEDRON if triangles == 0 and quads == 6 else -1


@compiled_exactly
def _fill_base(
    nodes: IntArray, offsets: IntArray, sides: IntArray, size: int, corners: IntArray
) -> None:  # pragma: no cover - machine code
    """Fill in the nodes of the first side with `size` corners."""
    base = 0
    while _size(offsets, sides[base]) != size:
        base += 1
    for k in range(size):
        corners[k], corners[size + k] = _corner(nodes, offsets, sides[base], k), -1


@compiled_exactly
def _fill_opposite(
    nodes: IntArray, offsets: IntArray, sides: IntArray, size: int, ends: bool, corners: IntArray
) -> bool:  # pragma: no cover - machine code
    """Fill in the nodes opposite the base, by edges from it if `ends`; return whether each is unique."""
    single = True
    for s in range(len(sides)):
        count = _size(offsets, sides[s])
        last = _corner(nodes, offsets, sides[s], count - 1)
        before = _place(corners, size, last)
        for j in range(count):
            node = _corner(nodes, offsets, sides[s], j)
            place = _place(corners, size, node)
            if (before < 0) != (place < 0):
                end, other = size + (max(before, place) if ends else 0), node if place < 0 else last
                single = single and (corners[end] < 0 or corners[end] == other)
                corners[end] = other
            before, last = place, node
    return single


@compiled_exactly
def _turn(corners: IntArray, size: int, ends: bool) -> None:  # pragma: no cover - machine code
    """Reverse the order of corners around the base and around the opposite face."""
    for k in range(1, (size + 1) // 2):
        corners[k], corners[size - k] = corners[size - k], corners[k]
        if ends:
            corners[size + k], corners[2 * size - k] = corners[2 * size - k], corners[size + k]


@compiled_exactly
def _is_whole(
    nodes: IntArray, offsets: IntArray, sides: IntArray, total: int, corners: IntArray
) -> bool:  # pragma: no cover - machine code
    """Return whether a cell's corners are distinct, with three sides at each, and four at the tip of a pyramid."""
    for k in range(total):
        if corners[k] < 0 or _place(corners, k, corners[k]) >= 0:
            return False
    counts, expected = 0, 0
    for k in range(total):
        expected += (4 if total == 5 and k == 4 else 3) << 4 * k
    for s in range(len(sides)):
        for j in range(_size(offsets, sides[s])):
            place = _place(corners, total, _corner(nodes, offsets, sides[s], j))
            if place < 0:
                return False
            counts += 1 << 4 * place
    return counts == expected


@compiled_exactly
def _size(offsets: IntArray, side: int) -> int:  # pragma: no cover - machine code
    return int(offsets[(side >> 1) + 1] - offsets[side >> 1])


@compiled_exactly
def _corner(nodes: IntArray, offsets: IntArray, side: int, k: int) -> int:  # pragma: no cover - machine code
    """Return a corner of a side, in the order that gives an outward normal."""
    face = side >> 1
    return int(nodes[offsets[face + 1] - 1 - k] if side & 1 else nodes[offsets[face] + k])


@compiled_exactly
def _place(corners: IntArray, count: int, node: int) -> int:  # pragma: no cover - machine code
    """Return the place of a node among the first `count`, or -1."""
    for k in range(count):
        if corners[k] == node:
            return k
    return -1
