"""Vectors on the points of any mesh, as a .vtu that viewers open."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sdm_deflect.deform.mesh import Cells, Mesh
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray

VTK_TYPES = {"tetra": 10, "hexahedron": 12, "wedge": 13, "pyramid": 14}


def write_vectors(path: Path, mesh: Mesh, points: FloatArray, vectors: Mapping[str, FloatArray]) -> None:
    """Write cells on `points` (N, 3) with vectors (N, 3) by name; polyhedra are left out, their points stay."""
    import pyvista as pv

    blocks: dict[int, list[IndexArray]] = {}
    for block in mesh.cells:
        if isinstance(block, Cells):
            blocks.setdefault(VTK_TYPES[block.shape], []).append(block.nodes)
    if blocks:
        grid = pv.UnstructuredGrid({kind: np.concatenate(parts) for kind, parts in blocks.items()}, points)
    else:
        grid = pv.PolyData(points).cast_to_unstructured_grid()
    for name, values in vectors.items():
        grid.point_data[name] = values
    grid.save(path)
