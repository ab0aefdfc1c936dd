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
from sdm_deflect.deform.base.vectors import cross, dot, minus, norm, plus, row_of
from sdm_deflect.deform.mesh.compiled_faces import face_centre
from sdm_deflect.deform.mesh.mesh import Polygons, Polyhedra
from sdm_deflect.deform.mesh.polyhedra import TINY, measured_cells, sides_of, spans_of, touching

CONSERVED = 1e-12
"""Largest gap between what the faces of a cell sweep and how its volume changes, as a share of what is added up."""
ROUNDED = np.finfo(np.float64).eps / CONSERVED
"""Share of the products of lengths, of which flat cells' volumes are differences, that counts as added up, too."""


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


def gained(cells: Polyhedra, swept: FloatArray) -> FloatArray:
    """Return the sum (C,) of what the faces of each cell sweep (F,): its owner's plus, its neighbour's minus."""
    owned, other = _by_side(cells, swept)
    return np.asarray(owned - other)


def _measured(cells: Polyhedra, points: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Volume (R,) of some cells, and the products of lengths of which it is a sum: some cubes of their widths."""
    numbers, owner, neighbour = sides_of(cells, rows)
    spans, cubes = spans_of(cells.faces, numbers), np.zeros(len(rows))
    faces, measured = measured_cells(points, cells.faces.nodes, spans, owner, neighbour, 1.0, len(rows))
    _add_cubes(points, cells.faces.nodes, spans, owner, faces, measured, cubes)
    _add_cubes(points, cells.faces.nodes, spans, neighbour, faces, measured, cubes)
    return measured[:, 3], cubes


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
        start, end = offsets[f], offsets[f + 1]
        if not moved[nodes[start:end]].any():
            continue
        old, new = face_centre(before, nodes, start, end)[0], face_centre(after, nodes, start, end)[0]
        total, way = 0.0, minus(new, old)
        a0, a1 = row_of(before, nodes[end - 1], 0), row_of(after, nodes[end - 1], 0)
        for k in range(start, end):
            b0, b1 = row_of(before, nodes[k], 0), row_of(after, nodes[k], 0)
            u0, u1, v0, v1 = minus(a0, old), minus(a1, new), minus(b0, old), minus(b1, new)
            steps = plus(way, 1.0, plus(minus(a1, a0), 1.0, minus(b1, b0)))
            mean = dot(steps, cross(plus(u0, 1.0, u1), plus(v0, 1.0, v1)))
            total += (3.0 * mean + dot(steps, cross(minus(u1, u0), minus(v1, v0)))) / 72.0
            a0, a1 = b0, b1
        out[f] = total


@compiled_exactly
def _add_cubes(
    points: FloatArray,
    nodes: IntArray,
    spans: IntArray,
    side: IntArray,
    faces: FloatArray,
    cells: FloatArray,
    cubes: FloatArray,
) -> None:  # pragma: no cover - machine code
    """Add the products of lengths that are in the pyramids of the cells (C,) on a side of the faces."""
    for f in range(len(side)):
        cell, square = side[f], 0.0
        if cell >= 0:
            centre = row_of(faces, f, 0)
            for k in range(spans[f, 0], spans[f, 1]):
                arm = minus(row_of(points, nodes[k], 0), centre)
                square += dot(arm, arm)
            cubes[cell] += square * norm(minus(centre, row_of(cells, cell, 0))) / 3.0
