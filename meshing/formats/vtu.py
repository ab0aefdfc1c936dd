"""VTK unstructured grids (.vtu) with an XML header and compressed arrays: written, and those files read."""

import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree.ElementTree import Element, ParseError, fromstring
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, IntArray, distinct
from sdm_deflect.base.errors import MeshFileError, short_list
from sdm_deflect.base.files import fresh
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.base.unpacking import check_unpacked
from sdm_deflect.meshing.errors import about, check_points
from sdm_deflect.meshing.mesh.cells import CORNERS, Cells, Patch, Polygons, Polyhedra
from sdm_deflect.meshing.mesh.labelled import CAD_FACE, VOLUME, Skin, skin, tetrahedral
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.precision import DOUBLE
from sdm_deflect.meshing.mesh.quality import quality_of

from .format import Format
from .polyhedra import faces_by_cell, polyhedra
from .shapes import check_faces, polygons
from .zones import unwritten

Array = NDArray[Any]
# VTK's number of each shape.
TYPES = {"line": 3, "triangle": 5, "quad": 9, "tetra": 10, "hexahedron": 12, "wedge": 13, "pyramid": 14}
# VTK's numbers of the shapes with any number of corners and faces.
POLYGON, POLYHEDRON = 7, 42
# zlib's level: files of meshes are 4 % larger than at VTK's default, and written in a third of the time.
FAST = 1
# Bytes that are compressed at a time.
BLOCK = 1 << 20
# Characters kept free for the offset of an array, which is known once the arrays before it are compressed.
PLACE = 24
HEAD = (
    '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
    'header_type="UInt64" compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n'
)
SHAPES = {kind: shape for shape, kind in TYPES.items()}
START = b'<AppendedData encoding="raw">\n_'
NAMES = "patch_names"
FOREIGN = (
    "this .vtu file was not written by sdm-deflect; read it by PyVista and name the patches of its faces: "
    '`grid.cell_data["patch"] = NUMBERS; grid.field_data["patch_names"] = NAMES`, then sdm_deflect.deflect(grid, ...)'
)


class Vtu(Format):
    """Linear cells, polyhedra, and boundary faces with patches, in the arrays of `write_vtu`."""

    name = "vtu"
    suffixes = (".vtu",)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        progress(f"reading {path.name}", 0.0)
        with _open_grid(path) as grid:
            mesh = grid.mesh()
            check_faces(mesh)
            return mesh

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        return DOUBLE

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; only arrays of the patches are kept."""
        mesh = self.read(source, progress)
        with about(source):
            check_points(points, len(mesh.points))
        with fresh(out, source) as beside:
            self.write(mesh.with_points(points), beside, progress)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; zones become one grid."""
        return self._write(mesh, out, progress)

    def write_moved(self, mesh: Mesh, points: FloatArray, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write_moved`; the point array ``displacement`` and the cell array ``quality`` show the change."""
        quality = np.concatenate([np.empty(0), *(quality_of(points, block) for block in mesh.cells)])
        arrays = {"displacement": points - mesh.points}, {"quality": quality}
        return self._write(mesh.with_points(points), out, progress, *arrays)

    def _write(self, mesh: Mesh, out: Path, progress: Progress, *arrays: Mapping[str, Array]) -> tuple[str, ...]:
        progress(f"writing {out.name}", 0.0)
        write_vtu(out, mesh, *arrays)
        return (*(["its zones are one grid"] if len(mesh.zones) > 1 else []), *unwritten(mesh.periodic))


def read_vtu(path: Path) -> Mesh:
    """Read a mesh of tetrahedra that `write_vtu` wrote.

    Raises MeshFileError if the file does not exist, is damaged, or lacks the arrays of `write_vtu`.
    """
    with _open_grid(path) as grid:
        wide = grid.types == TYPES["tetra"]
        if not (wide | (grid.types == TYPES["triangle"])).all():
            raise MeshFileError("holds cells other than tetrahedra and triangles")
        if grid.names[:1] != (VOLUME,):
            raise MeshFileError(f"{NAMES} must start with {VOLUME!r}, but are {short_list(grid.names)}")
        tets, triangles = (grid.block(np.flatnonzero(some)) for some in (wide, ~wide))
        patch, face = (grid.array("CellData", name)[~wide].astype(np.intp) for name in ("patch", "cad_face"))
        assert isinstance(tets, Cells)
        assert isinstance(triangles, Cells)
        return tetrahedral(
            grid.array("Points", "Points"), tets.nodes, Skin(triangles.nodes, patch - 1, face), grid.names[1:]
        )


def vtu_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays on the nodes and on the cells of a file by name.

    Raises MeshFileError if the file does not exist, or is damaged.
    """
    with _open_grid(path) as grid:
        return {name: grid.array(section, name) for section in ("PointData", "CellData") for name in grid.all(section)}


@contextmanager
def _open_grid(path: Path) -> Iterator["_Grid"]:
    """Yield a file's grid; errors within the block name the file."""
    with about(path):
        try:
            yield _Grid.of(path)
        except (LookupError, TypeError, ArithmeticError, StopIteration, ParseError, zlib.error) as error:
            raise MeshFileError(f"is damaged: {error}") from error


@dataclass(frozen=True)
class _Grid:
    """The bytes of a file, the elements of its header, and the begin of its arrays."""

    data: bytes
    head: Element
    start: int

    @classmethod
    def of(cls, path: Path) -> "_Grid":
        data = path.read_bytes()
        if not data.startswith(HEAD.encode()):
            raise MeshFileError(FOREIGN if b"VTKFile" in data[:1000] else "is not a VTK unstructured grid (.vtu)")
        at = data.find(START)
        if at < 0 or not data.endswith(b"</VTKFile>\n"):
            raise MeshFileError("is damaged: it is truncated")
        return cls(data, fromstring(data[:at] + b"</VTKFile>"), at + len(START))

    def all(self, section: str) -> dict[str, Element]:
        """Return all arrays of a section by name."""
        return {element.get("Name", ""): element for element in self.head.iterfind(f".//{section}/*")}

    def array(self, section: str, name: str) -> Array:
        """Return an array (K,) or (K, columns)."""
        element = self.all(section).get(name)
        if element is None:
            raise MeshFileError(f"has no array {name} in {section}")
        begin = self.start + int(element.get("offset", "none"))
        blocks, size, last = np.frombuffer(self.data, "<u8", 3, begin).tolist()
        packed = np.frombuffer(self.data, "<u8", blocks, begin + 24).astype(np.intp)
        ends = begin + 24 + 8 * blocks + np.cumsum(packed)
        sizes = [size] * (blocks - 1) + [last or size] * bool(blocks)
        check_unpacked(sum(sizes), len(self.data), f"the array {name}")
        parts = zip((ends - packed).tolist(), ends.tolist(), sizes, strict=True)
        body = [zlib.decompressobj().decompress(self.data[a:b], length + 1) for a, b, length in parts]
        if [len(part) for part in body] != sizes:
            raise MeshFileError("is damaged: a packed block is of another size than is announced")
        kind, columns = element.get("type", "").lower(), int(element.get("NumberOfComponents", "1"))
        values = np.frombuffer(b"".join(body), np.dtype("uint8" if kind == "string" else kind))
        return values.reshape(-1, columns) if columns > 1 else values

    @cached_property
    def types(self) -> NDArray[np.uint8]:
        """Types (C,) of cells and faces."""
        return self.array("Cells", "types").astype(np.uint8)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the patches, of the volume first; none of a mesh without patches."""
        if NAMES not in self.all("FieldData"):
            return ()
        return tuple(bytes(self.array("FieldData", NAMES).tolist()).decode("utf-8", "replace").split("\0")[:-1])

    @cached_property
    def cells(self) -> tuple[IntArray, IntArray]:
        """Return the nodes of all cells, and their offsets: the begin of each cell, and the end of the last."""
        nodes, ends = (self.array("Cells", name).astype(np.intp) for name in ("connectivity", "offsets"))
        return nodes, np.append(0, ends)

    def block(self, rows: IntArray) -> Cells | Polygons:
        """Return cells of one type, or polygons."""
        nodes, offsets = self.cells
        begin = offsets[rows]
        sizes = offsets[rows + 1] - begin
        shape = SHAPES.get(int(self.types[rows[0]])) if len(rows) else "triangle"
        if shape is None:
            first = np.repeat(begin - np.cumsum(sizes) + sizes, sizes)
            return polygons(nodes[first + np.arange(len(first))], sizes)
        return Cells(shape, nodes[begin[:, None] + np.arange(CORNERS[shape])])

    def solids(self, rows: IntArray) -> Polyhedra:
        """Return polyhedra."""
        stream, ends = (self.array("Cells", name).astype(np.intp) for name in ("faces", "faceoffsets"))
        heads, count = _face_starts(stream, [0, *ends[rows].tolist()])
        inside = np.ones(len(stream), dtype=np.bool_)
        inside[np.append(0, ends[rows[:-1]])] = inside[heads] = False
        faces = polygons(stream[inside], stream[heads])
        return polyhedra(faces, np.repeat(np.arange(len(count)), count), len(self.array("Points", "Points")))

    def mesh(self) -> Mesh:
        """Return cells by type, in the order in which types first appear, and patches."""
        types, names = self.types, self.names
        label = self.array("CellData", "patch") if names else np.zeros(len(types), dtype=np.intp)
        by_patch: list[list[Any]] = [[] for _ in (names or (VOLUME,))]
        for number, blocks in enumerate(by_patch):
            kinds, first = np.unique(types[rows := np.flatnonzero(label == number)], return_index=True)
            for kind in kinds[np.argsort(first)]:
                some = rows[types[rows] == kind]
                blocks.append(self.solids(some) if kind == POLYHEDRON else self.block(some))
        patches = tuple(Patch(name, tuple(faces)) for name, faces in zip(names[1:], by_patch[1:], strict=True))
        return Mesh(self.array("Points", "Points"), tuple(by_patch[0]), patches)


def _face_starts(stream: IntArray, begin: list[int]) -> tuple[IntArray, IntArray]:
    """Return the place of each face's number of nodes, and the number of faces of each cell."""
    heads, counts, words = [], [], stream.data
    for first, end in pairwise(begin):
        at = first + 1
        while at < end:
            heads.append(at)
            at += 1 + words[at]
        counts.append(words[first])
    return np.array(heads, dtype=np.intp), np.array(counts, dtype=np.intp)


def write_vtu(
    path: Path, mesh: Mesh, point_data: Mapping[str, Array] | None = None, cell_data: Mapping[str, Array] | None = None
) -> None:
    """Write cells, then boundary faces, and arrays on them; the same input gives the same bytes.

    The cell array ``patch`` has the patch of each face (0 for cells); the field array ``patch_names`` has the names,
    each followed by a zero. For a tetrahedral mesh ``cad_face`` has the CAD faces. A mesh without patches has none of
    these.

    Parameters
    ----------
    path : A .vtu file; it appears whole or not at all.
    point_data : Further arrays (N, ...) on the nodes, for example ``displacement``.
    cell_data : Further arrays (M + F, ...) on cells then faces, or (M, ...) on the cells alone (faces then read 0), for
        example ``quality``.

    Raises
    ------
    ValueError
        For an array of the wrong length.
    MeshFileError
        If the file cannot be written, on a full disk for example.
    """
    blocks, volume, labels, names = _grid(mesh)
    nodes, sizes, types, walls = _cells(blocks)
    for name, values in (point_data or {}).items():
        if len(values) != len(mesh.points):
            raise ValueError(f"{name} has {len(values)} rows, expected {len(mesh.points)} nodes")
    on_cells = {name: _on_all(name, values, volume, len(types)) for name, values in (cell_data or {}).items()}
    sections: dict[str, Mapping[str, Array]] = {
        "PointData": point_data or {},
        "CellData": {**labels, **on_cells},
        "Points": {"Points": mesh.points},
        "Cells": {"connectivity": nodes, "offsets": np.cumsum(sizes), "types": types, **walls},
    }
    with fresh(path) as beside, beside.open("wb") as file:
        _write(file, names, sections, len(mesh.points), len(types))


def _grid(mesh: Mesh) -> tuple[Sequence[Cells | Polygons | Polyhedra], int, dict[str, IntArray], tuple[str, ...]]:
    """Return blocks of cells and then faces, the number of cells, labels (M + F,) of both, and names of patches."""
    volume = sum(len(block) for block in mesh.cells)
    if not mesh.patches:
        return mesh.cells, volume, {}, ()
    faces = [block for patch in mesh.patches for block in patch.faces]
    label = np.repeat(np.arange(len(mesh.patches) + 1), [volume, *(len(patch) for patch in mesh.patches)])
    if all(CAD_FACE in patch.labels for patch in mesh.patches):
        boundary = skin(mesh)
        label[volume:] = boundary.patch + 1
        labels = {"patch": label, CAD_FACE: np.concatenate([np.full(volume, -1), boundary.face])}
        return (*mesh.cells, Cells("triangle", boundary.triangles)), volume, labels, (VOLUME, *mesh.names)
    return (*mesh.cells, *faces), volume, {"patch": label}, (VOLUME, *mesh.names)


def _on_all(name: str, values: Array, volume: int, cells: int) -> Array:
    if len(values) == cells:
        return values
    if len(values) != volume:
        raise ValueError(f"{name} has {len(values)} rows, expected {volume} cells, or {cells} with the boundary faces")
    return np.concatenate([values, np.zeros((cells - volume, *values.shape[1:]), dtype=values.dtype)])


def _cells(
    blocks: Sequence[Cells | Polygons | Polyhedra],
) -> tuple[IntArray, IntArray, NDArray[np.uint8], dict[str, Array]]:
    parts = [_part(block) for block in blocks]
    nodes, sizes = (np.concatenate([np.empty(0, dtype=np.intp), *(part[i] for part in parts)]) for i in (0, 1))
    types = np.concatenate([np.empty(0, dtype=np.uint8), *(part[2] for part in parts)])
    if POLYHEDRON not in types:
        return nodes, sizes, types, {}
    stream, ends = [], np.full(len(types), -1)
    first = begin = 0
    for block, (_, starts, _) in zip(blocks, parts, strict=True):
        if isinstance(block, Polyhedra):
            faces, last = _face_stream(block)
            ends[first : first + len(starts)] = begin + last
            stream.append(faces)
            begin += len(faces)
        first += len(starts)
    return nodes, sizes, types, {"faces": np.concatenate(stream), "faceoffsets": ends}


def in_memory(block: Cells | Polygons | Polyhedra) -> tuple[IntArray, NDArray[np.uint8]]:
    """Return cells in VTK's form, each one's size before its nodes or faces, and their types (C,)."""
    rows, sizes, types = _part(block)
    ends = np.cumsum(sizes)
    if isinstance(block, Polyhedra):
        rows, ends = _face_stream(block)
        sizes = np.diff(ends, prepend=0)
    return np.insert(rows, ends - sizes, sizes), types


def _part(block: Cells | Polygons | Polyhedra) -> tuple[IntArray, IntArray, NDArray[np.uint8]]:
    if isinstance(block, Cells):
        width = block.nodes.shape[1]
        return block.nodes.ravel(), np.full(len(block), width), np.full(len(block), TYPES[block.shape], np.uint8)
    if isinstance(block, Polygons):
        sizes = np.diff(block.offsets)
        kinds = np.select([sizes == 3, sizes == 4], [TYPES["triangle"], TYPES["quad"]], POLYGON)
        return block.nodes, sizes, kinds.astype(np.uint8)
    faces, cell = faces_by_cell(block)
    count = faces.nodes.max(initial=0) + 1
    cell, nodes = np.divmod(distinct(np.repeat(cell, np.diff(faces.offsets)) * count + faces.nodes), count)
    return nodes, np.bincount(cell, minlength=len(block)), np.full(len(block), POLYHEDRON, np.uint8)


def _face_stream(block: Polyhedra) -> tuple[IntArray, IntArray]:
    """Return the faces of all cells, each as its number of nodes and the nodes, and the end of each cell."""
    faces, cell = faces_by_cell(block)
    sizes, count = np.diff(faces.offsets), np.bincount(cell, minlength=len(block))
    first_face = np.cumsum(count) - count
    headed = np.insert(faces.nodes, faces.offsets[:-1], sizes)
    begin = faces.offsets[:-1] + np.arange(len(sizes))
    length = 1 + np.bincount(cell, sizes + 1, minlength=len(block)).astype(np.intp)
    return np.insert(headed, begin[first_face], count), np.cumsum(length)


def _write(
    file: BinaryIO, names: tuple[str, ...], sections: Mapping[str, Mapping[str, Array]], points: int, cells: int
) -> None:
    text = [HEAD]
    arrays: list[Array] = []
    if names:
        arrays.append(np.frombuffer("".join(f"{name}\0" for name in names).encode(), dtype=np.uint8))
        # VTK asks for a number of tuples here, and meshio reads no texts.
        element = _element(NAMES, arrays[0]).replace("format", f'NumberOfTuples="{len(arrays[0])}" format')
        text.append(f"<FieldData>\n{element}</FieldData>\n")
    text.append(f'<Piece NumberOfPoints="{points}" NumberOfCells="{cells}">\n')
    for section, own in sections.items():
        stored = {name: _in_file_order(values) for name, values in own.items()}
        text += [f"<{section}>\n", *(_element(name, values) for name, values in stored.items()), f"</{section}>\n"]
        arrays += stored.values()
    text.append('</Piece>\n</UnstructuredGrid>\n<AppendedData encoding="raw">\n_')
    header = "".join(text).encode()
    file.write(header)
    places = []
    with ThreadPoolExecutor() as pool:
        for values in arrays:
            places.append(file.tell() - len(header))
            file.writelines(_compress(values, pool))
    file.write(b"\n</AppendedData>\n</VTKFile>\n")
    for found, at in zip(re.finditer(rb'offset="', header), places, strict=True):
        file.seek(found.end())
        file.write(b'%d"' % at)


def _in_file_order(values: Array) -> Array:
    """Return the values in the file's type: little-endian, integers with 32 bits if they fit."""
    if values.dtype == np.int64 and np.abs(values).max(initial=0) <= np.iinfo(np.int32).max:
        values = values.astype(np.int32)
    return np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))


def _element(name: str, values: Array) -> str:
    kind = values.dtype.name.capitalize().replace("Ui", "UI")
    columns = f'NumberOfComponents="{values.shape[1]}" ' if values.ndim == 2 else ""
    place = f'offset="{"":{PLACE}}'
    return f'<DataArray type="{kind}" Name={quoteattr(name)} {columns}format="appended" {place}/>\n'


def _compress(values: Array, pool: ThreadPoolExecutor) -> Iterator[bytes]:
    """Return a compressed array: number, size, last size and packed sizes of its blocks, then the blocks."""
    raw = values.reshape(-1).view(np.uint8).data
    blocks = [raw[start : start + BLOCK] for start in range(0, len(raw), BLOCK)]
    packed = list(pool.map(lambda block: zlib.compress(block, FAST), blocks))
    yield np.array([len(blocks), BLOCK, len(raw) % BLOCK, *map(len, packed)], dtype="<u8").tobytes()
    yield from packed
