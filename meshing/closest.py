"""Exact distances to triangulated surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import VTK_ID_TYPE, reference, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkGenericCell, vtkPolyData, vtkStaticCellLocator

from sdm_deflect.meshing.mesh import FloatArray, IntArray


class ClosestTriangle:
    """Finds the nearest of some triangles (T, 3) on points (N, 3)."""

    def __init__(self, points: FloatArray, triangles: IntArray) -> None:
        used, compact = np.unique(triangles, return_inverse=True)
        nodes = vtkPoints()
        nodes.SetData(numpy_to_vtk(np.ascontiguousarray(points[used]), True))
        offsets = 3 * np.arange(len(triangles) + 1)
        cells = vtkCellArray()
        cells.SetData(numpy_to_vtk(offsets, True, VTK_ID_TYPE), numpy_to_vtk(compact.ravel(), True, VTK_ID_TYPE))
        surface = vtkPolyData()
        surface.SetPoints(nodes)
        surface.SetPolys(cells)
        self._locator = vtkStaticCellLocator()
        self._locator.SetDataSet(surface)
        self._locator.BuildLocator()

    def __call__(self, points: FloatArray) -> tuple[FloatArray, IntArray]:
        """Distance (P,) in metres from each point (P, 3) and index (P,) of the nearest triangle."""
        squared, index = np.empty(len(points)), np.empty(len(points), dtype=np.intp)
        cell, spot = vtkGenericCell(), [0.0, 0.0, 0.0]
        found: Any = reference(0)
        part: Any = reference(0)
        away: Any = reference(0.0)
        for i, point in enumerate(points.tolist()):
            self._locator.FindClosestPoint(point, spot, cell, found, part, away)
            squared[i], index[i] = away, found
        return np.sqrt(squared), index
