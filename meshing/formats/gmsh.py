"""Gmsh meshes (.msh), versions 2.2 and 4.1, text and binary: elements, physical groups, periodic pairs."""

import re
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.files import fresh
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.base.unpacking import check_unpacked
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.mesh.cells import MIRRORED, Cells, Patch, Periodic, Zone
from sdm_deflect.meshing.mesh.labelled import VOLUME
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.pieces import MeshOnDisk
from sdm_deflect.meshing.mesh.precision import DOUBLE

from .coordinates import ByteColumns, Words
from .format import Format, fitting_names
from .gmsh_file import ByteCursor, Cursor, GmshFile, Nodes, TextCursor, gmsh_file, nodes, periodic
from .numbers import NumberLines, Placed
from .polyhedra import standard_cells
from .shapes import mirror_nodes, simple_faces
from .table_pieces import CellTable, PointRange, TablePieces
from .tables import FileTable, Joined, MemoryTable
from .zones import Listed, pairs_of, pairs_to_write, unwritten

# Number of nodes of each type of element: point, line, triangle, quad, tetrahedron, hexahedron, prism, pyramid.
CORNERS = {15: 1, 1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5}
# Largest number of blocks of elements; files with more are read as a whole.
MOST = 10_000
SOLIDS = {4: "tetra", 5: "hexahedron", 6: "wedge", 7: "pyramid"}
FACES = {2: "triangle", 3: "quad"}
# Cells and boundary faces, by the mesh's dimension.
KINDS = {3: (SOLIDS, FACES), 2: (FACES, {1: "line"})}
PHYSICAL = re.compile(rb'^[ \t]*(\d+)\s+(\d+)\s+"(.*)"\s*$', re.MULTILINE)


@dataclass(frozen=True, slots=True, eq=False)
class ElementBlock:
    """Elements of one type (a key of `CORNERS`): numbers (M, k) of nodes, physical group (M,) or 0, and entity (M,).

    If all elements have one group or one entity, that array is (1,).
    """

    kind: int
    nodes: FileTable | MemoryTable = field(repr=False)
    group: IntArray = field(repr=False)
    entity: IntArray = field(repr=False)

    def each(self, what: str) -> IntArray:
        """Return the ``"group"`` or the ``"entity"`` (M,) of each."""
        return np.broadcast_to(getattr(self, what), self.nodes.rows)


def elements(file: GmshFile, boundary: int = 2) -> Iterator[ElementBlock]:
    """Yield the elements in the file's order; boundary elements in several groups occur once for each group.

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
    """Return the number of nodes of a type of element; MeshFileError for one that is not linear."""
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
    """Return the physical groups of each entity in a file of version 4.1, by its dimension and number."""
    groups: dict[tuple[int, int], list[int]] = {}
    if "Entities" not in file.sections:
        return groups
    cursor = file.cursor("Entities")
    for dimension, count in enumerate(cursor.sizes(4).tolist()):
        for _ in range(count):
            tag = int(cursor.ints(1)[0])
            cursor.reals(6 if dimension else 3)
            groups[dimension, tag] = cursor.ints(int(cursor.sizes(1)[0])).tolist()
            if dimension:
                cursor.ints(int(cursor.sizes(1)[0]))
    return groups


def _lines22(words: NumberLines) -> Iterator[ElementBlock]:
    """Yield elements from lines of number, type, number of tags, tags and nodes."""
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
        nodes = values[(at + 3 + tags[rows])[:, None] + np.arange(corners)]
        group, entity = (np.where(tags[rows] > i, values[at + 3 + i], 0) for i in (0, 1))
        yield ElementBlock(kind, MemoryTable(nodes), np.abs(group), entity)


def _records22(cursor: ByteCursor) -> Iterator[ElementBlock]:
    """Yield elements from blocks: a header (type, count, number of tags), then records of number, tags and nodes."""
    left = cursor.line()
    while left > 0:
        kind, count, tags = cursor.ints(3).tolist()
        if tags < 0:
            raise MeshFileError(f"$Elements has records of {tags} tags; the file is damaged")
        width = 1 + tags + corner_count(kind, count)
        table = _alike(cursor, width) if count == 1 else cursor.ints(count * width).reshape(count, width)
        group, entity = (table[:, 1 + i] if tags > i else np.zeros(len(table), dtype=np.intp) for i in (0, 1))
        yield ElementBlock(kind, MemoryTable(table[:, 1 + tags :]), np.abs(group), entity)
        left -= len(table)


def _alike(cursor: ByteCursor, width: int) -> IntArray:
    """Return the records (M, width) that follow with the header just read: Gmsh writes one header for each element."""
    cursor.at -= 12
    row = 3 + width
    table = cursor.peek((cursor.end - cursor.at) // (4 * row) * row).reshape(-1, row)
    if not len(table):
        return cursor.ints(row)[None, 3:]  # says that the section has ended
    other = (table[:, :3] != table[0, :3]).any(axis=1)
    count = int(np.argmax(other)) if other.any() else len(table)
    return cursor.ints(count * row).reshape(count, row)[:, 3:]


class Gmsh(Format):
    """Gmsh meshes; patches are the physical groups of dimension 2, by name, or ``surface_<tag>`` without one.

    Faces in no group are called ``entity_<tag>`` by their surface of the geometry. Points, lines, groups of volumes,
    data and the geometry are no part of the mesh; a rewritten file keeps them unchanged.
    A file without volume cells whose points have one z is a plane mesh: its patches are the groups of dimension 1, and
    ``curve_<tag>`` those without a name.
    Cells are one block of each shape, in the file's order within the shape. Elements with nodes on their edges are
    refused. A new file is of version 2.2 in text.
    """

    name = "gmsh"
    suffixes = (".msh",)

    for_workers = "binary Gmsh files of version 4.1"

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshOnDisk | None:
        """See `Format.layout`; None for a file that is no binary one of version 4.1, with its nodes in order."""
        with about(path), gmsh_file(path) as file:
            return _layout(file, path, scratch is not None)

    def coordinates(self, path: Path) -> ByteColumns | Words:
        with gmsh_file(path) as file:
            stored = nodes(file)
        return (
            Words(path, stored.count, partial(_words, stored)) if stored.placed else ByteColumns(_points(path, stored))
        )

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        return DOUBLE

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; MeshFileError for polyhedra of other shapes, and for faces of five corners."""
        progress(f"writing {out.name}", 0.0)
        with fresh(out) as beside, about(out):
            return write_mesh(mesh, beside)


def _words(stored: Nodes, file: BinaryIO, report: Callable[[float], None]) -> Iterator[tuple[int, bytes, Placed]]:
    """Yield the whole text, and the coordinates in it (`Words`)."""
    places = (np.concatenate([getattr(part, of) for part in stored.placed]) for of in ("values", "begin", "end"))
    file.seek(0)
    yield 0, file.read(), Placed(*places)
    report(1.0)


def _points(path: Path, stored: Nodes) -> TablePieces:
    ends = np.cumsum([0, *(table.rows for table in stored.points)]).tolist()
    ranges = tuple(map(PointRange, ends[:-1], ends[1:], stored.points))
    return TablePieces(str(path.resolve()), stored.count, ranges, ())


def _layout(file: GmshFile, path: Path, in_file: bool) -> MeshOnDisk | None:
    """Return the layout of a file; None if some tables would be in memory although all must be `in_file`."""
    if "PartitionedEntities" in file.sections:
        raise MeshFileError("is partitioned; `gmsh FILE -save -format msh22 -o NEW.msh` saves it in one part")
    if in_file and not (file.order and file.version == 41):
        return None
    stored, every = nodes(file), list(elements(file))
    solid = not SOLIDS.keys().isdisjoint(block.kind for block in every)
    if in_file and (stored.known is not None or len(every) > MOST or not solid):
        return None
    points = _points(path, stored)
    plane = not solid and _is_plane(points)
    given, dimension = (elements(file, 1), 2) if plane else (every, 3)
    mesh = _mesh_of(file, stored, points, given, dimension)
    return replace(mesh, name=path.resolve().name)


def _is_plane(points: TablePieces) -> bool:
    return points.points > 0 and not np.ptp(points.coordinates(0, points.points)[:, 2])


def _mesh_of(
    file: GmshFile, stored: Nodes, points: TablePieces, given: Iterable[ElementBlock], dimension: int
) -> MeshOnDisk:
    """Return the mesh of the elements; those of `dimension` are its cells."""
    solids, faces = KINDS[dimension]
    blocks = _by_kind(given, solids | faces)
    cells = tuple(_cells(solids[kind], parts, stored) for kind, parts in blocks.items() if kind in solids)
    faces_stored = {kind: (_nodes(parts, stored), parts) for kind, parts in blocks.items() if kind in faces}
    border = group_patches(faces_stored, group_names(file, dimension - 1), faces)
    pieces = replace(points, cells=cells).orient()
    listed, notes = pairs_listed(file, dimension - 1, stored.index)
    pairs = pairs_of(border, listed, pieces.places)
    zones = (Zone("", 0, stored.count),)
    return MeshOnDisk("", pieces, pairs.patches, zones, (*notes, *pairs.notes), periodic=pairs.periodic)


def _by_kind(blocks: Iterable[ElementBlock], wanted: Container[int]) -> dict[int, list[ElementBlock]]:
    kinds: dict[int, list[ElementBlock]] = {}
    for block in blocks:
        if block.kind in wanted:
            kinds.setdefault(block.kind, []).append(block)
    return kinds


def _cells(shape: str, parts: Sequence[ElementBlock], stored: Nodes) -> CellTable:
    order = MIRRORED["wedge"] if shape == "wedge" else ()
    if stored.known is None:
        return CellTable(shape, Joined(tuple(block.nodes for block in parts)), 1, order)
    return CellTable(shape, MemoryTable(_nodes(parts, stored)), 0, order)


def _nodes(parts: Iterable[ElementBlock], stored: Nodes) -> IntArray:
    return stored.index(np.concatenate([block.nodes.integers() for block in parts]))


def pairs_listed(
    file: GmshFile, dimension: int, index: Callable[[IntArray, str], IntArray]
) -> tuple[list[Listed], tuple[str, ...]]:
    """Return the periodic pairs of boundaries of a dimension, or a sentence on why they cannot be read.

    `index` returns the index of each node from its number; its second argument names the nodes in errors.
    """
    try:
        return [(name, index(rows, f"pairs of {name}")) for name, rows in periodic(file, dimension)], ()
    except MeshFileError as error:
        return [], (f"{error}; the periodic pairs are left out",)


def group_names(file: GmshFile, wanted: int) -> dict[int, str]:
    """Return the names of the physical groups of a dimension."""
    names = PHYSICAL.findall(file.content("PhysicalNames")) if "PhysicalNames" in file.sections else []
    return {int(tag): name.decode("utf-8", "replace") for dimension, tag, name in names if int(dimension) == wanted}


def group_patches(
    blocks_of: Mapping[int, tuple[IntArray, Iterable[ElementBlock]]], names: dict[int, str], faces: dict[int, str]
) -> tuple[Patch, ...]:
    """Return the patches in the order of their tags; groups of one name are one patch."""
    groups: dict[tuple[bool, int, int], list[Cells]] = {}
    for kind, (rows, blocks) in blocks_of.items():
        group, entity = (np.concatenate([block.each(what) for block in blocks]) for what in ("group", "entity"))
        pairs = np.column_stack([group == 0, group, np.where(group == 0, entity, 0)])
        labels, index = np.unique(pairs, axis=0, return_inverse=True)
        for i, (free, physical, part) in enumerate(labels.tolist()):
            groups.setdefault((free, physical, part), []).append(Cells(faces[kind], rows[index.ravel() == i]))
    named: dict[str, list[Cells]] = {}
    nameless = "curve" if "line" in faces.values() else "surface"
    for (free, physical, part), cells in sorted(groups.items(), key=lambda item: item[0]):
        name = f"entity_{part}" if free else names.get(physical, f"{nameless}_{physical}")
        named.setdefault(name, []).extend(cells)
    return tuple(Patch(name, tuple(cells)) for name, cells in named.items())


def write_mesh(mesh: Mesh, out: Path) -> tuple[str, ...]:
    """Write boundary faces, then cells; patch i is physical group i + 1, the cells are the group ``volume`` after them.

    Periodic pairs link these groups.

    MeshFileError for polyhedra of other than the usual shapes, and faces of more than four corners.
    """
    import meshio

    names = [patch.name.replace('"', "'") for patch in mesh.patches]
    tagged = _with_tags(mesh)
    groups = [np.full(len(block), tag, dtype=np.int32) for block, tag in tagged]
    dimension = 2 if mesh.plane else 3
    fields = {name: np.array([tag, dimension - 1]) for tag, name in enumerate(names, 1)}
    fields[fitting_names([VOLUME], '"', names)[VOLUME]] = np.array([len(names) + 1, dimension])
    links = pairs_to_write(mesh)
    whole = meshio.Mesh(
        mesh.points,
        [(block.shape, _in_gmsh_order(block)) for block, _ in tagged],
        cell_data={"gmsh:physical": groups, "gmsh:geometrical": groups},
        field_data=fields,
        gmsh_periodic=[_link(mesh, pair) for pair in links] or None,
    )
    meshio.write(out, whole, file_format="gmsh22", binary=False)
    left = [pair for pair in mesh.periodic if pair not in links]
    return (*_new_names(mesh, names), *(["its zones are one mesh"] if len(mesh.zones) > 1 else []), *unwritten(left))


def _new_names(mesh: Mesh, names: Sequence[str]) -> list[str]:
    pairs = zip(mesh.names, names, strict=True)
    return [f"patch {old} is called {name}" for old, name in pairs if old != name]


def _with_tags(mesh: Mesh) -> list[tuple[Cells, int]]:
    """Return the faces of each patch, then the cells; each block has the number of its physical group."""
    faces = [(block, tag) for tag, patch in enumerate(mesh.patches, 1) for block in simple_faces(patch)]
    cells = [(block, len(mesh.patches) + 1) for block in standard_cells(mesh)]
    return [(block, tag) for block, tag in (*faces, *cells) if len(block)]


def _in_gmsh_order(block: Cells) -> IntArray:
    """Return the nodes (M, k) in the order of Gmsh, whose prisms are mirrored."""
    return mirror_nodes("wedge", block.nodes) if block.shape == "wedge" else block.nodes


def _link(mesh: Mesh, pair: Periodic) -> tuple[int, tuple[int, int], FloatArray, IntArray]:
    """Return a pair in meshio's form: dimension, second and first entity, the motion to the second, and the nodes."""
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = pair.rotation, pair.shift
    first, second = (1 + mesh.names.index(name) for name in pair.patches)
    return 1 if mesh.plane else 2, (second, first), motion.ravel(), pair.nodes[:, ::-1]
