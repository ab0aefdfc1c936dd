"""Volumes that faces sweep while a mesh moves, for flow solvers on moving meshes: with them its cells keep their fluid.

A face is cut into triangles around its centre, as OpenFOAM cuts it to measure cells. Its corners and its centre move on
straight lines, so the volume that a triangle sweeps is a polynomial of its corners, and that of a whole face that of a
closed body: old face, new face, and between them what the edges sweep, which they sweep for the neighbouring faces as
well. So the volumes that all faces of a cell sweep add up to the change of its volume, warped faces or not: the
geometric conservation law (Thomas and Lombard 1979), without which a mesh that moves would make mass out of nothing.
"""

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.edges import ROWS, edges_of, rows_of
from sdm_deflect.deform.mesh import FloatArray, IntArray, Polygons, Polyhedra
from sdm_deflect.deform.parts import taken
from sdm_deflect.deform.polyhedra import TINY, face_centres_and_areas, pyramids_of, touching

CONSERVED = 1e-12
"""Largest gap between what the faces of a cell sweep and how its volume changes, as a share of what is added up."""


@dataclass(frozen=True, slots=True, eq=False)
class Swept:
    """What faces sweep from one time to the next, and how well it adds up.

    Attributes
    ----------
    faces : (F,) volume that each face sweeps; positive along its normal, where its owner grows.
    rows : (R,) the cells with a node that moves.
    volumes : (R,) their volumes at the end.
    gaps : (R,) what the faces of each sweep less the change of its volume.
    sizes : (R,) what is added up: its volume, and without their signs the volumes that its faces sweep.
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
        some = np.flatnonzero(np.logical_or.reduceat(moved[cells.faces.nodes], cells.faces.offsets[:-1]))
        faces = np.zeros(len(cells.faces))
        faces[some] = swept_volumes(taken(cells.faces, some), before, after)
        rows = touching(cells, moved)
        old, new = (pyramids_of(points, cells, rows).volume for points in (before, after))
        gaps = gained(cells, faces)[rows] - (new - old)
        owned, other = _by_side(cells, np.abs(faces))
        return cls(faces, rows, new, gaps, np.abs(new) + (owned + other)[rows])

    @property
    def gap(self) -> float:
        """Largest gap of any cell, as a share of what is added up."""
        return float((np.abs(self.gaps) / np.maximum(self.sizes, TINY)).max(initial=0.0))

    @property
    def gap_of_volume(self) -> float:
        """Largest gap of any cell, as a share of its volume."""
        return float((np.abs(self.gaps) / np.maximum(np.abs(self.volumes), TINY)).max(initial=0.0))


def swept_volumes(faces: Polygons, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the volume (F,) that each face sweeps from points `before` (N, 3) to points `after` (N, 3).

    With u and v from a face's centre to the ends of an edge, the area vector of their triangle is u x v / 2 at each
    time, and its integral over the way (m x n + du x dv / 12) / 2 for the means m, n and the changes du, dv; the mean
    of the corners' displacements goes along it.
    """
    out = np.empty(len(faces))
    for part in rows_of(len(faces), ROWS):
        own = faces.rows(part.start, part.stop)
        edges, face = edges_of(own)
        old, new = (face_centres_and_areas(points, own)[0] for points in (before, after))
        first, second = (after[edges[:, i]] - before[edges[:, i]] for i in (0, 1))
        (u, du), (v, dv) = (
            (0.5 * (start + end), end - start)
            for start, end in ((before[edges[:, i]] - old[face], after[edges[:, i]] - new[face]) for i in (0, 1))
        )
        areas = np.cross(u, v) + np.cross(du, dv) / 12.0
        swept = np.einsum("ij,ij->i", first + second + (new - old)[face], areas) / 6.0
        out[part] = np.add.reduceat(swept, own.offsets[:-1])
    return out


def gained(cells: Polyhedra, swept: FloatArray) -> FloatArray:
    """Return the sum (C,) of what the faces of each cell sweep (F,): its owner's plus, its neighbour's minus."""
    owned, other = _by_side(cells, swept)
    return np.asarray(owned - other)


def _by_side(cells: Polyhedra, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sums (C,) of values (F,) over the faces that each cell owns, and over those that it is the neighbour of."""
    sides = (cells.owner, values), (cells.neighbour, values[: len(cells.neighbour)])
    owned, other = (np.asarray(np.bincount(cell, own, len(cells)), dtype=np.float64) for cell, own in sides)
    return owned, other
