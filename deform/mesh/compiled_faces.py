"""Faces and cells of polyhedra, compiled: centres, areas, volumes, and what OpenFOAM's checkMesh measures of them."""

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.compiled import Vector, compiled_exactly, cross, dot, minus, norm, plus, row_of

TINY = 1e-150
"""OpenFOAM adds this to divisors that may be 0, and takes a face of a smaller area for one of no area."""


@compiled_exactly
def measure_faces(
    points: FloatArray, nodes: IntArray, spans: IntArray, faces: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in centres and area vectors (F, 3 + 3) of faces, cut into triangles around their mean corner.

    `spans` (F, 2) says where the nodes of each begin and end.
    """
    for i in range(len(spans)):
        centre, area = face_centre(points, nodes, spans[i, 0], spans[i, 1])
        for c in range(3):
            faces[i, c], faces[i, 3 + c] = centre[c], area[c]


@compiled_exactly
def face_centre(
    points: FloatArray, nodes: IntArray, start: int, end: int
) -> tuple[Vector, Vector]:  # pragma: no cover - machine code
    """Return centre and area vector of the face of nodes start to end - 1.

    Lengths are taken from the mean corner, so that thin faces far from the origin lose no digits.
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
    centre = mean if weight < TINY else plus(mean, 1.0 / (3.0 * weight), moment)
    return centre, area if weight >= TINY else (0.0, 0.0, 0.0)


@compiled_exactly
def measure_cells(
    owner: IntArray, neighbour: IntArray, faces: FloatArray, cells: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in centres, volumes, and sums of area vectors and of their sizes (C, 3 + 1 + 3 + 3) of cells.

    Cells of a face are -1 where they are not wanted; the first faces have a neighbour.
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
        solid = abs(cells[cell, 3]) > TINY * TINY
        for c in range(3):
            cells[cell, c] = cells[cell, c] / cells[cell, 3] if solid else means[cell, c]
        cells[cell, 3] /= 3.0


@compiled_exactly
def smallest_pyramids(
    owner: IntArray, neighbour: IntArray, faces: FloatArray, cells: FloatArray, smallest: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in the volume (C,) of the smallest pyramid of each cell, on one of its faces with the tip at its centre."""
    smallest[:] = np.inf
    for i in range(len(owner)):
        for k in range(2 if i < len(neighbour) else 1):
            cell = neighbour[i] if k else owner[i]
            if cell >= 0:
                height = minus(row_of(faces, i, 0), row_of(cells, cell, 0))
                volume = (1.0 - 2.0 * k) * dot(row_of(faces, i, 3), height) / 3.0
                smallest[cell] = min(smallest[cell], volume)


@compiled_exactly
def _add_areas(
    side: IntArray, sign: float, faces: FloatArray, means: FloatArray, cells: FloatArray
) -> None:  # pragma: no cover - machine code
    """Add up centres of faces and their number, area vectors and sizes of these by the cell on a side."""
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
    """Add up three times the volumes of face pyramids, and their moments, by the cell on a side."""
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
    """Fill in the cosine of the non-orthogonality of faces, 1 on the boundary, and their skewness (F, 2).

    `sides` (F, 3) has the row of a face in `spans` and `faces`, the cell behind it, and that ahead, -1 on the boundary.
    The non-orthogonality is the angle between the area vector and the line of the cells' centres. The skewness is the
    distance of the face's centre from where that line meets the face, over the face's extent that way; on the boundary
    the line is along the normal.
    """
    for i in range(len(sides)):
        face, ahead = sides[i, 0], sides[i, 2]
        behind, centre, area = row_of(cells, sides[i, 1], 0), row_of(faces, face, 0), row_of(faces, face, 3)
        off, size = minus(centre, behind), norm(area)
        if ahead >= 0:
            line, least = minus(row_of(cells, ahead, 0), behind), 0.2
            judged[i, 0] = dot(line, area) / (norm(line) * size + TINY)
        else:
            normal = plus((0.0, 0.0, 0.0), 1.0 / (size + TINY), area)
            line, least = plus((0.0, 0.0, 0.0), dot(normal, off), normal), 0.4
            judged[i, 0] = 1.0
        skew = plus(off, -dot(area, off) / (dot(area, line) + TINY), line)
        distance, extent = norm(skew), least * norm(line) + TINY
        for k in range(spans[face, 0], spans[face, 1]):
            arm = minus(row_of(points, nodes[k], 0), centre)
            extent = max(extent, abs(dot(skew, arm)) / (distance + TINY))
        judged[i, 1] = distance / extent
