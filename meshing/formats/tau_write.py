"""Primary grids of TAU written anew, in netCDF with offsets of 64 bits."""

from collections.abc import Sequence
from typing import Any, BinaryIO

import numpy as np

from sdm_deflect.deform.base.arrays import IntArray
from sdm_deflect.deform.mesh.mesh import CORNERS, Cells, Mesh
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.periodic import unwritten
from sdm_deflect.meshing.formats.polyhedra import standard_cells
from sdm_deflect.meshing.formats.shapes import mirrored, simple_faces

AXES = ("points_xc", "points_yc", "points_zc")
MARKERS = "boundarymarker_of_surfaces"
SOLIDS = {"tetraeders": "tetra", "prisms": "wedge", "pyramids": "pyramid", "hexaeders": "hexahedron"}
FACES = {"surfacetriangles": "triangle", "surfacequadrilaterals": "quad"}
LARGEST = (1 << 31) - 4
"""Bytes of a variable."""


def write_grid(mesh: Mesh, file: BinaryIO) -> tuple[str, ...]:
    """Write cells by shape, triangles and quadrilaterals with their markers; patch i is marker i + 1.

    Returns a sentence for each thing that is not as in the mesh. MeshFileError for polyhedra of other than the usual
    shapes, faces of more than four corners, no cells, and more cells than netCDF holds.
    """
    from scipy.io import netcdf_file

    cells = list(filter(len, standard_cells(mesh)))
    faces = [(f, marker) for marker, patch in enumerate(mesh.patches, 1) for f in simple_faces(patch) if len(f)]
    if not cells:
        raise MeshFileError("there are no volume cells")
    grid = netcdf_file(file, "w", version=2)
    grid.type = "Primary Grid: Tau Format"
    for marker, patch in enumerate(mesh.patches, 1):
        setattr(grid, f"marker_{marker}", patch.name.encode("utf-8", "replace"))
    grid.createDimension("no_of_elements", sum(map(len, cells)))
    for what, shape in SOLIDS.items():
        _create(grid, what, shape, [block for block in cells if block.shape == shape])
    if faces:
        _store(grid, MARKERS, ("no_of_surfaceelements",), _write_faces(grid, faces))
        _store(grid, "marker", ("no_of_markers",), np.arange(1, len(mesh.patches) + 1))
    for axis, values in zip(AXES, mesh.points.T, strict=True):
        _store(grid, axis, ("no_of_points",), values)
    grid.flush()
    return _lost(mesh)


def _lost(mesh: Mesh) -> tuple[str, ...]:
    empty = [f"patch {patch.name} has no faces and is left out" for patch in mesh.patches if not len(patch)]
    return (*empty, *(["its zones are one mesh"] if len(mesh.zones) > 1 else []), *unwritten(mesh.periodic))


def _write_faces(grid: Any, faces: Sequence[tuple[Cells, int]]) -> IntArray:
    """Write faces by shape, and return the marker (F,) of each."""
    markers = []
    for what, shape in FACES.items():
        own = [(block, marker) for block, marker in faces if block.shape == shape]
        _create(grid, what, shape, [block for block, _ in own])
        markers += [np.full(len(block), marker) for block, marker in own]
    return np.concatenate(markers)


def _create(grid: Any, what: str, shape: str, blocks: Sequence[Cells]) -> None:
    if blocks:
        nodes: IntArray = np.concatenate([block.nodes for block in blocks])
        own = mirrored("wedge", nodes) if shape == "wedge" else nodes
        one = what.removesuffix("s")
        assert nodes.shape[1] == CORNERS[shape]
        _store(grid, f"points_of_{what}", (f"no_of_{what}", f"points_per_{one}"), own)


def _store(grid: Any, name: str, dimensions: Sequence[str], values: np.ndarray[Any, np.dtype[Any]]) -> None:
    """Write an array, of integers or real numbers, with the dimensions that it needs."""
    for dimension, length in zip(dimensions, values.shape, strict=True):
        if dimension not in grid.dimensions:
            grid.createDimension(dimension, length)
    kind = "d" if values.dtype.kind == "f" else "i"
    if values.size * np.dtype(f">{kind}").itemsize > LARGEST:
        raise MeshFileError(f"{name} has more than the {LARGEST} bytes that netCDF holds; write CGNS (.cgns) instead")
    grid.createVariable(name, kind, dimensions)[:] = values
