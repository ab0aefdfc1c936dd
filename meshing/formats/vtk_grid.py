"""VTK's unstructured grids as meshes with patches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import (
    VTK_EMPTY_CELL,
    VTK_HEXAHEDRON,
    VTK_LINE,
    VTK_PIXEL,
    VTK_POLY_LINE,
    VTK_POLY_VERTEX,
    VTK_POLYGON,
    VTK_POLYHEDRON,
    VTK_PYRAMID,
    VTK_QUAD,
    VTK_TETRA,
    VTK_TRIANGLE,
    VTK_VERTEX,
    VTK_VOXEL,
    VTK_WEDGE,
    vtkCellArray,
    vtkUnstructuredGrid,
)  # fmt: skip

from sdm_deflect.deform.mesh import CORNERS, Cells, Mesh, Patch, Polygons, Polyhedra
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.guard import check_faces
from sdm_deflect.meshing.formats.orientation import oriented
from sdm_deflect.meshing.formats.polygons import taken
from sdm_deflect.meshing.formats.polyhedral import polyhedra
from sdm_deflect.meshing.mesh import FloatArray, IntArray

SOLIDS = {VTK_TETRA: "tetra", VTK_PYRAMID: "pyramid", VTK_WEDGE: "wedge", VTK_HEXAHEDRON: "hexahedron"}
FACES = {VTK_TRIANGLE: "triangle", VTK_QUAD: "quad"}
IMAGES = {VTK_VOXEL: ("hexahedron", [0, 1, 3, 2, 4, 5, 7, 6]), VTK_PIXEL: ("quad", [0, 1, 3, 2])}
"""Cells of image data, with their nodes in the order of the other cell."""
PASSED = (VTK_EMPTY_CELL, VTK_VERTEX, VTK_POLY_VERTEX, VTK_LINE, VTK_POLY_LINE)
LABELS = (
    "patch", "patch_id", "patchid", "marker", "markers", "boundary", "boundaryid", "cellentityids", "gmsh:physical",
    "su2:tag", "ref",
)  # fmt: skip
"""Cell arrays that tell patches apart, the first that is there, in lower case."""
NAMES = "patch_names"


def mesh_of(grid: vtkUnstructuredGrid) -> Mesh:
    """Return points, cells and patches of a grid.

    Raises
    ------
    MeshFileError, ValueError
        For cells that are not linear, indices out of range, boundary faces of no cell.
    """
    if not grid.GetNumberOfCells():
        raise MeshFileError("there are no cells")
    types = vtk_to_numpy(grid.GetCellTypes())
    known = [*SOLIDS, *FACES, *IMAGES, *PASSED, VTK_POLYGON, VTK_POLYHEDRON]
    other = types[~np.isin(types, known)]
    if len(other):
        raise MeshFileError(f"{len(other)} cells are of VTK's type {other[0]}, which is not linear or not known")
    points = vtk_to_numpy(grid.GetPoints().GetData()).astype(np.float64)
    all_cells = _polygons(grid.GetCells(), len(points))
    mesh = Mesh(points, _solids(grid, all_cells, types, points), _patches(grid, all_cells, types))
    check_faces(mesh)
    return mesh


def _polygons(cells: vtkCellArray, points: int) -> tuple[IntArray, IntArray]:
    """Nodes of all cells one after another, and where each begins."""
    nodes = vtk_to_numpy(cells.GetConnectivityArray()).astype(np.intp)
    bad = int(np.count_nonzero((nodes < 0) | (nodes >= points)))
    if bad:
        raise MeshFileError(f"{bad} nodes of cells are not among the {points} points")
    return nodes, vtk_to_numpy(cells.GetOffsetsArray()).astype(np.intp)


def _solids(
    grid: vtkUnstructuredGrid, cells: tuple[IntArray, IntArray], types: NDArray[np.uint8], points: FloatArray
) -> tuple[Cells | Polyhedra, ...]:
    found: list[Cells | Polyhedra] = []
    for kind in _kinds(types):
        if kind == VTK_POLYHEDRON:
            found.append(_polyhedra(grid, types))
        elif kind in SOLIDS or kind == VTK_VOXEL:
            block = _block(cells, kind, np.flatnonzero(types == kind))
            found.append(oriented(points, block))
    return tuple(found)


def _kinds(types: NDArray[np.uint8]) -> list[int]:
    """Types in the order in which they first appear."""
    kinds, first = np.unique(types, return_index=True)
    return [int(kind) for kind in kinds[np.argsort(first)]]


def _block(cells: tuple[IntArray, IntArray], kind: int, rows: IntArray) -> Cells:
    nodes, offsets = cells
    shape, order = IMAGES.get(kind, ((SOLIDS | FACES).get(kind, ""), None))
    corners = CORNERS[shape]
    if np.any(np.diff(offsets)[rows] != corners):
        raise MeshFileError(f"some cells of type {shape} have other than {corners} nodes; the file is damaged")
    own = nodes[offsets[rows][:, None] + np.arange(corners)]
    return Cells(shape, own[:, order] if order else own)


def _polyhedra(grid: vtkUnstructuredGrid, types: NDArray[np.uint8]) -> Polyhedra:
    points = grid.GetNumberOfPoints()
    faces = Polygons(*_polygons(grid.GetPolyhedronFaces(), points))
    places = grid.GetPolyhedronFaceLocations()
    own, offsets = (vtk_to_numpy(a()).astype(np.intp) for a in (places.GetConnectivityArray, places.GetOffsetsArray))
    number = np.cumsum(types == VTK_POLYHEDRON) - 1
    cell = np.repeat(number, np.diff(offsets))
    return polyhedra(taken(faces, own), cell, points)


def _patches(
    grid: vtkUnstructuredGrid, cells: tuple[IntArray, IntArray], types: NDArray[np.uint8]
) -> tuple[Patch, ...]:
    flat = np.flatnonzero(np.isin(types, [*FACES, VTK_PIXEL, VTK_POLYGON]))
    labels, names = _labels(grid)
    own = labels[flat]
    found: dict[str, list[Cells | Polygons]] = {}
    for label in np.unique(own).tolist():
        name = names.get(label, f"{names[-1]}_{label}")
        rows = flat[own == label]
        for kind in _kinds(types[rows]):
            some = rows[types[rows] == kind]
            faces = taken(Polygons(*cells), some) if kind == VTK_POLYGON else _block(cells, kind, some)
            found.setdefault(name, []).append(faces)
    return tuple(Patch(name, tuple(faces)) for name, faces in found.items())


def _labels(grid: vtkUnstructuredGrid) -> tuple[IntArray, dict[int, str]]:
    """Label of every cell, and names of labels; name -1 begins the names of all others."""
    data = grid.GetCellData()
    arrays = {str(data.GetArrayName(i)).lower(): data.GetArray(i) for i in range(data.GetNumberOfArrays())}
    for name in LABELS:
        array = arrays.get(name)
        if array is not None and array.GetNumberOfComponents() == 1:
            strings = grid.GetFieldData().GetAbstractArray(NAMES)
            count = strings.GetNumberOfValues() if strings is not None else 0
            names = {i: str(strings.GetValue(i)) for i in range(count)}
            return vtk_to_numpy(array).astype(np.intp), {**names, -1: array.GetName()}
    return np.zeros(grid.GetNumberOfCells(), dtype=np.intp), {-1: "boundary", 0: "boundary"}
