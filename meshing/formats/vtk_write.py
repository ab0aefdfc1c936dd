"""Meshes as VTK's unstructured grids, and files with the encoding of another."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import VTK_ID_TYPE, vtkPoints
from vtkmodules.vtkCommonDataModel import VTK_POLYGON, VTK_POLYHEDRON, vtkCellArray, vtkUnstructuredGrid
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

from sdm_deflect.deform.mesh import Cells, Mesh, Polygons, Polyhedra
from sdm_deflect.meshing.formats.polyhedral import faces_by_cell
from sdm_deflect.meshing.formats.vtk_grid import FACES, NAMES, SOLIDS
from sdm_deflect.meshing.mesh import IntArray
from sdm_deflect.meshing.vtu import attach, string_array

TYPES = {shape: kind for kind, shape in (SOLIDS | FACES).items()}
NO_CELL = "volume"
"""Name of patch 0, the cells."""


def grid_of(mesh: Mesh) -> vtkUnstructuredGrid:
    """Return cells, then boundary faces, with the cell array ``patch`` and the field array ``patch_names``."""
    faces = [(block, i) for i, patch in enumerate(mesh.patches, 1) for block in patch.faces]
    parts = [_part(block) for block in (*mesh.cells, *(block for block, _ in faces))]
    labels = [0] * len(mesh.cells) + [i for _, i in faces]
    types = np.concatenate([types for types, _, _ in parts])
    grid = vtkUnstructuredGrid()
    points = vtkPoints()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(mesh.points), True))
    grid.SetPoints(points)
    cells = _array(_joined([own for _, own, _ in parts]))
    kinds = numpy_to_vtk(types, True)
    if VTK_POLYHEDRON in types:
        places, walls = _walls(parts)
        grid.SetPolyhedralCells(kinds, cells, _array(places), _array(walls))
    else:
        grid.SetCells(kinds, cells)
    patch = np.repeat(labels, [len(types) for types, _, _ in parts])
    attach(grid.GetCellData(), "patch", patch)
    grid.GetFieldData().AddArray(string_array(NAMES, (NO_CELL, *(p.name for p in mesh.patches))))
    return grid


Nodes = tuple[IntArray, IntArray]
"""Indices one after another, and how many belong to each cell."""
Part = tuple[IntArray, Nodes, Polyhedra | None]


def _part(block: Cells | Polygons | Polyhedra) -> Part:
    """Types, nodes and numbers of nodes of a block's cells."""
    if isinstance(block, Cells):
        count = np.full(len(block), block.nodes.shape[1])
        return np.full(len(block), TYPES[block.shape], dtype=np.uint8), (block.nodes.ravel(), count), None
    if isinstance(block, Polygons):
        sizes = np.diff(block.offsets)
        kinds = np.select([sizes == 3, sizes == 4], [TYPES["triangle"], TYPES["quad"]], VTK_POLYGON)
        return kinds.astype(np.uint8), (block.nodes, sizes), None
    faces, cell = faces_by_cell(block)
    pairs = np.unique(np.column_stack([np.repeat(cell, np.diff(faces.offsets)), faces.nodes]), axis=0)
    count = np.bincount(pairs[:, 0], minlength=len(block))
    return np.full(len(block), VTK_POLYHEDRON, dtype=np.uint8), (pairs[:, 1], count), block


def _walls(parts: list[Part]) -> tuple[Nodes, Nodes]:
    """Which faces each cell has (none but for polyhedra), and the nodes of these faces."""
    own, sizes, counts = [np.empty(0, dtype=np.intp)], [np.empty(0, dtype=np.intp)], []
    for types, _, block in parts:
        if block is None:
            counts.append(np.zeros(len(types), dtype=np.intp))
            continue
        faces, cell = faces_by_cell(block)
        own.append(faces.nodes)
        sizes.append(np.diff(faces.offsets))
        counts.append(np.bincount(cell, minlength=len(block)))
    count = np.concatenate(counts)
    return (np.arange(count.sum()), count), (np.concatenate(own), np.concatenate(sizes))


def _joined(parts: list[Nodes]) -> Nodes:
    return np.concatenate([nodes for nodes, _ in parts]), np.concatenate([count for _, count in parts])


def _array(nodes: Nodes) -> vtkCellArray:
    offsets = np.concatenate([[0], np.cumsum(nodes[1])])
    cells = vtkCellArray()
    cells.SetData(
        *(numpy_to_vtk(np.ascontiguousarray(a, dtype=np.int64), True, VTK_ID_TYPE) for a in (offsets, nodes[0]))
    )
    return cells


def encode_like(source: Path, writer: vtkXMLUnstructuredGridWriter) -> None:
    """Set a writer to text, binary or appended data, compression and sizes of numbers as in another file."""
    data = source.read_bytes()
    head = re.search(rb"<VTKFile[^>]*>", data)
    words = dict(re.findall(rb"(\w+)\s*=\s*\"([^\"]*)\"", head[0])) if head else {}
    compressor = {b"vtkZLibDataCompressor": 1, b"vtkLZ4DataCompressor": 2, b"vtkLZMADataCompressor": 3}
    writer.SetCompressorType(compressor.get(words.get(b"compressor", b""), 0))
    writer.SetHeaderType(64 if words.get(b"header_type") == b"UInt64" else 32)
    if words.get(b"byte_order") == b"BigEndian":
        writer.SetByteOrderToBigEndian()
    if b'format="appended"' in data:
        writer.SetDataModeToAppended()
        writer.SetEncodeAppendedData(b'encoding="raw"' not in data)
    elif b'format="binary"' in data:
        writer.SetDataModeToBinary()
    else:
        writer.SetDataModeToAscii()
    index = re.search(rb"<DataArray[^>]*Name=\"connectivity\"[^>]*>", data)
    writer.SetIdType(32 if index and b"Int32" in index[0] else 64)
