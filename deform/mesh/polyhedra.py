"""Polyhedral cells as OpenFOAM measures them: face and cell centres, volumes and face pyramids.

The formulas are those of OpenFOAM's primitiveMesh, so that a cell is inverted here if checkMesh says so.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray, union
from sdm_deflect.deform.base.threads import in_chunks
from sdm_deflect.deform.mesh.cells import Polygons, Polyhedra, taken
from sdm_deflect.deform.mesh.compiled_faces import measure_cells, measure_faces, smallest_pyramids
from sdm_deflect.deform.mesh.edges import polygons_of, rows_of

SMALLEST_PYRAMID = -1e-15
"""checkMesh finds fault with a face pyramid of a smaller volume, in the mesh's unit of length cubed."""
TINY = np.finfo(np.float64).tiny
ROWS, PARTS = 1 << 18, 8
"""Cells measured at a time, so that temporaries stay small; but in so many parts at most: each looks at all faces."""
WEIGHT = 40
"""Work on one face in kernel pairs, by which `in_chunks` shares it out."""


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
    smallest, volume = np.empty((2, len(some)))
    for part in rows_of(len(some), max(ROWS, -(-len(some) // PARTS))):
        numbers, owner, neighbour = sides_of(cells, some[part])
        spans = spans_of(cells.faces, numbers)
        faces, measured = measured_cells(
            points, cells.faces.nodes, spans, owner, neighbour, orientation, len(some[part])
        )
        smallest_pyramids(owner, neighbour, faces, measured, smallest[part])
        volume[part] = measured[:, 3]
    return Pyramids(smallest, volume)


def measured_cells(
    points: FloatArray,
    nodes: IntArray,
    spans: IntArray,
    owner: IntArray,
    neighbour: IntArray,
    orientation: float,
    count: int,
) -> tuple[FloatArray, FloatArray]:
    """Return what `measure_faces` says of faces (F, 6), and `measure_cells` of so many cells (C, 10)."""
    faces, cells = np.empty((len(spans), 6)), np.empty((count, 10))

    def measure(low: int, high: int) -> None:
        measure_faces(points, nodes, spans[low:high], faces[low:high])

    in_chunks(measure, len(spans), WEIGHT)
    if orientation < 0.0:
        faces[:, 3:] *= -1.0
    measure_cells(owner, neighbour, faces, cells)
    return faces, cells


def face_centres_and_areas(points: FloatArray, faces: Polygons) -> tuple[FloatArray, FloatArray]:
    """Return the centres (F, 3) and area vectors (F, 3) of faces, cut into triangles around their mean corner."""
    out = np.empty((len(faces), 6))
    measure_faces(points, faces.nodes, spans_of(faces, slice(None)), out)
    return out[:, :3], out[:, 3:]


def sides_of(cells: Polyhedra, rows: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return the faces (F,) of rows of cells, and the cells behind (F,) and ahead (I,) of them.

    Cells are counted as the rows are, -1 for all others; the first faces have a neighbour.
    """
    place = np.full(len(cells), -1, dtype=np.intp)
    place[rows] = np.arange(len(rows))
    owner, neighbour = place[cells.owner], place[cells.neighbour]
    wanted = owner >= 0
    wanted[: len(neighbour)] |= neighbour >= 0
    return np.flatnonzero(wanted), owner[wanted], neighbour[wanted[: len(neighbour)]]


def spans_of(faces: Polygons, rows: IntArray | BoolArray | slice) -> IntArray:
    """Return where the nodes of some faces begin and end (F, 2)."""
    return np.column_stack([faces.offsets[:-1][rows], faces.offsets[1:][rows]])


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
    numbers, owner, neighbour = sides_of(cells, rows)
    behind, front = np.flatnonzero(owner >= 0), np.flatnonzero(neighbour >= 0)
    sign = np.repeat([1.0, -1.0], [len(behind), len(front)])
    cell = np.concatenate([owner[behind], neighbour[front]])
    return taken(cells.faces, numbers), np.concatenate([behind, front]), cell, sign
