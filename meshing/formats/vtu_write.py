"""VTK unstructured grids (.vtu) written: a header of XML, then every array compressed and appended."""

import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import IntArray
from sdm_deflect.deform.base.sets import distinct
from sdm_deflect.deform.mesh.mesh import Cells, Mesh, Polygons, Polyhedra
from sdm_deflect.meshing.files import fresh
from sdm_deflect.meshing.formats.polyhedra import faces_by_cell
from sdm_deflect.meshing.mesh import CAD_FACE, VOLUME, skin

Array = NDArray[np.generic]

TYPES = {"line": 3, "triangle": 5, "quad": 9, "tetra": 10, "hexahedron": 12, "wedge": 13, "pyramid": 14}
"""VTK's number of each shape."""
POLYGON, POLYHEDRON = 7, 42
FAST = 1
"""zlib's level: files of meshes are 4 % larger than at VTK's default, and written in a third of the time."""
BLOCK = 1 << 20
"""Bytes that are compressed at a time."""
PLACE = 24
"""Characters kept free for the offset of an array, which is known once the arrays before it are compressed."""
HEAD = (
    '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
    'header_type="UInt64" compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n'
)


def write_vtu(
    path: Path, mesh: Mesh, point_data: Mapping[str, Array] | None = None, cell_data: Mapping[str, Array] | None = None
) -> None:
    """Write cells, then boundary faces, and arrays on them; the same input gives the same bytes.

    The cell array ``patch`` says on which patch a face is (0 for cells), the field array ``patch_names`` names the
    patches; of a tetrahedral mesh, ``cad_face`` holds the CAD faces. A mesh without patches has none of these.

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
    """Blocks of cells, then of faces; the number of cells; labels (M + F,) of both; names of patches."""
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
    """Nodes (K,) of all cells, their number (C,) in each cell, types (C,), and the faces of polyhedra."""
    parts = [_part(block) for block in blocks]
    nodes, sizes = (np.concatenate([np.empty(0, dtype=np.intp), *(part[i] for part in parts)]) for i in (0, 1))
    types = np.concatenate([np.empty(0, dtype=np.uint8), *(part[2] for part in parts)])
    if POLYHEDRON not in types:
        return nodes, sizes, types, {}
    stream, ends = [], np.full(len(types), -1)
    first = begin = 0
    for block, (_, own, _) in zip(blocks, parts, strict=True):
        if isinstance(block, Polyhedra):
            faces, last = _face_stream(block)
            ends[first : first + len(own)] = begin + last
            stream.append(faces)
            begin += len(faces)
        first += len(own)
    return nodes, sizes, types, {"faces": np.concatenate(stream), "faceoffsets": ends}


def in_memory(block: Cells | Polygons | Polyhedra) -> tuple[IntArray, NDArray[np.uint8]]:
    """Return cells as VTK's memory holds them, the size of each before its nodes or faces, and their types (C,)."""
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
    """Number of faces of each cell, then for each face its number of nodes and the nodes; and where cells end."""
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
        place = f'NumberOfTuples="{len(names)}" format="appended" offset="{"":{PLACE}}'
        text.append(f'<FieldData>\n<Array type="String" Name="patch_names" {place}/>\n</FieldData>\n')
        arrays.append(np.frombuffer("".join(f"{name}\0" for name in names).encode(), dtype=np.uint8))
    text.append(f'<Piece NumberOfPoints="{points}" NumberOfCells="{cells}">\n')
    for section, own in sections.items():
        stored = {name: _stored(values) for name, values in own.items()}
        text += [f"<{section}>\n", *(_element(name, values) for name, values in stored.items()), f"</{section}>\n"]
        arrays += stored.values()
    text.append('</Piece>\n</UnstructuredGrid>\n<AppendedData encoding="raw">\n_')
    header = "".join(text).encode()
    file.write(header)
    places = []
    with ThreadPoolExecutor() as pool:
        for values in arrays:
            places.append(file.tell() - len(header))
            file.writelines(_packed(values, pool))
    file.write(b"\n</AppendedData>\n</VTKFile>\n")
    for found, at in zip(re.finditer(rb'offset="', header), places, strict=True):
        file.seek(found.end())
        file.write(b'%d"' % at)


def _stored(values: Array) -> Array:
    """The values as the file has them, little-endian; integers with 32 bits where they fit."""
    if values.dtype == np.int64 and np.abs(values).max(initial=0) <= np.iinfo(np.int32).max:
        values = values.astype(np.int32)
    return np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))


def _element(name: str, values: Array) -> str:
    kind = values.dtype.name.capitalize().replace("Ui", "UI")
    columns = f'NumberOfComponents="{values.shape[1]}" ' if values.ndim == 2 else ""
    place = f'offset="{"":{PLACE}}'
    return f'<DataArray type="{kind}" Name={quoteattr(name)} {columns}format="appended" {place}/>\n'


def _packed(values: Array, pool: ThreadPoolExecutor) -> Iterator[bytes]:
    """Number and size of the blocks, size of the last one unless it is whole, sizes as packed; then the blocks."""
    raw = values.reshape(-1).view(np.uint8).data
    blocks = [raw[start : start + BLOCK] for start in range(0, len(raw), BLOCK)]
    packed = list(pool.map(lambda block: zlib.compress(block, FAST), blocks))
    yield np.array([len(blocks), BLOCK, len(raw) % BLOCK, *map(len, packed)], dtype="<u8").tobytes()
    yield from packed
