"""Volumes that faces sweep while a mesh moves, for flow solvers on moving meshes: with them its cells keep their fluid.

A face is cut into triangles around its centre, as OpenFOAM cuts it to measure cells. Its corners and its centre move on
straight lines, so the volume that a triangle sweeps is a polynomial of its corners, and that of a whole face that of a
closed body: old face, new face, and between them what the edges sweep, which they sweep for the neighbouring faces as
well. So the volumes that all faces of a cell sweep add up to the change of its volume, warped faces or not: the
geometric conservation law (Thomas and Lombard 1979), without which a mesh that moves would make mass out of nothing.
"""

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.compiled import compiled_exactly
from sdm_deflect.deform.mesh.mesh import Polygons, Polyhedra
from sdm_deflect.deform.mesh.parts import taken
from sdm_deflect.deform.mesh.polyhedra import TINY, touching

CONSERVED = 1e-12
"""Largest gap between what the faces of a cell sweep and how its volume changes, as a share of what is added up."""
ROUNDED = np.finfo(np.float64).eps / CONSERVED
"""Share of the products of lengths, of which flat cells' volumes are differences, that counts as added up, too."""
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Swept:
    """What faces sweep from one time to the next, and how well it adds up.

    Attributes
    ----------
    faces : (F,) volume that each face sweeps; positive along its normal, where its owner grows.
    rows : (R,) the cells with a node that moves.
    volumes : (R,) their volumes at the end.
    gaps : (R,) what the faces of each sweep less the change of its volume.
    sizes : (R,) what is added up: its volume, and without their signs the volumes that its faces sweep; of a cell more
        than a thousand times as wide as it is high what rounding sees, `ROUNDED` of the cube of its width.
    """

    faces: FloatArray = field(repr=False)
    rows: IntArray = field(repr=False)
    volumes: FloatArray = field(repr=False)
    gaps: FloatArray = field(repr=False)
    sizes: FloatArray = field(repr=False)

    @classmethod
    def of(cls, cells: Polyhedra, before: FloatArray, after: FloatArray) -> "Swept":
        """Measure the way from points `before` (N, 3) to points `after` (N, 3)."""
        moved = (before != after).any(axis=1)
        faces = swept_volumes(cells.faces, before, after, moved)
        rows = touching(cells, moved)
        (old, _), (new, cubes) = (_measured(cells, points, rows) for points in (before, after))
        owned, other = _by_side(cells, np.abs(faces))
        sizes = np.abs(new) + (owned + other)[rows] + ROUNDED * cubes
        return cls(faces, rows, new, gained(cells, faces)[rows] - (new - old), sizes)

    @property
    def gap(self) -> float:
        """Largest gap of any cell, as a share of what is added up."""
        return float((np.abs(self.gaps) / np.maximum(self.sizes, TINY)).max(initial=0.0))

    @property
    def gap_of_volume(self) -> float:
        """Largest gap of any cell, as a share of its volume."""
        return float((np.abs(self.gaps) / np.maximum(np.abs(self.volumes), TINY)).max(initial=0.0))


def swept_volumes(faces: Polygons, before: FloatArray, after: FloatArray, moved: BoolArray | None = None) -> FloatArray:
    """Return the volume (F,) that each face sweeps from points `before` (N, 3) to points `after` (N, 3).

    With u and v from a face's centre to the ends of an edge, the area vector of their triangle is u x v / 2 at each
    time, and its integral over the way (m x n + du x dv / 12) / 2 for the means m, n and the changes du, dv; the mean
    of the corners' displacements goes along it. Nodes that are not marked in `moved` (N,) are at the same place.
    """
    some = np.ones(len(before), dtype=np.bool_) if moved is None else moved
    out = np.zeros(len(faces))
    _sweep(before, after, some, faces.nodes, faces.offsets, out)
    return out


def volumes_of(cells: Polyhedra, points: FloatArray, rows: IntArray | None = None) -> FloatArray:
    """Return the volume of all cells (C,), or of R rows of them, as `polyhedra.pyramids_of` does."""
    return _measured(cells, points, np.arange(len(cells)) if rows is None else rows)[0]


def gained(cells: Polyhedra, swept: FloatArray) -> FloatArray:
    """Return the sum (C,) of what the faces of each cell sweep (F,): its owner's plus, its neighbour's minus."""
    owned, other = _by_side(cells, swept)
    return np.asarray(owned - other)


def _measured(cells: Polyhedra, points: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Volume (R,) of some cells, and the products of lengths of which it is a sum: some cubes of their widths."""
    place, sides = np.full(len(cells), -1, dtype=np.intp), np.full((len(cells.faces), 2), -1, dtype=np.intp)
    place[rows] = np.arange(len(rows))
    sides[:, 0], sides[: len(cells.neighbour), 1] = place[cells.owner], place[cells.neighbour]
    wanted = np.flatnonzero((sides >= 0).any(axis=1))
    faces, sides = taken(cells.faces, wanted), sides[wanted]
    tips = _middles(points, faces.nodes, faces.offsets, sides, len(rows))
    return _pyramids(points, faces.nodes, faces.offsets, sides, tips)


def _by_side(cells: Polyhedra, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sums (C,) of values (F,) over the faces that each cell owns, and over those that it is the neighbour of."""
    sides = (cells.owner, values), (cells.neighbour, values[: len(cells.neighbour)])
    owned, other = (np.asarray(np.bincount(cell, own, len(cells)), dtype=np.float64) for cell, own in sides)
    return owned, other


@compiled_exactly
def _sweep(
    before: FloatArray, after: FloatArray, moved: BoolArray, nodes: IntArray, offsets: IntArray, out: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in what faces with a marked node sweep."""
    for f in range(len(out)):
        face = nodes[offsets[f] : offsets[f + 1]]
        if not moved[face].any():
            continue
        old, new = _centre(before, face)[0], _centre(after, face)[0]
        total, way = 0.0, _less(new, old)
        for i in range(len(face)):
            a, b = face[i - 1], face[i]
            u0, u1 = _less(_at(before, a), old), _less(_at(after, a), new)
            v0, v1 = _less(_at(before, b), old), _less(_at(after, b), new)
            steps = _plus(way, _plus(_less(_at(after, a), _at(before, a)), _less(_at(after, b), _at(before, b))))
            mean = _dot(steps, _cross(_plus(u0, u1), _plus(v0, v1)))
            total += (3.0 * mean + _dot(steps, _cross(_less(u1, u0), _less(v1, v0)))) / 72.0
        out[f] = total


@compiled_exactly
def _middles(
    points: FloatArray, nodes: IntArray, offsets: IntArray, sides: IntArray, count: int
) -> FloatArray:  # pragma: no cover - machine code
    """Mean (R, 3) of the centres of each cell's faces; `sides` (F, 2) are the cells behind and before each, or -1."""
    sums, faces = np.zeros((count, 3)), np.zeros((count, 1))
    for f in range(len(sides)):
        centre, _ = _centre(points, nodes[offsets[f] : offsets[f + 1]])
        for cell in sides[f]:
            if cell >= 0:
                faces[cell, 0] += 1.0
                for k in range(3):
                    sums[cell, k] += centre[k]
    return sums / faces


@compiled_exactly
def _pyramids(
    points: FloatArray, nodes: IntArray, offsets: IntArray, sides: IntArray, tips: FloatArray
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - machine code
    """Volume (R,) of each cell, that of the pyramids on its faces, and the products of lengths that are in it."""
    volumes, cubes = np.zeros((2, len(tips)))
    for f in range(len(sides)):
        face = nodes[offsets[f] : offsets[f + 1]]
        centre, area = _centre(points, face)
        square = 0.0
        for node in face:
            arm = _less(_at(points, node), centre)
            square += _dot(arm, arm)
        for k in range(2):
            cell = sides[f, k]
            if cell >= 0:
                height = _less(centre, _at(tips, cell))
                volumes[cell] += (1.0 - 2.0 * k) * _dot(area, height) / 3.0
                cubes[cell] += square * np.sqrt(_dot(height, height)) / 3.0
    return volumes, cubes


@compiled_exactly
def _centre(points: FloatArray, face: IntArray) -> tuple[Vector, Vector]:  # pragma: no cover - machine code
    """Centre and area vector of a face: see `polyhedra.face_centres_and_areas`."""
    x, y, z, size = 0.0, 0.0, 0.0, 1.0 / len(face)
    for node in face:
        x, y, z = x + points[node, 0], y + points[node, 1], z + points[node, 2]
    mean = x * size, y * size, z * size
    weight, moment, area = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(len(face)):
        a, b = _less(_at(points, face[i - 1]), mean), _less(_at(points, face[i]), mean)
        normal = _cross(a, b)
        own = np.sqrt(_dot(normal, normal))
        weight, area, arm = weight + own, _plus(area, normal), _plus(a, b)
        moment = _plus(moment, (own * arm[0], own * arm[1], own * arm[2]))
    area = 0.5 * area[0], 0.5 * area[1], 0.5 * area[2]
    if weight <= TINY:
        return mean, area
    share = 1.0 / (3.0 * weight)
    return _plus(mean, (share * moment[0], share * moment[1], share * moment[2])), area


@compiled_exactly
def _at(points: FloatArray, node: int) -> Vector:  # pragma: no cover - machine code
    return points[node, 0], points[node, 1], points[node, 2]


@compiled_exactly
def _plus(a: Vector, b: Vector) -> Vector:  # pragma: no cover - machine code
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled_exactly
def _less(a: Vector, b: Vector) -> Vector:  # pragma: no cover - machine code
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled_exactly
def _cross(a: Vector, b: Vector) -> Vector:  # pragma: no cover - machine code
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled_exactly
def _dot(a: Vector, b: Vector) -> float:  # pragma: no cover - machine code
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
