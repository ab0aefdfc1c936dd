"""Conversion of other libraries' meshes to `Mesh`, and of moved points back."""

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import replace
from functools import partial
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.meshing.mesh.cells import CORNERS, PLANE, VOLUMES, Cells, Patch, whole
from sdm_deflect.meshing.mesh.faces import corners_in_order
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import quality_of

from .polyhedra import standard_cells
from .shapes import simple_faces
from .vtu import TYPES, in_memory

VTK_SHAPES = {kind: shape for shape, kind in TYPES.items()}


class Accepted(NamedTuple):
    """A mesh as a `Mesh`, and a function that returns the caller's type of mesh for new points (N, 3)."""

    mesh: Mesh
    with_points: Callable[[FloatArray], Any]


def accept(mesh: Any) -> Accepted:
    """Take a Mesh, a meshio or pyvista mesh, or arrays (points, {patch: nodes}).

    meshio: patches are cell sets, or physical groups of Gmsh. pyvista: an unstructured grid whose faces carry the
    cell array ``patch``, named by the field array ``patch_names``.

    Raises InputError for anything else, and for meshes without a patch.
    """
    if isinstance(mesh, Mesh):
        return Accepted(_check(mesh), mesh.with_points)
    if isinstance(mesh, tuple) and len(mesh) == 2 and isinstance(mesh[1], Mapping):
        return Accepted(_check(_of_arrays(*mesh)), lambda points: (points, mesh[1]))
    library = type(mesh).__module__.split(".")[0]
    if library in ADAPTERS:
        flow, with_points = ADAPTERS[library](mesh)
        return Accepted(_check(replace(flow, name=f"{library} mesh")), with_points)
    raise InputError(
        f"an object of type {type(mesh).__name__} is no mesh: give what read returns, a meshio or pyvista mesh, "
        "or (points, {patch: node indices})"
    )


def _check(mesh: Mesh) -> Mesh:
    """Return the mesh with crossed faces of its patches put right; InputError for a mesh without a patch."""
    if not mesh.patches:
        raise InputError(f"{mesh.name} has no named patch, so no surface to move")
    patches, notes = corners_in_order(mesh.patches, mesh.points)
    return replace(mesh, patches=patches, notes=(*mesh.notes, *notes)) if notes else mesh


def _of_arrays(points: Any, patches: Mapping[str, Any]) -> Mesh:
    try:
        named = tuple(Patch(name, (), np.unique(whole(nodes, f"patch {name}"))) for name, nodes in patches.items())
        return Mesh(points, (), named, name="arrays")
    except InputError as error:
        raise InputError(f"arrays: {error}") from None


def _of_meshio(mesh: Any) -> Accepted:
    for block in mesh.cells:
        if block.dim == 3 and block.type not in VOLUMES:
            raise InputError(f"meshio mesh: cells of type {block.type} are not supported")
    shapes, faces = _kinds({block.type for block in mesh.cells})
    cells = tuple(_cells(block.type, block.data) for block in mesh.cells if block.type in shapes)
    patches = tuple(Patch(name, blocks) for name, blocks in _meshio_patches(mesh, faces).items() if blocks)
    points = np.asarray(mesh.points, dtype=np.float64)
    if points.ndim == 2 and points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    return Accepted(Mesh(points, cells, patches), partial(_moved, mesh))


def _kinds(shapes: Set[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the shapes that count as cells and as faces; without volume cells the mesh is plane."""
    return (VOLUMES, PLANE) if shapes & {*VOLUMES} else (PLANE, ("line",))


def _meshio_patches(mesh: Any, faces: tuple[str, ...]) -> dict[str, tuple[Cells, ...]]:
    """Return the faces of each cell set; of each physical group where there are no sets."""
    sets = {name: rows for name, rows in mesh.cell_sets.items() if not name.startswith("gmsh:")}
    sets = sets or _groups(mesh, 1 if faces == ("line",) else 2)
    return {
        name: tuple(
            _cells(block.type, block.data[np.asarray(row, dtype=np.intp)])
            for block, row in zip(mesh.cells, rows, strict=True)
            if block.type in faces and row is not None and len(row)
        )
        for name, rows in sets.items()
    }


def _groups(mesh: Any, dimension: int) -> dict[str, list[IntArray]]:
    tags = mesh.cell_data.get("gmsh:physical", ())
    names = {int(tag): name for name, (tag, of) in mesh.field_data.items() if of == dimension} if len(tags) else {}
    return {name: [np.flatnonzero(numbers == tag) for numbers in tags] for tag, name in names.items()}


def _of_pyvista(mesh: Any) -> Accepted:
    grid = mesh.cast_to_unstructured_grid()
    _check_grid(grid)
    label, names = np.asarray(grid.cell_data["patch"]), grid.field_data["patch_names"]
    names = bytes(names).decode().split("\0")[:-1] if names.dtype == np.uint8 else map(str, names)
    nodes = {VTK_SHAPES[int(kind)]: block_nodes for kind, block_nodes in grid.cells_dict.items()}
    labels = {shape: label[grid.celltypes == kind] for kind, shape in VTK_SHAPES.items()}
    shapes, faces = _kinds({*nodes})
    cells = tuple(_cells(shape, block_nodes) for shape, block_nodes in nodes.items() if shape in shapes)
    blocks = {shape: (nodes[shape], labels[shape]) for shape in faces if shape in nodes}
    patches = (
        Patch(name, tuple(_cells(shape, block_nodes[label == i]) for shape, (block_nodes, label) in blocks.items()))
        for i, name in enumerate(names)
    )
    flow = Mesh(np.asarray(grid.points, dtype=np.float64), cells, tuple(filter(len, patches)))
    return Accepted(flow, partial(_moved, mesh))


def _check_grid(grid: Any) -> None:
    if unknown := sorted({int(kind) for kind in np.unique(grid.celltypes)} - VTK_SHAPES.keys()):
        raise InputError(f"pyvista mesh: VTK cells of type {unknown[0]} are not supported")
    if "patch" not in grid.cell_data or "patch_names" not in grid.field_data:
        raise InputError("pyvista mesh: give faces the cell array 'patch' and names in the field array 'patch_names'")


def _moved(mesh: Any, points: FloatArray) -> Any:
    copy = mesh.copy()
    copy.points = points[:, : np.shape(mesh.points)[1]]
    return copy


def _cells(shape: str, nodes: Any) -> Cells:
    return Cells(shape, np.asarray(nodes, dtype=np.intp).reshape(-1, CORNERS[shape]))


ADAPTERS: dict[str, Callable[[Any], Accepted]] = {"meshio": _of_meshio, "pyvista": _of_pyvista}


def to_pyvista(mesh: Mesh, displacement: FloatArray, orientation: Sequence[float]) -> Any:
    """Return a pyvista UnstructuredGrid of cells and faces.

    Point array ``displacement`` (N, 3), cell arrays ``quality`` (nan on faces) and ``patch`` with the field array
    ``patch_names``; its position 0 is ``volume``. `orientation` is -1 for each block of cells whose nodes are counted
    left-handed, else 1.
    """
    import pyvista as pv

    faces = [(block, i) for i, patch in enumerate(mesh.patches, 1) for block in patch.faces]
    blocks, none = [*((block, 0) for block in mesh.cells), *faces], np.empty(0, dtype=np.uint8)
    cells = [in_memory(block) for block, _ in blocks]
    rows, kinds = (np.concatenate([none, *(pair[i] for pair in cells)]) for i in (0, 1))
    grid = pv.UnstructuredGrid(rows, kinds, mesh.points)
    grid.point_data["displacement"] = displacement
    quality = [
        quality_of(mesh.points, *cells_of) for cells_of in zip(mesh.cells, repeat(None), orientation, strict=False)
    ]
    grid.cell_data["quality"] = np.concatenate([none, *quality, *(np.full(len(block), np.nan) for block, _ in faces)])
    grid.cell_data["patch"] = np.concatenate([none, *(np.full(len(block), i) for block, i in blocks)])
    grid.field_data["patch_names"] = ["volume", *mesh.names]
    return grid


def to_meshio(mesh: Mesh, displacement: FloatArray) -> Any:
    """Return a meshio Mesh of cells and faces: point data ``displacement`` (N, 3), one cell set for each patch.

    Raises InputError for polyhedra that are no tetrahedra, pyramids, wedges or hexahedra: meshio has no form for them.
    """
    import meshio

    try:
        blocks = [("", block) for block in standard_cells(mesh)]
        blocks += [(patch.name, block) for patch in mesh.patches for block in simple_faces(patch)]
    except MeshFileError as error:
        raise InputError(f"{mesh.name}: {error}; use to_pyvista, or save a .vtu file") from None
    sets = {
        name: [np.arange(len(block) if block_name == name else 0) for block_name, block in blocks]
        for name in mesh.names
    }
    cells = [(block.shape, block.nodes) for _, block in blocks]
    return meshio.Mesh(mesh.points, cells, point_data={"displacement": displacement}, cell_sets=sets)
