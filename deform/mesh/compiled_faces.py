"""Faces and cells of polyhedra, compiled: centres, areas, volumes, and what OpenFOAM's checkMesh measures of them."""

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.compiled import compiled_exactly

TINY = 1e-150
"""OpenFOAM adds this to divisors that may be 0, and takes a face of a smaller area for one of no area."""
Vector = tuple[float, float, float]


@compiled_exactly
def measure_faces(
    points: FloatArray, nodes: IntArray, spans: IntArray, faces: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in centres and area vectors (F, 3 + 3) of faces, cut into triangles around their mean corner.

    `spans` (F, 2) says where the nodes of each begin and end.
    """
    for i in range(len(spans)):
        start, end = spans[i, 0], spans[i, 1]
        mean = (0.0, 0.0, 0.0)
        for k in range(start, end):
            mean = _plus(mean, 1.0 / (end - start), _row(points, nodes[k], 0))
        normal, moment, weight = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
        for k in range(start, end):
            a, b = _row(points, nodes[k], 0), _row(points, nodes[k + 1 if k + 1 < end else start], 0)
            n = _cross(_minus(b, a), _minus(mean, a))
            size = _size(n)
            normal, weight = _plus(normal, 1.0, n), weight + size
            moment = _plus(moment, size, _plus(_plus(a, 1.0, b), 1.0, mean))
        flat = weight < TINY
        for c in range(3):
            faces[i, c] = mean[c] if flat else moment[c] / (3.0 * weight)
            faces[i, 3 + c] = 0.0 if flat else 0.5 * normal[c]


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
            volume = sign * _dot(_row(faces, i, 3), _minus(_row(faces, i, 0), _row(means, cell, 0)))
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
    """Fill in the cosine of the non-orthogonality of faces, 1 on the boundary, their skewness and area (F, 3).

    `sides` (F, 3) has the row of a face in `spans` and `faces`, the cell behind it, and that ahead, -1 on the boundary.
    The non-orthogonality is the angle between the area vector and the line of the cells' centres. The skewness is the
    distance of the face's centre from where that line meets the face, over the face's extent that way; on the boundary
    the line is along the normal.
    """
    for i in range(len(sides)):
        face, ahead = sides[i, 0], sides[i, 2]
        behind, centre, area = _row(cells, sides[i, 1], 0), _row(faces, face, 0), _row(faces, face, 3)
        off, size = _minus(centre, behind), _size(area)
        if ahead >= 0:
            line, least = _minus(_row(cells, ahead, 0), behind), 0.2
            judged[i, 0] = _dot(line, area) / (_size(line) * size + TINY)
        else:
            normal = _plus((0.0, 0.0, 0.0), 1.0 / (size + TINY), area)
            line, least = _plus((0.0, 0.0, 0.0), _dot(normal, off), normal), 0.4
            judged[i, 0] = 1.0
        skew = _plus(off, -_dot(area, off) / (_dot(area, line) + TINY), line)
        distance, extent = _size(skew), least * _size(line) + TINY
        for k in range(spans[face, 0], spans[face, 1]):
            arm = _minus(_row(points, nodes[k], 0), centre)
            extent = max(extent, abs(_dot(skew, arm)) / (distance + TINY))
        judged[i, 1], judged[i, 2] = distance / extent, size


@compiled_exactly
def judge_cells(
    cells: FloatArray, rows: IntArray, axes: BoolArray, judged: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in aspect ratio and openness (C, 2) of rows of cells, of a mesh that extends in some directions (3,)."""
    solid = axes[0] and axes[1] and axes[2]
    for i in range(len(rows)):
        cell = rows[i]
        least, most, total, openness = np.inf, 0.0, 0.0, 0.0
        for c in range(3):
            size = cells[cell, 7 + c]
            total += size
            openness = max(openness, abs(cells[cell, 4 + c]) / (size + TINY))
            least, most = (min(least, size), max(most, size)) if axes[c] else (least, most)
        aspect = most / (least + TINY)
        if solid:
            aspect = max(aspect, total / (6.0 * max(cells[cell, 3], TINY) ** (2.0 / 3.0)))
        judged[i, 0], judged[i, 1] = aspect, openness


@compiled_exactly
def _row(values: FloatArray, i: int, first: int) -> Vector:  # pragma: no cover - machine code
    return values[i, first], values[i, first + 1], values[i, first + 2]


@compiled_exactly
def _minus(a: Vector, b: Vector) -> Vector:  # pragma: no cover - machine code
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled_exactly
def _plus(a: Vector, factor: float, b: Vector) -> Vector:  # pragma: no cover - machine code
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@compiled_exactly
def _dot(a: Vector, b: Vector) -> float:  # pragma: no cover - machine code
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled_exactly
def _cross(a: Vector, b: Vector) -> Vector:  # pragma: no cover - machine code
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled_exactly
def _size(a: Vector) -> float:  # pragma: no cover - machine code
    return float(np.sqrt(_dot(a, a)))
