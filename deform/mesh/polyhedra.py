"""Polyhedral cells as OpenFOAM measures them: face and cell centres, volumes and face pyramids.

The formulas are those of OpenFOAM's primitiveMesh, so that a cell is inverted here if checkMesh says so.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.sets import union
from sdm_deflect.deform.mesh.edges import edges_of, polygons_of, rows_of
from sdm_deflect.deform.mesh.mesh import Polygons, Polyhedra
from sdm_deflect.deform.mesh.parts import taken

SMALLEST_PYRAMID = -1e-15
"""checkMesh finds fault with a face pyramid of a smaller volume, in the mesh's unit of length cubed."""
TINY = np.finfo(np.float64).tiny
ROWS, PARTS = 1 << 14, 16
"""Cells measured at a time, so that temporaries stay small; but in so many parts at most: each looks at all faces."""


@dataclass(frozen=True, slots=True, eq=False)
class Pyramids:
    """What decides on R polyhedra: pyramids stand on the faces of a cell, with their tips at its centre.

    Attributes
    ----------
    smallest : (R,) volume of the smallest pyramid of each cell, negative where a face has turned past the centre.
    volume : (R,) volume of each cell: the sum of its pyramids.
    """

    smallest: FloatArray = field(repr=False)
    volume: FloatArray = field(repr=False)

    @property
    def quality(self) -> FloatArray:
        """Smallest pyramid over the cell's volume (R,): 1/F for an ideal cell of F faces."""
        return np.asarray(self.smallest / np.maximum(np.abs(self.volume), TINY))

    @property
    def inverted(self) -> NDArray[np.bool_]:
        """Which cells (R,) checkMesh takes for inverted: by their volume, or by one of their pyramids."""
        return np.asarray((self.smallest < SMALLEST_PYRAMID) | (self.volume < TINY))


def pyramids_of(
    points: FloatArray, cells: Polyhedra, rows: IntArray | None = None, orientation: float = 1.0
) -> Pyramids:
    """Measure cells, or R rows of them.

    Parameters
    ----------
    points : (N, 3) node coordinates.
    orientation
        -1 if the normals of the faces point into their owners, else 1.
    """
    some = np.arange(len(cells)) if rows is None else rows
    parts = [
        _measured(points, cells, some[part], orientation)
        for part in rows_of(len(some), max(ROWS, -(-len(some) // PARTS)))
    ]
    smallest, volume = (
        np.concatenate([np.empty(0), *(getattr(part, name) for part in parts)]) for name in ("smallest", "volume")
    )
    return Pyramids(smallest, volume)


def _measured(points: FloatArray, cells: Polyhedra, rows: IntArray, orientation: float) -> Pyramids:
    faces, face, cell, sign = _sides(cells, rows)
    count = len(rows)
    centres, areas = face_centres_and_areas(points, faces)
    centre, area = centres[face], (orientation * sign)[:, None] * areas[face]
    estimate = _sums(cell, centre, count) / np.maximum(np.bincount(cell, minlength=count), 1)[:, None]
    volume = _dots(area, centre - estimate[cell]) / 3.0
    volumes = _sums(cell, volume, count)
    moments = _sums(cell, volume[:, None] * (0.75 * centre + 0.25 * estimate[cell]), count)
    solid = np.abs(volumes) > TINY
    middle = np.where(solid[:, None], moments / np.where(solid, volumes, 1.0)[:, None], estimate)
    smallest = np.full(count, np.inf)
    np.minimum.at(smallest, cell, _dots(area, centre - middle[cell]) / 3.0)
    return Pyramids(smallest, volumes)


def face_centres_and_areas(points: FloatArray, faces: Polygons) -> tuple[FloatArray, FloatArray]:
    """Return the centres (F, 3) and area vectors (F, 3) of faces, cut into triangles around their mean corner."""
    if not len(faces):
        return np.empty((0, 3)), np.empty((0, 3))
    edges, face = edges_of(faces)
    starts = faces.offsets[:-1]
    first, second = points[edges[:, 0]], points[edges[:, 1]]
    mean = np.add.reduceat(first, starts, axis=0) / np.diff(faces.offsets)[:, None]
    normals = np.cross(second - first, mean[face] - first)
    weights = np.linalg.norm(normals, axis=1)
    weight = np.add.reduceat(weights, starts)[:, None]
    moments = np.add.reduceat(weights[:, None] * (first + second + mean[face]), starts, axis=0)
    centres = np.where(weight > TINY, moments / (3.0 * np.maximum(weight, TINY)), mean)
    return centres, 0.5 * np.add.reduceat(normals, starts, axis=0)


def corner_edges(cells: Polyhedra, rows: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return where edges of rows of cells begin, where they end, and the place of the row, each (K,).

    Every edge of a cell is found once from each of its ends.
    """
    faces, face, cell, sign = _sides(cells, rows)
    sizes = np.diff(faces.offsets)[face]
    start, size = np.repeat(faces.offsets[:-1][face], sizes), np.repeat(sizes, sizes)
    place = np.arange(len(size)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    ahead = (place + np.repeat(sign, sizes).astype(np.intp)) % size
    return faces.nodes[start + place], faces.nodes[start + ahead], np.repeat(cell, sizes)


def touching(cells: Polyhedra, moved: NDArray[np.bool_]) -> IntArray:
    """Return the rows of cells with a node in the mask `moved` (N,)."""
    face = np.logical_or.reduceat(moved[cells.faces.nodes], cells.faces.offsets[:-1])
    flags = np.zeros(len(cells), dtype=bool)
    flags[cells.owner[face]] = True
    flags[cells.neighbour[face[: len(cells.neighbour)]]] = True
    return np.flatnonzero(flags)


def nodes_of(cells: Polyhedra, row: int) -> IntArray:
    """Return the sorted nodes (K,) of the cell of a row."""
    return np.unique(_sides(cells, np.array([row]))[0].nodes)


@dataclass(frozen=True, slots=True, eq=False)
class SomePolyhedra:
    """Some cells of a mesh of polyhedra, with all their faces.

    Attributes
    ----------
    numbers : (F,) rising index in the mesh of each face.
    sides : the faces, first those between two cells; their nodes, owners and neighbours are numbered as in the mesh.
        Cells beyond the faces of those that are meant are owners and neighbours, too.
    """

    numbers: IntArray = field(repr=False)
    sides: Polyhedra

    @property
    def nodes(self) -> IntArray:
        """Nodes (K,) of all faces, one face after another."""
        return self.sides.faces.nodes

    def counted(self, nodes: IntArray, start: int, stop: int) -> Polyhedra:
        """Return it with other nodes (K,), and cells start to stop - 1 from 0 on; all others are one after them."""
        owner, neighbour = (
            np.where((cells >= start) & (cells < stop), cells - start, stop - start).astype(np.intp, copy=False)
            for cells in (self.sides.owner, self.sides.neighbour)
        )
        return Polyhedra(Polygons(nodes, self.sides.faces.offsets), owner, neighbour)

    def some(self, wanted: BoolArray) -> "SomePolyhedra":
        """Return what is left with some of the faces, a mask (F,)."""
        rows, inner = np.flatnonzero(wanted), wanted[: len(self.sides.neighbour)]
        sides = Polyhedra(taken(self.sides.faces, rows), self.sides.owner[rows], self.sides.neighbour[inner])
        return SomePolyhedra(self.numbers[rows], sides)

    def within(self, nodes: IntArray) -> tuple[Polyhedra, IntArray]:
        """Return it as a mesh of its own with points of rising numbers (N,), and the numbers (R,) of its cells."""
        cells = union(self.sides.owner, self.sides.neighbour)
        faces = Polygons(np.searchsorted(nodes, self.nodes), self.sides.faces.offsets)
        owner, neighbour = (np.searchsorted(cells, own) for own in (self.sides.owner, self.sides.neighbour))
        return Polyhedra(faces, owner, neighbour), cells


def joined(parts: Sequence[SomePolyhedra]) -> SomePolyhedra:
    """Return the polyhedra of several parts of a mesh, every face once."""
    numbers, sides = np.concatenate([part.numbers for part in parts]), [part.sides for part in parts]
    faces, owner = polygons_of([own.faces for own in sides]), np.concatenate([own.owner for own in sides])
    neighbour = np.concatenate([_padded(own) for own in sides])
    if (np.diff(numbers) <= 0).any():
        numbers, first = np.unique(numbers, return_index=True)
        faces, owner, neighbour = taken(faces, first), owner[first], neighbour[first]
    return SomePolyhedra(numbers, Polyhedra(faces, owner, neighbour[neighbour >= 0]))


def _padded(cells: Polyhedra) -> IntArray:
    """Return the neighbour (F,) of each face; -1 on the boundary."""
    return np.pad(cells.neighbour, (0, len(cells.owner) - len(cells.neighbour)), constant_values=-1)


def _sides(cells: Polyhedra, rows: IntArray) -> tuple[Polygons, IntArray, IntArray, FloatArray]:
    """Return the faces of the rows, and for each side of one of them its face, its row and the sign of its normal."""
    place = np.full(len(cells), -1, dtype=np.intp)
    place[rows] = np.arange(len(rows))
    inner = len(cells.neighbour)
    own, other = place[cells.owner], place[cells.neighbour]
    wanted = own >= 0
    wanted[:inner] |= other >= 0
    own, other = own[wanted], other[wanted[:inner]]
    behind, front = np.flatnonzero(own >= 0), np.flatnonzero(other >= 0)
    sign = np.repeat([1.0, -1.0], [len(behind), len(front)])
    sizes = np.diff(cells.faces.offsets)
    nodes = cells.faces.nodes[np.repeat(wanted, sizes)]
    faces = Polygons(nodes, np.concatenate([[0], np.cumsum(sizes[wanted])]).astype(np.intp))
    return faces, np.concatenate([behind, front]), np.concatenate([own[behind], other[front]]), sign


def _sums(cell: IntArray, values: FloatArray, count: int) -> FloatArray:
    """Add up values (K,) or (K, 3) by cell (K,)."""
    columns = values.reshape(len(values), -1).T
    sums = [np.bincount(cell, weights=column, minlength=count) for column in columns]
    return np.asarray(np.column_stack(sums).reshape(count, *values.shape[1:]), dtype=np.float64)


def _dots(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", a, b))
