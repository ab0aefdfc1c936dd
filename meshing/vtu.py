"""VTK unstructured grids (.vtu): tetrahedra first, then the named boundary triangles."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkLogger
from vtkmodules.vtkCommonDataModel import VTK_TETRA, VTK_TRIANGLE, vtkUnstructuredGrid
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

from sdm_deflect.meshing.mesh import TetMesh

Array = NDArray[np.generic]


class FormatError(RuntimeError):
    """A mesh file is damaged, or is not one of ours."""


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
    with without_messages():
        reader.Update()
    if errors or reader.GetErrorCode():
        raise FormatError(f"{path} is damaged")
    grid: vtkUnstructuredGrid = reader.GetOutput()
    return grid


@contextmanager
def without_messages() -> Iterator[None]:
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
