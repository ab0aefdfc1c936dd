"""VTK unstructured grids (.vtu)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.meshing.formats.format import MeshFileError, Progress, silent
from sdm_deflect.meshing.formats.guard import about, check_points, fresh
from sdm_deflect.meshing.formats.vtk_grid import mesh_of
from sdm_deflect.meshing.formats.vtk_write import encode_like
from sdm_deflect.meshing.formats.vtu_write import FAST, write_vtu
from sdm_deflect.meshing.mesh import FloatArray
from sdm_deflect.meshing.vtu import FormatError, read_grid, without_messages


@dataclass(frozen=True, slots=True)
class Vtu:
    """Any linear cells and polyhedra; patches are labels of the faces among the cells.

    Labels are the cell array ``patch`` with the names in the field array ``patch_names``, as our runs write them; else
    the first array of a usual name such as ``marker`` or ``CellEntityIds``, whose patches are called ``marker_3``;
    else all faces are one patch ``boundary``. Points and lines are passed over.

    VTK rewrites files: arrays on points, cells and the grid, their types, attributes and the encoding (text, binary,
    appended, compression) are kept, as are coordinates of single precision. Comments, layout of the XML, and the
    division into pieces are not.
    """

    name: str = "vtu"
    suffixes: tuple[str, ...] = (".vtu",)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        progress(f"reading {path.name}", 0.0)
        grid = _grid(path)
        with about(path):
            return mesh_of(grid)

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`, and above for what VTK does not keep."""
        grid = _grid(source)
        old = grid.GetPoints().GetData()
        with about(source):
            check_points(points, grid.GetNumberOfPoints())
        values = numpy_to_vtk(points.astype(vtk_to_numpy(old).dtype, order="C"), True)
        values.SetName(old.GetName())
        moved = vtkPoints()
        moved.SetData(values)
        grid.SetPoints(moved)
        writer = vtkXMLUnstructuredGridWriter()
        encode_like(source, writer)
        progress(f"writing {out.name}", 0.5)
        with fresh(out, source) as beside:
            _write(writer, grid, beside, out)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; zones become one grid."""
        progress(f"writing {out.name}", 0.0)
        write_vtu(out, mesh)
        return ("its zones are one grid",) if len(mesh.zones) > 1 else ()


def _grid(path: Path) -> vtkUnstructuredGrid:
    try:
        grid = read_grid(path)
    except FormatError as error:
        raise MeshFileError(str(error)) from error
    if grid.GetPoints() is None:
        raise MeshFileError(f"{path}: there are no points")
    return grid


def _write(writer: vtkXMLUnstructuredGridWriter, grid: vtkUnstructuredGrid, beside: Path, out: Path) -> None:
    """Write a grid and read it again: VTK does not tell that a disk is full."""
    writer.SetFileName(str(beside))
    writer.SetInputData(grid)
    writer.SetCompressionLevel(FAST)
    with without_messages():
        writer.Write()
    try:
        whole = read_grid(beside).GetNumberOfPoints() == grid.GetNumberOfPoints()
    except FormatError:
        whole = False
    if not whole or b"</VTKFile>" not in beside.read_bytes()[-16:]:
        raise MeshFileError(f"{out}: cannot be written: the file is not whole; is the disk full?")
