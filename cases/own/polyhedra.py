"""Polyhedral cells: positive if every face sees the cell's centre from behind, as OpenFOAM judges them."""

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.cases.own.edges import area_vectors
from sdm_deflect.deform.mesh import Polygons, Polyhedra
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray


def touching(cells: Polyhedra, moved: NDArray[np.bool_]) -> IndexArray:
    """Return the cells with a node in the mask `moved` (N,)."""
    face = np.logical_or.reduceat(moved[cells.faces.nodes], cells.faces.offsets[:-1])
    flags = np.zeros(len(cells), dtype=bool)
    flags[cells.owner[face]] = True
    inner = face[: len(cells.neighbour)]
    flags[cells.neighbour[inner]] = True
    return np.flatnonzero(flags)


def smallest_pyramid(points: FloatArray, cells: Polyhedra, rows: IndexArray | None = None) -> FloatArray:
    """Return the smallest pyramid (R,) of a face over the cell's centre, divided by the cell's volume.

    An ideal cell of F faces has 1/F; not positive means that a face has turned past the centre.
    """
    some = np.arange(len(cells)) if rows is None else rows
    place = np.full(len(cells), -1, dtype=np.intp)
    place[some] = np.arange(len(some))
    inner = len(cells.neighbour)
    own, other = place[cells.owner], place[cells.neighbour]
    wanted = own >= 0
    wanted[:inner] |= other >= 0
    faces, own, other = _chosen(cells.faces, wanted), own[wanted], other[wanted[:inner]]
    face = np.concatenate([np.flatnonzero(own >= 0), np.flatnonzero(other >= 0)])
    cell = np.concatenate([own[own >= 0], other[other >= 0]])
    sign = np.repeat([1.0, -1.0], [np.count_nonzero(own >= 0), np.count_nonzero(other >= 0)])
    area, centre = area_vectors(points, faces), _centres(points, faces)
    middle = np.column_stack([_sum(cell, centre[face, i], len(some)) for i in range(3)])
    middle /= np.maximum(np.bincount(cell, minlength=len(some)), 1)[:, None]
    pyramids = sign * np.einsum("ij,ij->i", area[face], centre[face] - middle[cell]) / 3.0
    least = np.full(len(some), np.inf)
    np.minimum.at(least, cell, pyramids)
    return np.asarray(least / np.maximum(np.abs(_sum(cell, pyramids, len(some))), np.finfo(float).tiny))


def _sum(cell: IndexArray, values: FloatArray, count: int) -> FloatArray:
    return np.asarray(np.bincount(cell, weights=values, minlength=count), dtype=np.float64)


def _chosen(faces: Polygons, wanted: NDArray[np.bool_]) -> Polygons:
    sizes = np.diff(faces.offsets)
    nodes = faces.nodes[np.repeat(wanted, sizes)]
    return Polygons(nodes, np.concatenate([[0], np.cumsum(sizes[wanted])]).astype(np.intp))


def _centres(points: FloatArray, faces: Polygons) -> FloatArray:
    """Return the mean of each face's corners (F, 3)."""
    if not len(faces):
        return np.empty((0, 3))
    sums = np.add.reduceat(points[faces.nodes], faces.offsets[:-1], axis=0)
    return np.asarray(sums / np.diff(faces.offsets)[:, None])
