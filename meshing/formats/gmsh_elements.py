"""Elements of Gmsh's files, versions 2.2 and 4.1."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.base.arrays import IntArray
from sdm_deflect.deform.base.reading import check_unpacked
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.gmsh_file import ByteCursor, Cursor, GmshFile, TextCursor
from sdm_deflect.meshing.formats.numbers import NumberLines
from sdm_deflect.meshing.formats.tables import FileTable, Held

CORNERS = {15: 1, 1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5}
"""Number of nodes of each type of element: point, line, triangle, quad, tetrahedron, hexahedron, prism, pyramid."""


@dataclass(frozen=True, slots=True, eq=False)
class ElementBlock:
    """Elements of one type (a key of `CORNERS`): numbers (M, k) of nodes, physical group (M,) or 0, and entity (M,).

    Group and entity are one number (1,) where they are the same for all.
    """

    kind: int
    nodes: FileTable | Held = field(repr=False)
    group: IntArray = field(repr=False)
    entity: IntArray = field(repr=False)

    def each(self, what: str) -> IntArray:
        """Return the ``"group"`` or the ``"entity"`` (M,) of each."""
        return np.broadcast_to(getattr(self, what), self.nodes.rows)


def elements(file: GmshFile, boundary: int = 2) -> Iterator[ElementBlock]:
    """Yield the elements in the file's order; boundary elements of an entity in several groups once for each group.

    Parameters
    ----------
    boundary : Dimension of the boundary: 1 around a plane mesh.

    MeshFileError for a type that is not linear, and truncated sections.
    """
    cursor = file.cursor("Elements")
    if file.version == 41:
        yield from _elements41(file, cursor, boundary)
    elif isinstance(cursor, TextCursor):
        yield from _lines22(cursor.words)
    else:
        yield from _records22(cursor)


def corner_count(kind: int, count: int) -> int:
    """Return the number of nodes of a type of element; MeshFileError, for `count` elements, if it is not linear."""
    if kind not in CORNERS:
        raise MeshFileError(
            f"{count} elements of type {kind} are not linear or not known; write a linear mesh: gmsh -order 1"
        )
    return CORNERS[kind]


def _elements41(file: GmshFile, cursor: Cursor, boundary: int) -> Iterator[ElementBlock]:
    known = _groups(file)
    for _ in range(int(cursor.sizes(4)[0])):
        dimension, entity, kind = cursor.ints(3).tolist()
        count = int(cursor.sizes(1)[0])
        nodes = cursor.columns(count, 1 + corner_count(kind, count), "i8", slice(1, None))
        several = known.get((dimension, entity), [])[: None if dimension == boundary else 1]
        size = 8 * nodes.rows * nodes.width * len(several)
        check_unpacked(size, len(file.data), f"{count} elements in {len(several)} groups")
        for group in several or [0]:
            yield ElementBlock(kind, nodes, np.array([abs(group)]), np.array([entity]))


def _groups(file: GmshFile) -> dict[tuple[int, int], list[int]]:
    """Return the physical groups of each entity, by its dimension and number, of a file of version 4.1."""
    found: dict[tuple[int, int], list[int]] = {}
    if "Entities" not in file.sections:
        return found
    cursor = file.cursor("Entities")
    for dimension, count in enumerate(cursor.sizes(4).tolist()):
        for _ in range(count):
            tag = int(cursor.ints(1)[0])
            cursor.reals(6 if dimension else 3)
            found[dimension, tag] = cursor.ints(int(cursor.sizes(1)[0])).tolist()
            if dimension:
                cursor.ints(int(cursor.sizes(1)[0]))
    return found


def _lines22(words: NumberLines) -> Iterator[ElementBlock]:
    """Lines of number, type, number of tags, tags and nodes."""
    values = np.asarray(words.values, dtype=np.float64)
    count, first = int(values[0]) if len(values) else -1, words.first[1:]
    if len(first) - 1 != count:
        raise MeshFileError(f"$Elements announces {count} elements, but {len(first) - 1} follow")
    sizes, first = np.diff(first), first[:-1]
    if np.any(sizes < 4):
        raise MeshFileError(f"{np.count_nonzero(sizes < 4)} lines of $Elements are too short")
    with np.errstate(invalid="ignore"):
        values = values.astype(np.intp)
    kinds, tags = (values[first + column] for column in (1, 2))
    order = np.unique(kinds, return_index=True)
    for kind in order[0][np.argsort(order[1])].tolist():
        rows = np.flatnonzero(kinds == kind)
        corners = corner_count(kind, len(rows))
        if wrong := np.count_nonzero(sizes[rows] != 3 + tags[rows] + corners):
            raise MeshFileError(f"{wrong} elements of type {kind} have other than {corners} nodes")
        at = first[rows]
        own = values[(at + 3 + tags[rows])[:, None] + np.arange(corners)]
        group, entity = (np.where(tags[rows] > i, values[at + 3 + i], 0) for i in (0, 1))
        yield ElementBlock(kind, Held(own), np.abs(group), entity)


def _records22(cursor: ByteCursor) -> Iterator[ElementBlock]:
    """Blocks of a header (type, count, number of tags) and records of number, tags and nodes."""
    left = cursor.line()
    while left > 0:
        kind, count, tags = cursor.ints(3).tolist()
        if tags < 0:
            raise MeshFileError(f"$Elements has records of {tags} tags; the file is damaged")
        width = 1 + tags + corner_count(kind, count)
        table = _alike(cursor, width) if count == 1 else cursor.ints(count * width).reshape(count, width)
        group, entity = (table[:, 1 + i] if tags > i else np.zeros(len(table), dtype=np.intp) for i in (0, 1))
        yield ElementBlock(kind, Held(table[:, 1 + tags :]), np.abs(group), entity)
        left -= len(table)


def _alike(cursor: ByteCursor, width: int) -> IntArray:
    """Records (M, width) that follow one another, each with the header that was just read: Gmsh writes many such."""
    cursor.at -= 12
    row = 3 + width
    table = cursor.peek((cursor.end - cursor.at) // (4 * row) * row).reshape(-1, row)
    if not len(table):
        return cursor.ints(row)[None, 3:]  # says that the section has ended
    other = (table[:, :3] != table[0, :3]).any(axis=1)
    count = int(np.argmax(other)) if other.any() else len(table)
    return cursor.ints(count * row).reshape(count, row)[:, 3:]
