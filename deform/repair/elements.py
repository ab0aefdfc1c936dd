"""Cells of every shape as tetrahedra at their corners, each with the shape that it should have.

At the corner of a plane cell stands a tetrahedron whose third edge is the unit vector along z, wherever the corner
goes: its last node is its first one again.

Curves on which two surfaces meet: nodes on an edge of the boundary slide along it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray, along_curve
from sdm_deflect.deform.mesh.cells import Cells, Polyhedra, Volume
from sdm_deflect.deform.mesh.compiled_quality import CORNERS
from sdm_deflect.deform.mesh.polyhedra import corner_edges
from sdm_deflect.deform.mesh.sliding import CylinderWall, Plane, SlidingSurface
from sdm_deflect.deform.mesh.standard import parts_of

REGULAR = np.array([[1.0, 0.5, 0.5], [0.0, np.sqrt(3.0) / 2.0, np.sqrt(3.0) / 6.0], [0.0, 0.0, np.sqrt(2.0 / 3.0)]])
"""Edges (columns) of the regular tetrahedron of edge 1."""
REGULAR_TRIANGLE = np.array([[1.0, 0.5, 0.0], [0.0, np.sqrt(3.0) / 2.0, 0.0], [0.0, 0.0, 1.0]])
"""Edges (columns) of the regular triangle of edge 1, and of its plane's normal."""
SIMPLICES = ("tetra", "triangle")
"""Shapes that have one corner alone, and shall become regular."""
FLAT = 1e-3
"""A corner whose determinant is a smaller share of the product of its edges' lengths has no shape to keep."""
HANGING = 0.1
"""The same for polyhedra, which have nodes within edges and faces where their neighbours are smaller."""
STEEP = 0.1
"""Sine of the angle at which two planes meet, above which their line is known well enough."""


@dataclass(frozen=True, slots=True, eq=False)
class PatchElements:
    """Tetrahedra at the corners of some cells, and which of their nodes are unknown.

    Attributes
    ----------
    used : (M,) indices in the mesh of all their nodes, the unknown ones first.
    unknown : number U of unknown nodes.
    nodes : (E, 4) rows of `used`.
    targets : (E, 10) inverse of the matrix of the target's edges, row by row, and the weight of the element.
    cells : (E,) to which of the cells each belongs.
    starts, corners : (U + 1,), (K,) the elements at each unknown node: 4 times the element plus its corner.
    """

    used: IntArray = field(repr=False)
    unknown: int
    nodes: IntArray = field(repr=False)
    targets: FloatArray = field(repr=False)
    cells: IntArray = field(repr=False)
    starts: IntArray = field(repr=False)
    corners: IntArray = field(repr=False)

    @classmethod
    def of(cls, tetrahedra: Tetrahedra, unknown: IntArray, points: FloatArray, weights: FloatArray) -> PatchElements:
        """Take the tetrahedra that have one of the `unknown` nodes (U,), with their targets.

        Nodes and elements are ordered along a curve that fills space: neighbours stay together in memory.

        Parameters
        ----------
        points : (N, 3) the mesh before its deflection.
        weights : (C,) of all cells.
        """
        mark = np.zeros(len(points), dtype=np.bool_)
        mark[unknown] = True
        own = np.flatnonzero(mark[tetrahedra.nodes].any(axis=1))
        nodes = tetrahedra.nodes[own]
        mark[nodes] = True
        mark[unknown] = False
        used = np.concatenate([some[along_curve(points[some])] for some in (unknown, np.flatnonzero(mark))])
        place = np.empty(len(points), dtype=np.intp)
        place[used] = np.arange(len(used))
        rows = place[nodes]
        order = np.argsort(rows.min(axis=1), kind="stable")
        rows, own = rows[order], own[order]
        flat = rows.ravel()
        order = np.argsort(flat, kind="stable")
        starts = np.searchsorted(flat[order], np.arange(len(unknown) + 1))
        cells = tetrahedra.cells[own]
        targets = np.column_stack([tetrahedra.inverse(points, own), weights[cells]])
        return cls(used, len(unknown), rows, targets, cells, starts, order[: starts[-1]])


@dataclass(frozen=True, slots=True, eq=False)
class Tetrahedra:
    """The corner tetrahedra of cells.

    Attributes
    ----------
    nodes : (E, 4) node indices in the mesh, right-handed; of a plane cell the first one is the last one, too.
    cells : (E,) row, among all cells given, of the one that each belongs to.
    regular : (E,) which of them shall become regular; a corner of any other cell shall have its own shape again.
    """

    nodes: IntArray = field(repr=False)
    cells: IntArray = field(repr=False)
    regular: BoolArray = field(repr=False)

    @classmethod
    def of(cls, points: FloatArray, parts: Iterable[tuple[Volume, IntArray, float]]) -> Tetrahedra:
        """Cut rows of blocks of cells into the tetrahedra at their corners; corners without a shape are left out.

        Parameters
        ----------
        points : (N, 3) the mesh before its deflection.
        parts : Blocks, their rows, and their orientation (-1: nodes are counted left-handed).
        """
        nodes, cells, regular, count = [], [], [], 0
        for mixed, every, orientation in parts:
            for shape, block, rows, at in parts_of(mixed, every):
                four, own = corners_of(points, block, rows)
                if orientation < 0 and isinstance(block, Cells):
                    four = four[:, [0, 2, 1, 3]]
                if shape not in SIMPLICES:
                    keep = _solidity(points, four) > (HANGING if isinstance(block, Polyhedra) else FLAT)
                    four, own = four[keep], own[keep]
                nodes.append(four)
                cells.append(count + np.arange(len(every))[at][own])
                regular.append(np.full(len(four), shape in SIMPLICES))
            count += len(every)
        return cls(np.concatenate(nodes), np.concatenate(cells), np.concatenate(regular))

    def of_cells(self, mask: BoolArray) -> Tetrahedra:
        """Return those of some of the cells, a mask (C,)."""
        own = mask[self.cells]
        return self if own.all() else Tetrahedra(self.nodes[own], self.cells[own], self.regular[own])

    def inverse(self, points: FloatArray, rows: IntArray) -> FloatArray:
        """Return the inverses (R, 9) of the matrices of the edges (columns) that some rows should have.

        A regular target has the volume that the tetrahedron has at `points` (N, 3), the mesh before its deflection;
        that of a triangle has its area, and the same third edge.
        """
        edges, regular, flat = _edges(points, self.nodes[rows]), self.regular[rows], _in_plane(self.nodes[rows])
        out = np.empty_like(edges)
        for own, target, power in ((regular & ~flat, REGULAR, 3.0), (regular & flat, REGULAR_TRIANGLE, 2.0)):
            size = (np.abs(np.linalg.det(edges[own])) / np.linalg.det(target)) ** (1.0 / power)
            out[own] = np.linalg.inv(target)
            out[own, : int(power)] /= np.where(size > 0.0, size, 1.0)[:, None, None]
        out[~regular] = np.linalg.inv(edges[~regular])
        return out.reshape(-1, 9)


def corners_of(points: FloatArray, block: Volume, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return the nodes (E, 4) of the tetrahedra at the corners of some rows of cells, and the place (E,) of each row.

    A node of a polyhedron is a corner with three of its edges there; with more, each three of them are one.
    """
    if not isinstance(block, Polyhedra):
        corners = block.nodes[rows][:, np.array(CORNERS[block.shape])]
        return corners.reshape(-1, 4), np.repeat(np.arange(len(rows)), corners.shape[1])
    node, end, cell = corner_edges(block, rows)
    order = np.lexsort((end, node, cell))
    node, end, cell = node[order], end[order], cell[order]
    first = np.flatnonzero(np.diff(node, prepend=-1).astype(np.bool_) | np.diff(cell, prepend=-1).astype(np.bool_))
    edges = np.diff(first, append=len(node))
    fours, cells = [np.empty((0, 4), dtype=np.intp)], [np.empty(0, dtype=np.intp)]
    for count in np.unique(edges[edges > 2]):
        own = first[edges == count]
        for three in combinations(range(count), 3):
            fours.append(np.column_stack([node[own], *(end[own + k] for k in three)]))
            cells.append(cell[own])
    four = np.concatenate(fours)
    left = _solidity(points, four) < 0.0
    four[left] = four[left][:, [0, 2, 1, 3]]
    return four, np.concatenate(cells)


def _solidity(points: FloatArray, nodes: IntArray) -> FloatArray:
    """Return the determinant (E,) of the edges of tetrahedra (E, 4) at their first nodes over the edges' lengths."""
    edges = _edges(points, nodes)
    lengths = np.prod(np.linalg.norm(edges, axis=1), axis=1)
    return np.asarray(np.linalg.det(edges) / np.maximum(lengths, np.finfo(np.float64).tiny))


def _edges(points: FloatArray, nodes: IntArray) -> FloatArray:
    """Return the edges (E, 3, 3) of tetrahedra (E, 4) from their first nodes, as columns."""
    edges = points[nodes[:, 1:]] - points[nodes[:, :1]]
    edges[_in_plane(nodes), 2] = 0.0, 0.0, 1.0
    return np.asarray(np.moveaxis(edges, 1, 2))


def _in_plane(nodes: IntArray) -> BoolArray:
    """Return which tetrahedra (E, 4) stand at the corners of plane cells."""
    return np.asarray(nodes[:, 3] == nodes[:, 0])


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Curves through nodes (K,) at rest; a place is known by how far it is from the node along the tangent there.

    Attributes
    ----------
    tangent : (K, 3) unit vectors.
    inward : (K, 3) unit vectors, in the planes of the ellipses, on which these are reached from their tangents; 0 of
        lines.
    radial, along, across : (K, 3) the parts of nodes, tangents and inward vectors that are normal to a cylinder's axis.
    """

    tangent: FloatArray = field(repr=False)
    inward: FloatArray = field(repr=False)
    radial: FloatArray = field(repr=False)
    along: FloatArray = field(repr=False)
    across: FloatArray = field(repr=False)

    @classmethod
    def joined(cls, some: Sequence[Tracks]) -> Tracks:
        """Return one for all the nodes of some others."""
        none = np.empty((0, 3))
        return cls(*(np.concatenate([none, *(getattr(one, name) for one in some)]) for name in cls.__slots__))

    def projected(self, way: FloatArray) -> FloatArray:
        """Return the ways (K, 3) to the places on the curves that are as far along the tangents as ways (K, 3)."""
        far = np.einsum("ij,ij->i", way, self.tangent)
        return np.asarray(far[:, None] * self.tangent + self._aside(far)[:, None] * self.inward)

    def slope(self, way: FloatArray) -> FloatArray:
        """Return the derivatives (K, 3) of the places by how far they are along the tangents."""
        far = np.einsum("ij,ij->i", way, self.tangent)
        radial = self.radial + far[:, None] * self.along + self._aside(far)[:, None] * self.across
        inward = np.einsum("ij,ij->i", radial, self.across)
        aside = -np.einsum("ij,ij->i", radial, self.along) / np.where(inward == 0.0, 1.0, inward)
        return np.asarray(self.tangent + aside[:, None] * self.inward)

    def _aside(self, far: FloatArray) -> FloatArray:
        """Return how far (K,) the curves are from the tangents: the smaller root of a a^2 + 2 b a + c = 0."""
        beside = far[:, None] * self.along
        radial = self.radial + beside
        a, b = (np.einsum("ij,ij->i", one, self.across) for one in (self.across, radial))
        c = np.einsum("ij,ij->i", self.radial + radial, beside)
        sum_of_both = b + np.copysign(np.sqrt(np.maximum(b * b - a * c, 0.0)), b)
        return np.asarray(-c / np.where(sum_of_both == 0.0, np.inf, sum_of_both))


@dataclass(frozen=True, slots=True, eq=False)
class Crossing:
    """The line of two planes, or the ellipse of a plane and a cylinder; each node keeps its distances from both."""

    plane: Plane
    other: Plane | CylinderWall

    @classmethod
    def of(cls, first: SlidingSurface | None, second: SlidingSurface | None) -> Crossing | None:
        """Return where two shapes meet; None if nodes had better stay there."""
        if isinstance(second, Plane) and not isinstance(first, Plane):
            first, second = second, first
        if isinstance(first, Plane) and isinstance(second, Plane):
            steep = np.linalg.norm(np.cross(first.normal, second.normal)) > STEEP
            return cls(first, second) if steep else None
        return cls(first, second) if isinstance(first, Plane) and isinstance(second, CylinderWall) else None

    def tracks(self, points: FloatArray) -> Tracks:
        """Return the curves through points (K, 3)."""
        if isinstance(self.other, Plane):
            along = np.cross(self.plane.normal, self.other.normal)
            tangent = np.tile(along / np.linalg.norm(along), (len(points), 1))
            nothing = np.zeros_like(points)
            return Tracks(tangent, nothing, nothing, nothing, nothing)
        axis = self.other.cylinder.axis
        radial = axis.radial(points)
        tangent = np.cross(self.plane.normal, radial)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        inward = np.cross(self.plane.normal, tangent)
        return Tracks(tangent, inward, radial, *(axis.radial(one + axis.point) for one in (tangent, inward)))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance (N,) from the farther of the two."""
        return np.maximum(np.abs(self.plane.distance(points)), np.abs(self.other.distance(points)))

    def projected(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Go as far along the tangent as the displacement does, and from there, within the plane, to the curve."""
        return self.tracks(points).projected(displacement)

    def rate(self, points: FloatArray, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Go on along the curve as fast as the displacement along the tangent of the node."""
        tracks = self.tracks(points)
        along = np.einsum("ij,ij->i", rate, tracks.tangent)
        return np.asarray(along[:, None] * tracks.slope(displacement))
