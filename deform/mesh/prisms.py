"""Polyhedra that are prisms on a wall, as layers of OpenFOAM's snappyHexMesh are: their nodes on it, and opposite."""

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, IntArray
from sdm_deflect.deform.base.sets import distinct
from sdm_deflect.deform.mesh.cells import Polyhedra, taken
from sdm_deflect.deform.mesh.polyhedra import corner_edges


def alone(cells: Polyhedra, rows: IntArray) -> Polyhedra:
    """Return rows (R,) of cells with all their faces, counted from 0; one cell after them stands for all others."""
    place, inner = np.full(len(cells), len(rows), dtype=np.intp), len(cells.neighbour)
    place[rows] = np.arange(len(rows))
    owner, neighbour = place[cells.owner], place[cells.neighbour]
    wanted = owner < len(rows)
    wanted[:inner] |= neighbour < len(rows)
    faces = taken(cells.faces, np.flatnonzero(wanted))
    return Polyhedra(faces, owner[wanted], neighbour[wanted[:inner]])


def prisms_on(cells: Polyhedra, count: int, wall: BoolArray) -> list[tuple[IntArray, IntArray]]:
    """Return nodes (C, k) on a wall, a mask (N,), and nodes (C, k) opposite, of prisms among the first `count` cells.

    A prism has one face on the wall, and as many nodes off it, each at an edge from one node of that face. Prisms of
    triangles, of quadrilaterals and so on come one after another.
    """
    if not len(cells.faces):
        return []
    faces, inner = cells.faces, len(cells.neighbour)
    face = np.flatnonzero(np.logical_and.reduceat(wall[faces.nodes], faces.offsets[:-1]))
    back = face[face < inner]
    base, cell = np.concatenate([face, back]), np.concatenate([cells.owner[face], cells.neighbour[back]])
    base, cell = base[cell < count], cell[cell < count]
    order = np.argsort(cell, kind="stable")
    base, cell = base[order], cell[order]
    once = np.bincount(cell, minlength=count)[cell] == 1
    base, cell = base[once], cell[once]
    size = np.diff(faces.offsets)[base]
    start, end, place = corner_edges(cells, cell)
    leaves = wall[start] & ~wall[end]
    nodes, key = len(wall), place * len(wall)
    columns = [_per_cell(key + start, nodes, len(cell)), _per_cell((key + end)[leaves], nodes, len(cell))]
    columns += [_per_cell((key + start)[leaves], nodes, len(cell)), np.bincount(place[leaves], minlength=len(cell))]
    whole = (columns[0] == 2 * size) & np.logical_and.reduce([column == size for column in columns[1:]])
    rising = np.argsort((key + start)[leaves])
    feet, tips = (key + start)[leaves][rising], end[leaves][rising]
    found = []
    for k in distinct(size[whole]):
        own = np.flatnonzero(whole & (size == k))
        on = faces.nodes[faces.offsets[base[own]][:, None] + np.arange(k)]
        found.append((on, tips[np.searchsorted(feet, own[:, None] * nodes + on)]))
    return found


def _per_cell(keys: IntArray, nodes: int, cells: int) -> IntArray:
    """Return how many distinct nodes each cell (C,) has, given keys: a cell times the number of nodes, plus a node."""
    return np.bincount(distinct(keys) // nodes, minlength=cells)
