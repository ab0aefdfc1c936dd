"""Centres, volumes and face pyramids of polyhedral cells, as OpenFOAM measures them.

The formulas are those of OpenFOAM's primitiveMesh, so that a cell is inverted here if checkMesh says so.

Compiled loops also measure faces as OpenFOAM's checkMesh does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, union
from sdm_deflect.base.compiled import compiled_exactly
from sdm_deflect.base.threads import in_chunks
from sdm_deflect.base.vectors import Vector, cross, dot, minus, norm, plus, row_of

from .cells import Polygons, Polyhedra, take_faces
from .edges import polygons_of, rows_of

# OpenFOAM adds this to divisors that may be 0; a face with a smaller area counts as without area.
NO_AREA = 1e-150
# checkMesh reports an error for a face pyramid of a smaller volume, in the mesh's unit of length cubed.
SMALLEST_PYRAMID = -1e-15
TINY = np.finfo(np.float64).tiny
# Cells in one block, so that temporaries stay small, and most blocks: each looks at all faces.
ROWS, PARTS = 1 << 18, 8
# Work on one face in kernel pairs, by which `in_chunks` divides it.
WEIGHT = 40


@compiled_exactly
def measure_faces(
    points: FloatArray, nodes: IntArray, spans: IntArray, faces: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in the centres and area vectors (F, 3 + 3) of faces, cut into triangles around their mean corner.

    `spans` (F, 2) holds begin and end of each face in `nodes`.
    """
    for i in range(len(spans)):
        centre, area = face_centre(points, nodes, spans[i, 0], spans[i, 1])
        for c in range(3):
            faces[i, c], faces[i, 3 + c] = centre[c], area[c]


@compiled_exactly
def face_centre(
    points: FloatArray, nodes: IntArray, start: int, end: int
) -> tuple[Vector, Vector]:  # pragma: no cover - machine code
    """Return the centre and area vector of the face with nodes start to end - 1.

    Lengths are relative to the mean corner, so that thin faces far from the origin lose no digits.
    """
    mean = (0.0, 0.0, 0.0)
    for k in range(start, end):
        mean = plus(mean, 1.0, row_of(points, nodes[k], 0))
    mean = plus((0.0, 0.0, 0.0), 1.0 / (end - start), mean)
    area, moment, weight = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
    a = minus(row_of(points, nodes[end - 1], 0), mean)
    for k in range(start, end):
        b = minus(row_of(points, nodes[k], 0), mean)
        normal = cross(a, b)
        size = norm(normal)
        area, weight = plus(area, 0.5, normal), weight + size
        moment = plus(moment, size, plus(a, 1.0, b))
        a = b
    centre = mean if weight < NO_AREA else plus(mean, 1.0 / (3.0 * weight), moment)
    return centre, area if weight >= NO_AREA else (0.0, 0.0, 0.0)


@compiled_exactly
def measure_cells(
    owner: IntArray, neighbour: IntArray, faces: FloatArray, cells: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in centre, volume, sum of area vectors and sum of their sizes (C, 3 + 1 + 3 + 3) of cells.

    Owners and neighbours beyond the measured cells are -1; the first faces have a neighbour.
    """
    means = np.zeros((len(cells), 4))
    cells[:] = 0.0
    _add_areas(owner, 1.0, faces, means, cells)
    _add_areas(neighbour, -1.0, faces, means, cells)
    for cell in range(len(cells)):
        for c in range(3):
            means[cell, c] /= means[cell, 3]
    _add_volumes(owner, 1.0, faces, means, cells)
    _add_volumes(neighbour, -1.0, faces, means, cells)
    for cell in range(len(cells)):
        solid = abs(cells[cell, 3]) > NO_AREA * NO_AREA
        for c in range(3):
            cells[cell, c] = cells[cell, c] / cells[cell, 3] if solid else means[cell, c]
        cells[cell, 3] /= 3.0


@compiled_exactly
def smallest_pyramids(
    owner: IntArray, neighbour: IntArray, faces: FloatArray, cells: FloatArray, smallest: FloatArray, least: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in the volume (C,) of each cell's smallest face pyramid; the tips are the cells' centres.

    `least` (C,) is the smallest cosine between a face's area vector and the line from the cell's centre to the face's.
    """
    smallest[:] = least[:] = np.inf
    for i in range(len(owner)):
        for k in range(2 if i < len(neighbour) else 1):
            cell = neighbour[i] if k else owner[i]
            if cell >= 0:
                height = minus(row_of(faces, i, 0), row_of(cells, cell, 0))
                volume = (1.0 - 2.0 * k) * dot(row_of(faces, i, 3), height) / 3.0
                smallest[cell] = min(smallest[cell], volume)
                cosine = 3.0 * volume / (norm(row_of(faces, i, 3)) * norm(height) + NO_AREA)
                least[cell] = min(least[cell], cosine)


@compiled_exactly
def _add_areas(
    side: IntArray, sign: float, faces: FloatArray, means: FloatArray, cells: FloatArray
) -> None:  # pragma: no cover - machine code
    """Add the faces' centres, number, area vectors and areas to the cells on one side."""
    for i in range(len(side)):
        cell = side[i]
        if cell >= 0:
            means[cell, 3] += 1.0
            for c in range(3):
                means[cell, c] += faces[i, c]
                cells[cell, 4 + c] += sign * faces[i, 3 + c]
                cells[cell, 7 + c] += abs(faces[i, 3 + c])


@compiled_exactly
def _add_volumes(
    side: IntArray, sign: float, faces: FloatArray, means: FloatArray, cells: FloatArray
) -> None:  # pragma: no cover - machine code
    """Add three times the volumes of face pyramids, and their moments, to the cells on one side."""
    for i in range(len(side)):
        cell = side[i]
        if cell >= 0:
            volume = sign * dot(row_of(faces, i, 3), minus(row_of(faces, i, 0), row_of(means, cell, 0)))
            cells[cell, 3] += volume
            for c in range(3):
                cells[cell, c] += volume * (0.75 * faces[i, c] + 0.25 * means[cell, c])


@compiled_exactly
def judge_faces(
    points: FloatArray,
    nodes: IntArray,
    spans: IntArray,
    faces: FloatArray,
    cells: FloatArray,
    sides: IntArray,
    judged: FloatArray,
) -> None:  # pragma: no cover - machine code
    """Fill in the cosine of the faces' non-orthogonality, 1 on the boundary, and their skewness (F, 2).

    `sides` (F, 3) has the row of a face in `spans` and `faces`, the cell behind it, and the cell ahead (-1 on the
    boundary). The non-orthogonality is the angle between the area vector and the line of the cells' centres. The
    skewness is the distance of the face's centre from that line in the face's plane, over the face's extent in that
    direction. On the boundary the line is along the normal.
    """
    for i in range(len(sides)):
        face, ahead = sides[i, 0], sides[i, 2]
        behind, centre, area = row_of(cells, sides[i, 1], 0), row_of(faces, face, 0), row_of(faces, face, 3)
        off, size = minus(centre, behind), norm(area)
        if ahead >= 0:
            line, least = minus(row_of(cells, ahead, 0), behind), 0.2
            judged[i, 0] = dot(line, area) / (norm(line) * size + NO_AREA)
        else:
            normal = plus((0.0, 0.0, 0.0), 1.0 / (size + NO_AREA), area)
            line, least = plus((0.0, 0.0, 0.0), dot(normal, off), normal), 0.4
            judged[i, 0] = 1.0
        skew = plus(off, -dot(area, off) / (dot(area, line) + NO_AREA), line)
        distance, extent = norm(skew), least * norm(line) + NO_AREA
        for k in range(spans[face, 0], spans[face, 1]):
            arm = minus(row_of(points, nodes[k], 0), centre)
            extent = max(extent, abs(dot(skew, arm)) / (distance + NO_AREA))
        judged[i, 1] = distance / extent


@dataclass(frozen=True, slots=True, eq=False)
class Pyramids:
    """Volumes and face pyramids of R polyhedra; the tip of a pyramid is the cell's centre.

    Attributes
    ----------
    smallest : (R,) volume of each cell's smallest pyramid, negative if a face has turned past the centre.
    volume : (R,) volume of each cell, the sum of its pyramids.
    orthogonality : (R,) smallest cosine between a face's area vector and the line from the cell's centre to the face's.
    """

    smallest: FloatArray = field(repr=False)
    volume: FloatArray = field(repr=False)
    orthogonality: FloatArray = field(repr=False)

    @property
    def inverted(self) -> NDArray[np.bool_]:
        """Cells (R,) that checkMesh calls inverted, because of their volume or one of their pyramids."""
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
    smallest, volume, least = np.empty((3, len(some)))
    for part in rows_of(len(some), max(ROWS, -(-len(some) // PARTS))):
        numbers, owner, neighbour = sides_of(cells, some[part])
        spans = spans_of(cells.faces, numbers)
        faces, measured = measured_cells(
            points, cells.faces.nodes, spans, owner, neighbour, orientation, len(some[part])
        )
        smallest_pyramids(owner, neighbour, faces, measured, smallest[part], least[part])
        volume[part] = measured[:, 3]
    return Pyramids(smallest, volume, least)


def measured_cells(
    points: FloatArray,
    nodes: IntArray,
    spans: IntArray,
    owner: IntArray,
    neighbour: IntArray,
    orientation: float,
    count: int,
) -> tuple[FloatArray, FloatArray]:
    """Return the measures of faces (F, 6) by `measure_faces`, and of `count` cells (C, 10) by `measure_cells`."""
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
    """Return the faces (F,) of rows of cells, with the cells behind (F,) and ahead (I,) of them.

    Cells are numbered like the rows, all others are -1; the first faces have a neighbour.
    """
    place = np.full(len(cells), -1, dtype=np.intp)
    place[rows] = np.arange(len(rows))
    owner, neighbour = place[cells.owner], place[cells.neighbour]
    wanted = owner >= 0
    wanted[: len(neighbour)] |= neighbour >= 0
    return np.flatnonzero(wanted), owner[wanted], neighbour[wanted[: len(neighbour)]]


def spans_of(faces: Polygons, rows: IntArray | BoolArray | slice) -> IntArray:
    """Return begin and end (F, 2) of the nodes of some faces."""
    return np.column_stack([faces.offsets[:-1][rows], faces.offsets[1:][rows]])


def corner_edges(cells: Polyhedra, rows: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return start, end and cell of the edges of rows of cells, each (K,); cells are numbered like the rows.

    Every edge of a cell occurs once from each of its ends.
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
    """Some cells of a mesh of polyhedra with all their faces.

    Attributes
    ----------
    numbers : (F,) rising indices of the faces in the mesh.
    sides : the faces, those between two cells first; nodes, owners and neighbours have the mesh's indices. Owners and
        neighbours may be cells beyond the wanted ones.
    """

    numbers: IntArray = field(repr=False)
    sides: Polyhedra

    @property
    def nodes(self) -> IntArray:
        """Nodes (K,) of all faces, one face after another."""
        return self.sides.faces.nodes

    def renumbered(self, nodes: IntArray, start: int, stop: int) -> Polyhedra:
        """Return the cells with other nodes (K,); cells start to stop - 1 count from 0, all others become one cell."""
        owner, neighbour = (
            np.where((cells >= start) & (cells < stop), cells - start, stop - start).astype(np.intp, copy=False)
            for cells in (self.sides.owner, self.sides.neighbour)
        )
        return Polyhedra(Polygons(nodes, self.sides.faces.offsets), owner, neighbour)

    def some(self, wanted: BoolArray) -> "SomePolyhedra":
        """Return the faces in a mask (F,)."""
        rows, inner = np.flatnonzero(wanted), wanted[: len(self.sides.neighbour)]
        sides = Polyhedra(take_faces(self.sides.faces, rows), self.sides.owner[rows], self.sides.neighbour[inner])
        return SomePolyhedra(self.numbers[rows], sides)

    def within(self, nodes: IntArray) -> tuple[Polyhedra, IntArray]:
        """Return the cells as a separate mesh of the points with rising indices (N,), and the cells' indices (R,)."""
        cells = union(self.sides.owner, self.sides.neighbour)
        faces = Polygons(np.searchsorted(nodes, self.nodes), self.sides.faces.offsets)
        owner, neighbour = (np.searchsorted(cells, numbers) for numbers in (self.sides.owner, self.sides.neighbour))
        return Polyhedra(faces, owner, neighbour), cells


def join_polyhedra(parts: Sequence[SomePolyhedra]) -> SomePolyhedra:
    """Return the polyhedra of several parts of a mesh, each face once."""
    numbers, sides = np.concatenate([part.numbers for part in parts]), [part.sides for part in parts]
    faces, owner = polygons_of([side.faces for side in sides]), np.concatenate([side.owner for side in sides])
    neighbour = np.concatenate([_neighbours(side) for side in sides])
    if (np.diff(numbers) <= 0).any():
        numbers, first = np.unique(numbers, return_index=True)
        faces, owner, neighbour = take_faces(faces, first), owner[first], neighbour[first]
    return SomePolyhedra(numbers, Polyhedra(faces, owner, neighbour[neighbour >= 0]))


def _neighbours(cells: Polyhedra) -> IntArray:
    """Return the neighbour (F,) of each face; -1 on the boundary."""
    return np.pad(cells.neighbour, (0, len(cells.owner) - len(cells.neighbour)), constant_values=-1)


def _sides(cells: Polyhedra, rows: IntArray) -> tuple[Polygons, IntArray, IntArray, FloatArray]:
    """Return the faces of the rows, and for each side of a face the face, the row and the sign of its normal."""
    numbers, owner, neighbour = sides_of(cells, rows)
    behind, front = np.flatnonzero(owner >= 0), np.flatnonzero(neighbour >= 0)
    sign = np.repeat([1.0, -1.0], [len(behind), len(front)])
    cell = np.concatenate([owner[behind], neighbour[front]])
    return take_faces(cells.faces, numbers), np.concatenate([behind, front]), cell, sign
