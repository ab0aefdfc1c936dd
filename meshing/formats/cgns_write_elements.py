"""Element sections of a CGNS zone: cells, then the faces of each patch; or all faces, then polyhedra."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sdm_deflect.deform.mesh import Cells, Mesh, Patch, Polygons, Polyhedra
from sdm_deflect.meshing.formats.cgns_elements import NFACE, NGON, SHAPES
from sdm_deflect.meshing.formats.cgns_nodes import Integer, create, create_sized, node_names
from sdm_deflect.meshing.formats.faces import face_keys, node_keys
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.orientation import mirrored
from sdm_deflect.meshing.formats.polygons import polygons, simple_faces
from sdm_deflect.meshing.mesh import IntArray

ROWS = 1 << 18
"""Elements written at a time."""
KINDS = {shape: kind for kind, shape in SHAPES.items()}


def write_shapes(zone: Any, mesh: Mesh, names: Mapping[str, str], kind: Integer) -> dict[str, IntArray]:
    """Write cells and boundary faces, and return the numbers of each patch's faces.

    There is a section for each block of cells, then one for each patch by the patch's name (`names` gives it as nodes
    can have it), because some readers know the boundary by its sections alone; faces of a second shape follow in a
    section of their own, because others cannot read mixed sections.
    """
    first = 1
    for block in mesh.cells:
        assert isinstance(block, Cells)
        _write_block(zone, f"cells {block.shape}", block, first, kind)
        first += len(block)
    numbers = {}
    for patch in mesh.patches:
        start = first
        for i, faces in enumerate(simple_faces(patch)):
            _write_block(zone, f"{names[patch.name]} {faces.shape}" if i else names[patch.name], faces, first, kind)
            first += len(faces)
        numbers[patch.name] = np.arange(start, first)
    return numbers


def write_polyhedra(zone: Any, mesh: Mesh, cells: Polyhedra, kind: Integer) -> dict[str, IntArray]:
    """Write all faces and the cells by their faces; return the numbers of each patch's faces.

    Raises
    ------
    MeshFileError
        If a patch has faces that are of no cell.
    """
    faces = len(cells.faces)
    numbered = Polygons(cells.faces.nodes + 1, cells.faces.offsets)
    _write_polygons(zone, "faces", NGON, 1, numbered, kind)
    cell = np.concatenate([cells.owner, cells.neighbour])
    signed = np.concatenate([np.arange(1, faces + 1), -np.arange(1, len(cells.neighbour) + 1)])
    by_cell = polygons(signed[np.argsort(cell, kind="stable")], np.bincount(cell, minlength=len(cells)))
    _write_polygons(zone, "cells", NFACE, faces + 1, by_cell, kind)
    keys = node_keys(len(mesh.points))
    known = face_keys(cells.faces, keys)
    order = np.argsort(known)
    return {patch.name: _numbers(patch, keys, known[order], order) for patch in mesh.patches}


def _numbers(patch: Patch, keys: Any, known: Any, order: IntArray) -> IntArray:
    """Numbers of a patch's faces among the faces of cells, whose keys `known` are sorted by `order`."""
    own = np.concatenate([np.empty(0, np.uint64), *(face_keys(faces, keys) for faces in patch.faces)])
    place = np.minimum(np.searchsorted(known, own), len(known) - 1)
    loose = int(np.count_nonzero(known[place] != own))
    if loose:
        raise MeshFileError(f"{loose} of {len(patch)} faces of patch {patch.name} are of no cell")
    return np.sort(order[place]) + 1


def _write_block(zone: Any, name: str, block: Cells, first: int, kind: Integer) -> None:
    section = _section(zone, name, KINDS[block.shape], first, len(block), kind)
    out = create_sized(section, "ElementConnectivity", block.nodes.size, kind)
    width = block.nodes.shape[1]
    for start in range(0, len(block), ROWS):
        nodes = block.nodes[start : start + ROWS]
        nodes = mirrored("wedge", nodes) if block.shape == "wedge" else nodes
        out[start * width : start * width + nodes.size] = (nodes + 1).astype(kind).ravel()


def _write_polygons(zone: Any, name: str, element: int, first: int, faces: Polygons, kind: Integer) -> None:
    section = _section(zone, name, element, first, len(faces), kind)
    create(section, "ElementStartOffset", "DataArray_t", faces.offsets.astype(kind))
    create(section, "ElementConnectivity", "DataArray_t", faces.nodes.astype(kind))


def _section(zone: Any, name: str, element: int, first: int, count: int, kind: Integer) -> Any:
    (own,) = node_names([name], zone)
    section = create(zone, own, "Elements_t", np.array([element, 0], dtype=np.int32))
    create(section, "ElementRange", "IndexRange_t", np.array([first, first + count - 1], dtype=kind))
    return section
