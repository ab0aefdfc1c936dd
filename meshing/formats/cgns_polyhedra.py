"""Polyhedra of a CGNS zone: faces (NGON_n), and cells by their faces (NFACE_n) or faces by their cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sdm_deflect.deform.mesh import Polygons, Polyhedra
from sdm_deflect.meshing.formats.cgns_elements import NFACE, NGON, Section, connectivity, starts
from sdm_deflect.meshing.formats.cgns_nodes import child, integers
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.polygons import polygons, taken, turned
from sdm_deflect.meshing.mesh import BoolArray, IntArray

Sides = tuple[IntArray, IntArray, BoolArray]
"""Owner (F,), neighbour (F,) or -1, and whether the face's normal points into its owner."""


def read_polyhedra(found: Sequence[Section], points: int) -> tuple[Polyhedra, IntArray]:
    """Return the polyhedra of a zone, and the number in the file (F,) of each of their faces.

    Raises
    ------
    MeshFileError
        If the sections are damaged or do not fit one another.
    """
    surfaces = [section for section in found if section.kind == NGON]
    if not surfaces:
        raise MeshFileError("there are cells by their faces (NFACE_n), but no faces (NGON_n)")
    faces = _faces(surfaces, points)
    numbers = np.concatenate([np.arange(section.first, section.last + 1) for section in surfaces])
    cells = [section for section in found if section.kind == NFACE]
    owner, neighbour, inward = _sides_by_cell(cells, numbers) if cells else _sides_by_face(surfaces)
    unused = int(np.count_nonzero(owner < 0))
    if unused:
        raise MeshFileError(f"{unused} of {len(owner)} faces are of no cell; the file is damaged")
    inner, outer = np.flatnonzero(neighbour >= 0), np.flatnonzero(neighbour < 0)
    order = np.concatenate([inner, outer])
    return Polyhedra(taken(turned(faces, inward), order), owner[order], neighbour[inner]), numbers[order]


def _faces(surfaces: Sequence[Section], points: int) -> Polygons:
    nodes, sizes = [], []
    for section in surfaces:
        stored, own = _split(section)
        bad = int(np.count_nonzero((stored < 1) | (stored > points)))
        if bad or np.any(np.diff(own) < 3):
            raise MeshFileError(
                f"section {section.name}: faces of fewer than 3 corners, or of points that are not there"
            )
        nodes.append(stored - 1)
        sizes.append(np.diff(own))
    return polygons(np.concatenate(nodes), np.concatenate(sizes))


def _split(section: Section) -> tuple[IntArray, IntArray]:
    """Connectivity without the sizes that old files put before each element, and offsets (M + 1,)."""
    stored = connectivity(section)
    offsets = starts(section, stored, None)
    if "ElementStartOffset" in section.node:
        return stored, offsets
    return np.delete(stored, offsets[:-1]), offsets - np.arange(len(offsets))


def _sides_by_cell(cells: Sequence[Section], numbers: IntArray) -> Sides:
    faces, owners, first = [], [], 0
    for section in cells:
        stored, offsets = _split(section)
        faces.append(stored)
        owners.append(np.repeat(np.arange(first, first + len(section)), np.diff(offsets)))
        first += len(section)
    signed, cell = np.concatenate(faces), np.concatenate(owners)
    row = np.minimum(np.searchsorted(numbers, np.abs(signed)), len(numbers) - 1)
    bad = int(np.count_nonzero(numbers[row] != np.abs(signed)))
    if bad:
        raise MeshFileError(f"{bad} faces of cells are not in the file; the file is damaged")
    return _paired(row, cell, signed < 0, len(numbers))


def _paired(row: IntArray, cell: IntArray, inward: BoolArray, faces: int) -> Sides:
    """Owner and neighbour of each face from (face, cell) pairs; the owner is the cell that the normal leaves."""
    order = np.lexsort((inward, row))
    row, cell, inward = row[order], cell[order], inward[order]
    count = np.bincount(row, minlength=faces)
    more = int(np.count_nonzero(count > 2))
    if more:
        raise MeshFileError(f"{more} faces are of more than two cells; the file is damaged")
    first = np.cumsum(count) - count
    owner, neighbour, backward = np.full(faces, -1), np.full(faces, -1), np.zeros(faces, dtype=np.bool_)
    used, both = count > 0, count == 2
    owner[used], backward[used] = cell[first[used]], inward[first[used]]
    neighbour[both] = cell[first[both] + 1]
    return owner, neighbour, backward


def _sides_by_face(surfaces: Sequence[Section]) -> Sides:
    """Read the two cells of each face, from the first of which its normal points to the second."""
    parents = np.concatenate(
        [integers(child(section.node, "ParentElements")).reshape(2, -1) for section in surfaces], axis=1
    )
    if parents.shape[1] != sum(len(section) for section in surfaces) or not parents.any():
        raise MeshFileError("ParentElements do not fit the faces (NGON_n), and there is no NFACE_n")
    cells = np.where(parents > 0, parents - parents[parents > 0].min(), -1)
    backward = cells[0] < 0
    return np.where(backward, cells[1], cells[0]), np.where(backward, -1, cells[1]), backward
