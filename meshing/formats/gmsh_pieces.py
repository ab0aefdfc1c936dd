"""Binary Gmsh files of version 4.1 read in pieces, if their nodes are numbered as they stand in the file."""

import mmap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sdm_deflect.deform.base.arrays import IntArray
from sdm_deflect.deform.mesh.mesh import Zone
from sdm_deflect.deform.mesh.pieces import MeshInPieces
from sdm_deflect.meshing.formats.format import MeshFileError, about
from sdm_deflect.meshing.formats.gmsh import FACES, SOLIDS, group_names, group_patches, pairs_listed
from sdm_deflect.meshing.formats.gmsh_elements import NONE, Elements, corner_count, groups, of_entity
from sdm_deflect.meshing.formats.gmsh_file import NAME, ByteCursor, GmshFile, node_width, opened
from sdm_deflect.meshing.formats.periodic import pairs_of
from sdm_deflect.meshing.formats.shapes import MIRRORED
from sdm_deflect.meshing.formats.tables import CellTable, Joined, PointRange, Table, TablePieces

HEAD = 4096
"""Bytes in which the version stands."""
MOST = 10_000
"""Parts of nodes or elements: files of more are read as a whole."""
ROWS = 1 << 20
"""Numbers of nodes looked at at a time."""
SHORT = 64
"""Bytes after nodes or elements in which their section ends."""


@dataclass(frozen=True, slots=True)
class Part:
    """Elements of one kind, of one entity of the geometry: their nodes, numbered from 1."""

    kind: int
    dimension: int
    entity: int
    table: Table


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the nodes' numbers and places, and the elements are in a file, and its other sections."""

    tags: tuple[Table, ...]
    points: tuple[Table, ...]
    parts: tuple[Part, ...]
    file: GmshFile


def in_pieces(path: Path) -> MeshInPieces | None:
    """Return the mesh of a file; None if it must be read as a whole. MeshFileError if the file is damaged."""
    with about(path), path.open("rb") as file:
        order = _order(file.read(HEAD))
        if not order:
            return None
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            layout = _layout(path.resolve(), data, order)
            return _mesh(path.resolve(), layout) if layout else None


def _order(head: bytes) -> str:
    """Return the order of bytes of a binary file of version 4.1 by its beginning; empty for all other files."""
    end = head.find(b"$EndMeshFormat")
    found = opened(head[: end + len(b"$EndMeshFormat")]) if end >= 0 else None
    return found.order if found and found.version == 41 else ""


def _layout(path: Path, data: mmap.mmap, order: str) -> Layout | None:
    """Pass through a file's sections; None if they are not as Gmsh writes them."""
    sections: dict[str, tuple[int, int]] = {}
    tags: list[Table] = []
    points: list[Table] = []
    parts: list[Part] = []
    at = 0
    while header := NAME.match(data, at):
        name, begin, last = header[1].decode("ascii", "replace"), header.end(), len(data)
        if name in sections:
            return None
        cursor = ByteCursor(data, 0, name, order, begin)
        if name == "Nodes":
            for number, place in _nodes(path, cursor):
                tags.append(number)
                points.append(place)
        elif name == "Elements":
            parts += _elements(path, cursor)
        last = cursor.at + SHORT if cursor.at > begin else last
        end = data.find(b"$End" + header[1], cursor.at, last)
        if end < 0:
            return None
        sections[name] = begin, end
        at = end + len(name) + 4
    if "PartitionedEntities" in sections or max(len(tags), len(parts)) > MOST or data[at : at + SHORT].strip():
        return None
    return Layout(tuple(tags), tuple(points), tuple(parts), GmshFile(data, 41, order, sections))


def _nodes(path: Path, cursor: ByteCursor) -> Iterator[tuple[Table, Table]]:
    """Yield, part by part, where the nodes' numbers and their coordinates are."""
    for _ in range(int(cursor.sizes(4)[0])):
        dimension, _, parametric = cursor.ints(3).tolist()
        count = int(cursor.sizes(1)[0])
        width = node_width(dimension, parametric)
        tags = Table(path, cursor.passed(8 * count), f"{cursor.order}i8", count)
        points = Table(path, cursor.passed(8 * width * count), f"{cursor.order}f8", count, 3, 8 * width)
        if count:
            yield tags, points


def _elements(path: Path, cursor: ByteCursor) -> Iterator[Part]:
    for _ in range(int(cursor.sizes(4)[0])):
        dimension, entity, kind = cursor.ints(3).tolist()
        count = int(cursor.sizes(1)[0])
        width = 1 + corner_count(kind, count)
        begin = cursor.passed(8 * width * count)
        table = Table(path, begin + 8, f"{cursor.order}i8", count, width - 1, 8 * width)
        yield Part(kind, dimension, entity, table)


def _mesh(path: Path, layout: Layout) -> MeshInPieces | None:
    if not _in_order(layout.tags) or not any(part.kind in SOLIDS for part in layout.parts):
        return None
    ends = np.cumsum([0, *(table.rows for table in layout.points)]).tolist()
    points = tuple(
        PointRange(start, stop, (table,)) for start, stop, table in zip(ends[:-1], ends[1:], layout.points, strict=True)
    )
    kinds = dict.fromkeys(part.kind for part in layout.parts)
    cells = tuple(
        CellTable(
            SOLIDS[kind],
            Joined(tuple(part.table for part in layout.parts if part.kind == kind)),
            order=MIRRORED["wedge"] if SOLIDS[kind] == "wedge" else (),
        )
        for kind in kinds
        if kind in SOLIDS
    )
    own = {kind: _faces(layout, kind, ends[-1]) for kind in kinds if kind in FACES}
    border = group_patches(own, group_names(layout.file, 2), FACES)
    pieces = TablePieces(str(path), ends[-1], points, cells).oriented()
    listed, notes = pairs_listed(layout.file, 2, lambda rows, what: _numbers(rows, ends[-1], what))
    found = pairs_of(border, listed, pieces.places)
    return MeshInPieces(
        path.name, pieces, found.patches, (Zone("", 0, ends[-1]),), (*notes, *found.notes), periodic=found.periodic
    )


def _in_order(tags: tuple[Table, ...]) -> bool:
    """Whether nodes are numbered from 1 on, as they stand in the file."""
    first = 1
    for table in tags:
        for start in range(0, table.rows, ROWS):
            found = table.read(start, min(start + ROWS, table.rows)).ravel()
            if not np.array_equal(found, np.arange(first, first + len(found))):
                return False
            first += len(found)
    return True


def _faces(layout: Layout, kind: int, points: int) -> tuple[IntArray, list[Elements]]:
    """Return the faces of a kind, once for each of their groups: their nodes (M, k) from 0, and what they are of."""
    known, found = groups(layout.file), []
    for part in (part for part in layout.parts if part.kind == kind):
        own = Elements(kind, part.table.integers(), NONE, np.full(part.table.rows, part.entity))
        several = known.get((part.dimension, part.entity), [])
        found += list(of_entity(layout.file, own, several if part.dimension == 2 else several[:1]))
    return _numbers(np.concatenate([one.nodes for one in found]), points, "elements"), found


def _numbers(tags: IntArray, points: int, what: str) -> IntArray:
    """Return nodes (M, k), numbered from 1, counted from 0; MeshFileError if one is not among the points."""
    if missing := np.count_nonzero(((tags < 1) | (tags > points)).any(axis=1)):
        raise MeshFileError(f"{missing} {what} name nodes that are not among the {points}")
    return tags - 1
