"""Corner tetrahedra, by which cells of every shape are repaired, and tracks, along which boundary nodes slide.

A cell has a tetrahedron at each corner, with a target shape. At a corner of a plane cell its third edge is the unit
vector along z, and its last node is stored as its first. A track is the curve on which two surfaces meet.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, along_curve, distinct
from sdm_deflect.meshing.mesh.cells import Cells, Polyhedra, Volume
from sdm_deflect.meshing.mesh.compiled_quality import CORNERS
from sdm_deflect.meshing.mesh.polyhedra import corner_edges
from sdm_deflect.meshing.mesh.sliding import CylinderWall, Plane, SlidingSurface
from sdm_deflect.meshing.mesh.standard import parts_of

# Edges (columns) of the regular tetrahedron of edge 1.
REGULAR = np.array([[1.0, 0.5, 0.5], [0.0, np.sqrt(3.0) / 2.0, np.sqrt(3.0) / 6.0], [0.0, 0.0, np.sqrt(2.0 / 3.0)]])
# Edges (columns) of the regular triangle of edge 1, and the normal of its plane.
REGULAR_TRIANGLE = np.array([[1.0, 0.5, 0.0], [0.0, np.sqrt(3.0) / 2.0, 0.0], [0.0, 0.0, 1.0]])
# Shapes with a single corner, which should become regular.
SIMPLICES = ("tetra", "triangle")
# A corner has no shape if its determinant is a smaller share of the product of its edge lengths.
FLAT = 1e-3
# The same for polyhedra, which have nodes inside edges and faces beside smaller neighbours.
HANGING = 0.1
# Sine of the angle between two planes, above which their line is well determined.
STEEP = 0.1
# Blocks of cells, the rows of some of their cells, and their orientation (-1 for left-handed nodes).
Parts = Iterable[tuple[Volume, IntArray, float]]


@dataclass(frozen=True, slots=True, eq=False)
class RegionElements:
    """Corner tetrahedra of some cells around unknown nodes.

    Attributes
    ----------
    used : (M,) indices in the mesh of all nodes, unknown ones first.
    unknown : number U of unknown nodes.
    nodes : (E, 4) rows of `used`.
    targets : (E, 10) inverse matrix of the target's edges, row by row, and the weight of the element.
    cells : (E,) cell of each element.
    starts, corners : (U + 1,), (K,) corners of elements at each unknown node, as 4 times the element plus the corner.
    """

    used: IntArray = field(repr=False)
    unknown: int
    nodes: IntArray = field(repr=False)
    targets: FloatArray = field(repr=False)
    cells: IntArray = field(repr=False)
    starts: IntArray = field(repr=False)
    corners: IntArray = field(repr=False)

    @classmethod
    def of(cls, tetrahedra: Tetrahedra, unknown: IntArray, points: FloatArray, weights: FloatArray) -> RegionElements:
        """Take the tetrahedra with one of the `unknown` nodes (U,), with their targets.

        Nodes and elements are sorted along a space-filling curve, so that neighbours stay together in memory.

        Parameters
        ----------
        points : (N, 3) undeflected mesh.
        weights : (C,) weights of all cells.
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
    nodes : (E, 4) node indices in the mesh, right-handed; the last one is the first one at a corner of a plane cell.
    cells : (E,) cell of each tetrahedron, as a row of all cells given.
    regular : (E,) whether it should become regular; corners of other cells should recover their own shape.
    """

    nodes: IntArray = field(repr=False)
    cells: IntArray = field(repr=False)
    regular: BoolArray = field(repr=False)

    @classmethod
    def of(cls, points: FloatArray, parts: Parts, wanted: BoolArray | None = None) -> Tetrahedra:
        """Cut cells of blocks into the tetrahedra at their corners, without corners that have no shape.

        Parameters
        ----------
        points : (N, 3) undeflected mesh.
        parts : Blocks, their rows, and their orientation (-1 for left-handed nodes).
        wanted : (C,) cells to cut; by default all.
        """
        nodes, cells, regular, count = [np.empty((0, 4), np.intp)], [np.empty(0, np.intp)], [np.empty(0, np.bool_)], 0
        for mixed, every, orientation in parts:
            some = slice(None) if wanted is None else np.flatnonzero(wanted[count : count + len(every)])
            own_cells = count + np.arange(len(every))[some]
            for shape, block, rows, at in parts_of(mixed, every[some]):
                four, own = corners_of(points, block, rows)
                if orientation < 0 and isinstance(block, Cells):
                    four = four[:, [0, 2, 1, 3]]
                if shape not in SIMPLICES:
                    keep = _solidity(points, four) > (HANGING if isinstance(block, Polyhedra) else FLAT)
                    four, own = four[keep], own[keep]
                nodes.append(four)
                cells.append(own_cells[at][own])
                regular.append(np.full(len(four), shape in SIMPLICES))
            count += len(every)
        return cls(np.concatenate(nodes), np.concatenate(cells), np.concatenate(regular))

    def of_cells(self, mask: BoolArray) -> Tetrahedra:
        """Return the tetrahedra of cells in a mask (C,)."""
        rows = mask[self.cells]
        return self if rows.all() else Tetrahedra(self.nodes[rows], self.cells[rows], self.regular[rows])

    def inverse(self, points: FloatArray, rows: IntArray) -> FloatArray:
        """Return the inverse matrices (R, 9) of the target edges (columns) of some rows.

        A regular target has the tetrahedron's volume in the undeflected mesh `points` (N, 3). A triangle's has its
        area, and z as its third edge.
        """
        edges, regular, flat = _edges(points, self.nodes[rows]), self.regular[rows], _in_plane(self.nodes[rows])
        out = np.empty_like(edges)
        for alike, target, power in ((regular & ~flat, REGULAR, 3.0), (regular & flat, REGULAR_TRIANGLE, 2.0)):
            size = (np.abs(np.linalg.det(edges[alike])) / np.linalg.det(target)) ** (1.0 / power)
            out[alike] = np.linalg.inv(target)
            out[alike, : int(power)] /= np.where(size > 0.0, size, 1.0)[:, None, None]
        out[~regular] = np.linalg.inv(edges[~regular])
        return out.reshape(-1, 9)


class CellCorners:
    """The corner tetrahedra of the cells of a repair, cut when a region needs them.

    Most repairs need a small part of the cells. If half of them are needed, all are cut, once.

    Parameters
    ----------
    points : (N, 3) undeflected mesh.
    parts : Blocks, their rows, and their orientation (-1 for left-handed nodes).
    repaired : (C,) the cells that take part.
    """

    def __init__(self, points: FloatArray, parts: Parts, repaired: BoolArray) -> None:
        from scipy.sparse import coo_array  # loading takes a while

        self._points, self._parts, self._repaired = points, list(parts), repaired
        cells, nodes, count = [np.empty(0, np.int32)], [np.empty(0, np.int32)], 0
        for block, rows, _ in self._parts:
            own, node = _incidences(block, rows)
            cells.append((count + own).astype(np.int32))
            nodes.append(node.astype(np.int32))
            count += len(rows)
        pairs = np.concatenate(cells), np.concatenate(nodes)
        incidence = coo_array((np.ones(len(pairs[0]), np.int8), pairs), shape=(count, len(points)))
        self._nodes_of, self._cells_at = incidence.tocsr(), incidence.T.tocsr()
        self._cut, self._made = np.zeros(count, np.bool_), Tetrahedra.of(points, [])

    def of_cells(self, cells: BoolArray) -> Tetrahedra:
        """Return the tetrahedra of those cells in a mask (C,) that take part."""
        if (cells & ~self._cut).any():
            self._cut |= cells
            if 2 * np.count_nonzero(self._cut) > len(self._cut):
                self._cut[:] = True
            self._made = Tetrahedra.of(self._points, self._parts, self._cut & self._repaired)
        return self._made.of_cells(cells)

    def at_nodes(self, nodes: IntArray) -> Tetrahedra:
        """Return the tetrahedra of the cells that touch any of the nodes (K,)."""
        mask = np.zeros(len(self._cut), np.bool_)
        mask[self._cells_at[nodes].indices] = True
        return self.of_cells(mask)

    def around(self, spoiled: BoolArray, movable: BoolArray, rings: int) -> IntArray:
        """Return the sorted movable nodes (U,) within `rings` rings of tetrahedra around spoiled cells.

        Parameters
        ----------
        spoiled, movable : (C,), (N,) masks of the spoiled cells and of the movable nodes.
        """
        if rings >= len(movable):
            return np.flatnonzero(movable)
        tetrahedra = self.of_cells(self._neighbours(spoiled, rings))
        near = np.zeros(len(movable), dtype=np.bool_)
        near[tetrahedra.nodes[spoiled[tetrahedra.cells]]] = True
        for _ in range(rings - 1):
            near[tetrahedra.nodes[near[tetrahedra.nodes].any(axis=1)]] = True
        return np.flatnonzero(near & movable)

    def _neighbours(self, cells: BoolArray, rings: int) -> BoolArray:
        """Return the mask (C,) of cells within `rings` rings of some cells (C,); neighbours share a node."""
        mask, outer = cells.copy(), np.flatnonzero(cells)
        for _ in range(rings - 1):
            nodes = distinct(self._nodes_of[outer].indices)
            touched = self._cells_at[nodes].indices
            outer = distinct(touched[~mask[touched]])
            mask[outer] = True
        return mask


def _incidences(block: Volume, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return the place among `rows` of a cell, and a node of it, for each pair of them (K,)."""
    if isinstance(block, Polyhedra):
        node, _, cell = corner_edges(block, rows)
        return cell, node
    nodes = block.nodes[rows]
    return np.repeat(np.arange(len(rows)), nodes.shape[1]), nodes.ravel()


def corners_of(points: FloatArray, block: Volume, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return the nodes (E, 4) of the tetrahedra at the corners of rows of cells, and the place (E,) of each row.

    A polyhedron has one corner at a node with three edges; with more edges, each three are a corner.
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
        nodes_at = first[edges == count]
        for three in combinations(range(count), 3):
            fours.append(np.column_stack([node[nodes_at], *(end[nodes_at + k] for k in three)]))
            cells.append(cell[nodes_at])
    four = np.concatenate(fours)
    left = _solidity(points, four) < 0.0
    four[left] = four[left][:, [0, 2, 1, 3]]
    return four, np.concatenate(cells)


def _solidity(points: FloatArray, nodes: IntArray) -> FloatArray:
    """Return the determinant (E,) of unit vectors along the edges at the first nodes of tetrahedra (E, 4)."""
    edges = _edges(points, nodes)
    lengths = np.prod(np.linalg.norm(edges, axis=1), axis=1)
    return np.asarray(np.linalg.det(edges) / np.maximum(lengths, np.finfo(np.float64).tiny))


def _edges(points: FloatArray, nodes: IntArray) -> FloatArray:
    """Return the edges (E, 3, 3) from the first nodes of tetrahedra (E, 4), as columns."""
    edges = points[nodes[:, 1:]] - points[nodes[:, :1]]
    edges[_in_plane(nodes), 2] = 0.0, 0.0, 1.0
    return np.asarray(np.moveaxis(edges, 1, 2))


def _in_plane(nodes: IntArray) -> BoolArray:
    return np.asarray(nodes[:, 3] == nodes[:, 0])


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Curves through nodes (K,) at rest; a place on a curve is given by its distance along the node's tangent.

    Attributes
    ----------
    tangent : (K, 3) unit vectors.
    inward : (K, 3) unit vectors in the ellipses' planes, from the tangents to the curves; 0 for lines.
    radial, along, across : (K, 3) components of nodes, tangents and inward vectors normal to a cylinder's axis.
    """

    tangent: FloatArray = field(repr=False)
    inward: FloatArray = field(repr=False)
    radial: FloatArray = field(repr=False)
    along: FloatArray = field(repr=False)
    across: FloatArray = field(repr=False)

    @classmethod
    def joined(cls, some: Sequence[Tracks]) -> Tracks:
        """Join the curves of several sets of nodes."""
        none = np.empty((0, 3))
        return cls(*(np.concatenate([none, *(getattr(tracks, name) for tracks in some)]) for name in cls.__slots__))

    def projected(self, way: FloatArray) -> FloatArray:
        """Return displacements (K, 3) along the curves with the tangential components of `way` (K, 3)."""
        far = np.einsum("ij,ij->i", way, self.tangent)
        return np.asarray(far[:, None] * self.tangent + self._aside(far)[:, None] * self.inward)

    def slope(self, way: FloatArray) -> FloatArray:
        """Return the derivatives (K, 3) of the places by their distances along the tangents."""
        far = np.einsum("ij,ij->i", way, self.tangent)
        radial = self.radial + far[:, None] * self.along + self._aside(far)[:, None] * self.across
        inward = np.einsum("ij,ij->i", radial, self.across)
        aside = -np.einsum("ij,ij->i", radial, self.along) / np.where(inward == 0.0, 1.0, inward)
        return np.asarray(self.tangent + aside[:, None] * self.inward)

    def _aside(self, far: FloatArray) -> FloatArray:
        """Return the distances (K,) from tangents to curves: the smaller root of a a^2 + 2 b a + c = 0."""
        beside = far[:, None] * self.along
        radial = self.radial + beside
        a, b = (np.einsum("ij,ij->i", vectors, self.across) for vectors in (self.across, radial))
        c = np.einsum("ij,ij->i", self.radial + radial, beside)
        sum_of_both = b + np.copysign(np.sqrt(np.maximum(b * b - a * c, 0.0)), b)
        return np.asarray(-c / np.where(sum_of_both == 0.0, np.inf, sum_of_both))


@dataclass(frozen=True, slots=True, eq=False)
class IntersectionCurve:
    """The curve of two shapes: a line of two planes, or an ellipse of a plane and a cylinder.

    Each node keeps its distances from both shapes.
    """

    plane: Plane
    other: Plane | CylinderWall

    @classmethod
    def of(cls, first: SlidingSurface | None, second: SlidingSurface | None) -> IntersectionCurve | None:
        """Return the curve of two shapes; None if it is badly determined, and nodes stay there."""
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
        return Tracks(tangent, inward, radial, *(axis.radial(vectors + axis.point) for vectors in (tangent, inward)))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance (N,) from the farther shape."""
        return np.maximum(np.abs(self.plane.distance(points)), np.abs(self.other.distance(points)))

    def projected(self, points: FloatArray, displacement: FloatArray) -> FloatArray:
        """Go along the tangent like the displacement, then within the plane to the curve."""
        return self.tracks(points).projected(displacement)

    def rate(self, points: FloatArray, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the derivative (N, 3) of `projected`."""
        tracks = self.tracks(points)
        along = np.einsum("ij,ij->i", rate, tracks.tangent)
        return np.asarray(along[:, None] * tracks.slope(displacement))
