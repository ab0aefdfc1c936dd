"""Points, cells, patches and quality of any mesh file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own.polyhedra import smallest_pyramid
from sdm_deflect.deform.mesh import Cells, Mesh, Polyhedra
from sdm_deflect.meshing.formats.registry import FORMATS, format_of
from sdm_deflect.meshing.mesh import FloatArray
from sdm_deflect.meshing.quality import mean_ratio, signed_volumes

NAMES = {"tetra": "tetrahedra", "hexahedron": "hexahedra", "wedge": "prisms", "pyramid": "pyramids"}
VTK = {
    "tetra": pv.CellType.TETRA,
    "hexahedron": pv.CellType.HEXAHEDRON,
    "wedge": pv.CellType.WEDGE,
    "pyramid": pv.CellType.PYRAMID,
}
PYRAMID = "smallest pyramid over volume"
ROWS = 1 << 18
"""Cells given to VTK at a time."""


def inspect(path: Path) -> str:
    """Return what a mesh file holds, in a few lines.

    Raises
    ------
    InputError, MeshFileError
        If the file is missing, damaged, of an unknown format, or holds no cells with a volume.
    """
    if not path.exists():
        raise InputError(f"{path} is not a file")
    mesh = _read(path)
    lines = [f"{path}: {len(mesh.points)} points, {sum(len(block) for block in mesh.cells)} cells"]
    if len(mesh.zones) > 1:
        lines.append("zones (points): " + ", ".join(f"{zone.name} {zone.stop - zone.start}" for zone in mesh.zones))
    lines += [_quality_line(*found) for found in _qualities(mesh)]
    if mesh.patches:
        lines.append("patches (faces): " + ", ".join(f"{patch.name} {len(patch)}" for patch in mesh.patches))
    return "\n".join(lines)


def _read(path: Path) -> Mesh:
    known = {suffix for known in FORMATS.values() for suffix in known.suffixes}
    mesh = format_of(path).read(path) if path.is_dir() or path.suffix.lower() in known else _read_other(path)
    if not sum(len(block) for block in mesh.cells):
        raise InputError(f"{path} holds no tetrahedra, hexahedra, prisms, pyramids or polyhedra")
    return mesh


def _read_other(path: Path) -> Mesh:
    """Points and cells of a file that PyVista can read, without patches."""
    try:
        found: Any = pv.read(path)
    except Exception as error:  # every reader of VTK and meshio has its own exceptions
        raise InputError(f"{path} cannot be read as a mesh: {error}") from error
    grid = (found.combine() if isinstance(found, pv.MultiBlock) else found).cast_to_unstructured_grid()
    nodes = grid.cells_dict
    cells = tuple(Cells(shape, nodes[kind].astype(np.intp)) for shape, kind in VTK.items() if kind in nodes)
    return Mesh(np.asarray(grid.points, dtype=np.float64), cells, ())


def _qualities(mesh: Mesh) -> Iterator[tuple[str, str, FloatArray, int]]:
    """Yield, for each type of cell, its name, the measure, the values (M,) and the number of inverted cells."""
    for shape, name in NAMES.items():
        blocks = [block.nodes for block in mesh.cells if isinstance(block, Cells) and block.shape == shape]
        if sum(map(len, blocks)):
            nodes = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
            yield name, *_quality(mesh.points, Cells(shape, nodes))
    pyramids = [smallest_pyramid(mesh.points, block) for block in mesh.cells if isinstance(block, Polyhedra)]
    if sum(map(len, pyramids)):
        values = np.concatenate(pyramids)
        yield "polyhedra", PYRAMID, values, int(np.count_nonzero(values <= 0.0))


def _quality(points: FloatArray, cells: Cells) -> tuple[str, FloatArray, int]:
    """Mean ratio of tetrahedra (the paper's), VTK's scaled Jacobian of the others."""
    if cells.shape == "tetra":
        inverted = int(np.count_nonzero(signed_volumes(points, cells.nodes) <= 0.0))
        return "mean ratio", mean_ratio(points, cells.nodes), inverted
    values = np.concatenate(
        [_scaled_jacobian(points, cells.shape, cells.nodes[i : i + ROWS]) for i in range(0, len(cells), ROWS)]
    )
    return "scaled Jacobian", values, int(np.count_nonzero(values <= 0.0))


def _scaled_jacobian(points: FloatArray, shape: str, nodes: Any) -> FloatArray:
    used, own = np.unique(nodes, return_inverse=True)
    grid = pv.UnstructuredGrid({VTK[shape]: own.reshape(nodes.shape)}, points[used])
    return np.asarray(grid.cell_quality("scaled_jacobian")["scaled_jacobian"])


def _quality_line(name: str, measure: str, values: FloatArray, inverted: int) -> str:
    line = (
        f"{len(values)} {name}, {inverted} inverted; {measure} min {values.min():.3f}, "
        f"1 % {np.percentile(values, 1):.3f}, mean {values.mean():.3f}"
    )
    if measure == PYRAMID:  # an ideal cell of many faces is far below 1
        return line
    return f"{line}, {(values < 0.2).mean():.3%} below 0.2, {(values < 0.4).mean():.3%} below 0.4"
