"""Points, cells, patches and quality of any mesh file."""

from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from cases.errors import InputError
from meshing.quality import mean_ratio, signed_volumes

SOLIDS = {
    pv.CellType.TETRA: "tetrahedra",
    pv.CellType.HEXAHEDRON: "hexahedra",
    pv.CellType.WEDGE: "prisms",
    pv.CellType.PYRAMID: "pyramids",
}


def inspect(path: Path) -> str:
    """Return what a mesh file holds, in a few lines.

    Raises
    ------
    InputError
        If the file is missing, of an unknown format, or holds no cells with a volume.
    """
    grid = _read(path)
    lines = [f"{path}: {grid.n_points} points, {grid.n_cells} cells"]
    for kind, name in SOLIDS.items():
        if np.any(grid.celltypes == kind):
            measure, values, inverted = _quality(grid, kind)
            lines.append(
                f"{len(values)} {name}, {inverted} inverted; {measure} min {values.min():.3f}, "
                f"1 % {np.percentile(values, 1):.3f}, mean {values.mean():.3f}, "
                f"{(values < 0.2).mean():.3%} below 0.2, {(values < 0.4).mean():.3%} below 0.4"
            )
    if len(lines) == 1:
        raise InputError(f"{path} holds no tetrahedra, hexahedra, prisms or pyramids")
    return "\n".join(lines + _patches(grid))


def _read(path: Path) -> Any:
    if not path.is_file():
        raise InputError(f"{path} is not a file")
    try:
        mesh = pv.read(path)
    except Exception as error:  # every reader of VTK and meshio has its own exceptions
        raise InputError(f"{path} cannot be read as a mesh: {error}") from error
    if isinstance(mesh, pv.MultiBlock):
        mesh = mesh.combine()
    if not mesh.n_points or not mesh.n_cells:
        raise InputError(f"{path} holds no cells")
    return mesh.cast_to_unstructured_grid()


def _quality(grid: Any, kind: int) -> tuple[str, np.ndarray[Any, Any], int]:
    """Mean ratio of tetrahedra (the paper's), scaled Jacobian of the others."""
    if kind == pv.CellType.TETRA:
        cells = grid.cells_dict[kind]
        points = np.asarray(grid.points, dtype=np.float64)
        inverted = int(np.count_nonzero(signed_volumes(points, cells) <= 0.0))
        return "mean ratio", mean_ratio(points, cells), inverted
    part = grid.extract_cells(grid.celltypes == kind)
    values = np.asarray(part.cell_quality("scaled_jacobian")["scaled_jacobian"])
    return "scaled Jacobian", values, int(np.count_nonzero(values <= 0.0))


def _patches(grid: Any) -> list[str]:
    if "patch" not in grid.cell_data or "patch_names" not in grid.field_data:
        return []
    names, patch = list(grid.field_data["patch_names"]), np.asarray(grid.cell_data["patch"])
    counts = [f"{name} {np.count_nonzero(patch == i)}" for i, name in enumerate(names) if i]
    return ["patches (triangles): " + ", ".join(counts)]
