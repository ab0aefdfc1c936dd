"""VTK unstructured grids (.vtu): tetrahedra first, then the named boundary triangles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import (
    VTK_ID_TYPE,
    vtkLogger,
    vtkPoints,
    vtkStringArray,
)
from vtkmodules.vtkCommonDataModel import VTK_TETRA, VTK_TRIANGLE, vtkCellArray, vtkUnstructuredGrid
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader, vtkXMLUnstructuredGridWriter

from sdm_deflect.meshing.files import replacing
from sdm_deflect.meshing.mesh import TetMesh

Array = NDArray[np.generic]

FAST = 1
"""zlib's level: files of meshes are 4 % larger than at VTK's default, and written in a third of the time."""


class FormatError(RuntimeError):
    """A mesh file could not be written, or is not one of ours."""


def write_vtu(
    path: Path,
    mesh: TetMesh,
    point_data: Mapping[str, Array] | None = None,
    cell_data: Mapping[str, Array] | None = None,
) -> None:
    """Write a mesh and arrays on it; the same input gives the same bytes.

    Parameters
    ----------
    path
        A .vtu file; it appears whole or not at all.
    point_data
        Further arrays (N, ...) on the nodes, for example ``displacement``.
    cell_data
        Further arrays (M + F, ...) on tetrahedra then triangles, or (M, ...) on the tetrahedra alone (the
        triangles then read 0), for example ``quality``.

    Raises
    ------
    ValueError
        For an array of the wrong length.
    FormatError
        If VTK cannot write the file.
    """
    grid = _grid(mesh)
    for name, values in (point_data or {}).items():
        if len(values) != len(mesh.points):
            raise ValueError(f"{name} has {len(values)} rows, expected {len(mesh.points)} nodes")
        attach(grid.GetPointData(), name, values)
    for name, values in (cell_data or {}).items():
        attach(grid.GetCellData(), name, _on_all_cells(name, values, mesh))
    with replacing(path) as beside:
        writer = vtkXMLUnstructuredGridWriter()
        writer.SetFileName(str(beside))
        writer.SetInputData(grid)
        writer.SetCompressionLevel(FAST)
        if not writer.Write():
            raise FormatError(f"{path} could not be written")


def read_vtu(path: Path) -> TetMesh:
    """Read a mesh that `write_vtu` wrote.

    Raises
    ------
    FormatError
        If the file does not exist, is damaged, or lacks our arrays.
    """
    grid = read_grid(path)
    types = vtk_to_numpy(grid.GetCellTypes()) if grid.GetNumberOfCells() else np.empty(0, dtype=np.uint8)
    if not np.isin(types, (VTK_TETRA, VTK_TRIANGLE)).all():
        raise FormatError(f"{path} holds cells other than tetrahedra and triangles")
    nodes = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
    wide = types == VTK_TETRA
    is_tet = np.repeat(wide, np.where(wide, 4, 3))
    names = grid.GetFieldData().GetAbstractArray("patch_names")
    if names is None:
        raise FormatError(f"{path} has no field array patch_names")
    return TetMesh(
        points=vtk_to_numpy(grid.GetPoints().GetData()).astype(np.float64),
        tets=nodes[is_tet].reshape(-1, 4).astype(np.intp),
        triangles=nodes[~is_tet].reshape(-1, 3).astype(np.intp),
        patch=_labels(grid, "patch", path)[~wide],
        face=_labels(grid, "cad_face", path)[~wide],
        names=tuple(names.GetValue(i) for i in range(names.GetNumberOfValues())),
    )


def read_vtu_arrays(path: Path) -> dict[str, Array]:
    """All point and cell arrays of a .vtu file by name, as stored.

    Raises
    ------
    FormatError
        If the file does not exist or is damaged.
    """
    grid = read_grid(path)
    return {
        data.GetArrayName(i): vtk_to_numpy(data.GetArray(i)).copy()
        for data in (grid.GetPointData(), grid.GetCellData())
        for i in range(data.GetNumberOfArrays())
    }


def _grid(mesh: TetMesh) -> vtkUnstructuredGrid:
    tets, triangles = len(mesh.tets), len(mesh.triangles)
    offsets = np.concatenate([4 * np.arange(tets), 4 * tets + 3 * np.arange(triangles + 1)])
    nodes = np.concatenate([mesh.tets.ravel(), mesh.triangles.ravel()])
    cells = vtkCellArray()
    cells.SetData(numpy_to_vtk(offsets, True, VTK_ID_TYPE), numpy_to_vtk(nodes, True, VTK_ID_TYPE))
    types = np.repeat(np.array([VTK_TETRA, VTK_TRIANGLE], dtype=np.uint8), [tets, triangles])
    points = vtkPoints()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(mesh.points), True))
    grid = vtkUnstructuredGrid()
    grid.SetPoints(points)
    grid.SetCells(numpy_to_vtk(types, True), cells)
    attach(grid.GetCellData(), "patch", np.concatenate([np.zeros(tets, dtype=np.int32), mesh.patch]))
    attach(grid.GetCellData(), "cad_face", np.concatenate([np.full(tets, -1), mesh.face]))
    grid.GetFieldData().AddArray(string_array("patch_names", mesh.names))
    return grid


def string_array(name: str, values: tuple[str, ...]) -> vtkStringArray:
    """Return strings as VTK holds them."""
    strings = vtkStringArray()
    strings.SetName(name)
    for value in values:
        strings.InsertNextValue(value)
    return strings


def attach(data: object, name: str, values: Array) -> None:
    """Add an array to point or cell data; integers are stored with 32 bits."""
    if np.issubdtype(values.dtype, np.integer):
        values = values.astype(np.int32)
    array = numpy_to_vtk(np.ascontiguousarray(values), True)
    array.SetName(name)
    data.AddArray(array)  # type: ignore[attr-defined]


def _on_all_cells(name: str, values: Array, mesh: TetMesh) -> Array:
    tets, triangles = len(mesh.tets), len(mesh.triangles)
    if len(values) == tets + triangles:
        return values
    if len(values) != tets:
        raise ValueError(f"{name} has {len(values)} rows, expected {tets} tetrahedra or all cells")
    return np.concatenate([values, np.zeros((triangles, *values.shape[1:]), dtype=values.dtype)])


def read_grid(path: Path) -> vtkUnstructuredGrid:
    """Read any unstructured grid.

    Raises
    ------
    FormatError
        If the file does not exist, is damaged, or is of another kind.
    """
    if not path.is_file():
        raise FormatError(f"{path} does not exist")
    reader = vtkXMLUnstructuredGridReader()
    if not reader.CanReadFile(str(path)):
        raise FormatError(f"{path} is not a VTK unstructured grid (.vtu)")
    reader.SetFileName(str(path))
    errors: list[str] = []
    reader.AddObserver("ErrorEvent", lambda *_: errors.append("error"))
    with _without_messages():
        reader.Update()
    if errors or reader.GetErrorCode():
        raise FormatError(f"{path} is damaged")
    grid: vtkUnstructuredGrid = reader.GetOutput()
    return grid


@contextmanager
def _without_messages() -> Iterator[None]:
    """Keep VTK from writing to the standard error stream while the block runs."""
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)


def _labels(grid: vtkUnstructuredGrid, name: str, path: Path) -> NDArray[np.intp]:
    array = grid.GetCellData().GetArray(name)
    if array is None:
        raise FormatError(f"{path} has no cell array {name}")
    labels: NDArray[np.intp] = vtk_to_numpy(array).astype(np.intp)
    return labels
