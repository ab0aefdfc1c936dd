"""Faces and cells of polyhedra, compiled: centres, areas, volumes, and what OpenFOAM's checkMesh measures of them."""

import numpy as np

from sdm_deflect.deform.mesh import FloatArray, IntArray
from sdm_deflect.deform.rbf.compiled import compiled_exactly

TINY = 1e-150
"""OpenFOAM adds this to divisors that may be 0, and takes a face of a smaller area for one of no area."""
Vector = tuple[float, float, float]


@compiled_exactly
def measure_faces(
    points: FloatArray, nodes: IntArray, starts: IntArray, ends: IntArray, centres: FloatArray, areas: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in centres (F, 3) and area vectors (F, 3) of faces, cut into triangles around their mean corner."""
    for i in range(len(starts)):
        start, end = starts[i], ends[i]
        x, y, z = 0.0, 0.0, 0.0
        for k in range(start, end):
            x, y, z = x + points[nodes[k], 0], y + points[nodes[k], 1], z + points[nodes[k], 2]
        count = end - start
        mean = x / count, y / count, z / count
        normal, moment, weight = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
        for k in range(start, end):
            a = _row(points, nodes[k])
            b = _row(points, nodes[k + 1 if k + 1 < end else start])
            n = _cross(_minus(b, a), _minus(mean, a))
            size = np.sqrt(_dot(n, n))
            normal, weight = _plus(normal, 1.0, n), weight + size
            moment = _plus(moment, size, (a[0] + b[0] + mean[0], a[1] + b[1] + mean[1], a[2] + b[2] + mean[2]))
        flat = weight < TINY
        for c in range(3):
            centres[i, c] = mean[c] if flat else moment[c] / (3.0 * weight)
            areas[i, c] = 0.0 if flat else 0.5 * normal[c]


@compiled_exactly
def measure_cells(
    owner: IntArray,
    neighbour: IntArray,
    centres: FloatArray,
    areas: FloatArray,
    middles: FloatArray,
    volumes: FloatArray,
    sums: FloatArray,
    sizes: FloatArray,
) -> None:  # pragma: no cover - machine code
    """Fill in centres (C, 3) and volumes (C,) of cells, sums (C, 3) and sums of sizes (C, 3) of their area vectors.

    Cells of a face are -1 where they are not wanted; the first faces have a neighbour.
    """
    means, counts = np.zeros_like(middles), np.zeros(len(volumes))
    middles[:], volumes[:], sums[:], sizes[:] = 0.0, 0.0, 0.0, 0.0
    for side in range(2):
        cells, sign = (owner, 1.0) if side == 0 else (neighbour, -1.0)
        for i in range(len(cells)):
            cell = cells[i]
            if cell >= 0:
                counts[cell] += 1.0
                for c in range(3):
                    means[cell, c] += centres[i, c]
                    sums[cell, c] += sign * areas[i, c]
                    sizes[cell, c] += abs(areas[i, c])
    for cell in range(len(volumes)):
        for c in range(3):
            means[cell, c] /= counts[cell]
    for side in range(2):
        cells, sign = (owner, 1.0) if side == 0 else (neighbour, -1.0)
        for i in range(len(cells)):
            cell = cells[i]
            if cell >= 0:
                volume = sign * _dot(_row(areas, i), _minus(_row(centres, i), _row(means, cell)))
                volumes[cell] += volume
                for c in range(3):
                    middles[cell, c] += volume * (0.75 * centres[i, c] + 0.25 * means[cell, c])
    for cell in range(len(volumes)):
        solid = abs(volumes[cell]) > TINY * TINY
        for c in range(3):
            middles[cell, c] = middles[cell, c] / volumes[cell] if solid else means[cell, c]
        volumes[cell] /= 3.0


@compiled_exactly
def judge_faces(
    points: FloatArray,
    nodes: IntArray,
    starts: IntArray,
    ends: IntArray,
    centres: FloatArray,
    areas: FloatArray,
    behind: FloatArray,
    ahead: FloatArray,
    inner: int,
    cosines: FloatArray,
    skewness: FloatArray,
) -> None:  # pragma: no cover - machine code
    """Fill in cosines (F,) of the non-orthogonality of faces, 1 on the boundary, and their skewness (F,).

    The first faces have a cell ahead; behind and ahead (F, 3) are centres of cells. The non-orthogonality is the angle
    between the area vector and the line of the centres. The skewness is the distance of the face's centre from where
    that line meets the face, over the face's extent that way; on the boundary the line is that along the normal.
    """
    for i in range(len(starts)):
        area, off = _row(areas, i), _minus(_row(centres, i), _row(behind, i))
        if i < inner:
            line, least = _minus(_row(ahead, i), _row(behind, i)), 0.2
            cosines[i] = _dot(line, area) / (_size(line) * _size(area) + TINY)
        else:
            size = _size(area) + TINY
            normal = area[0] / size, area[1] / size, area[2] / size
            line, least = _plus((0.0, 0.0, 0.0), _dot(normal, off), normal), 0.4
            cosines[i] = 1.0
        skew = _plus(off, -_dot(area, off) / (_dot(area, line) + TINY), line)
        distance = _size(skew)
        extent = least * _size(line) + TINY
        for k in range(starts[i], ends[i]):
            arm = _minus(_row(points, nodes[k]), _row(centres, i))
            extent = max(extent, abs(_dot(skew, arm)) / (distance + TINY))
        skewness[i] = distance / extent


@compiled_exactly
def _row(values: FloatArray, i: int) -> Vector:  # pragma: no cover - machine code
    return values[i, 0], values[i, 1], values[i, 2]


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
    return np.sqrt(_dot(a, a))
