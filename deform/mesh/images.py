"""Nodes that move as images of one another: those of periodic pairs, and both sides of a case one cell thick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.mesh.cells import Periodic
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.sliding import Plane

THIN = ("empty", "wedge")
"""Constraints of the patches of plane and axisymmetric cases, which are one cell thick."""
CLOSED = 1e-9
"""Least eigenvalue of what binds a displacement: the square of an angle, of which files with six digits leave 1e-12."""
WHOLE = 1e-12
"""Entries of matrices that are this near to a whole number are that number, so that bits are kept."""
FLAT = 1e-5
"""Of its size: how far the nodes of a side may be off a plane."""


@dataclass(frozen=True, slots=True, eq=False)
class Images:
    """Groups of nodes with one displacement each, which every node of a group has in its own orientation.

    Attributes
    ----------
    nodes : (K,) sorted indices.
    group : (K,) which group each is in, from 0.
    turn : (K, 3, 3) rotation from the group's displacement to that of each node.
    free : (G, 3, 3) projection of a group's displacement onto the directions that it may have.
    """

    nodes: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)
    group: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)
    turn: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)), repr=False)
    free: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)), repr=False)

    @classmethod
    def of(cls, mesh: Mesh, flat: Sequence[str] = ()) -> Images:
        """Join the nodes that are images of one another, in one step or several.

        Where a turn leads a node back to itself, as on an axis, its displacement is along the axis. It is within the
        plane of the node's own side in a case one cell thick, where the file says so by a constraint, and on patches
        that shall stay `flat`.
        """
        flat = (*flat, *(patch.name for patch in mesh.patches if patch.constraint))
        pairs = [pair for pair in mesh.periodic if len(pair.nodes)]
        if not pairs:
            return cls()
        nodes, rows = np.unique(np.concatenate([pair.nodes for pair in pairs]), return_inverse=True)
        ends = np.split(rows.reshape(-1, 2), np.cumsum([len(pair.nodes) for pair in pairs])[:-1])
        group = _groups(np.concatenate(ends), len(nodes))
        sides = list(zip(pairs, ends, strict=True))
        turn = _turns(sides, group)
        bound = np.zeros((int(group.max()) + 1, 3, 3))
        for pair, (one, other) in ((pair, own.T) for pair, own in sides):
            back = np.swapaxes(turn[other], 1, 2) @ pair.rotation @ turn[one] - np.eye(3)
            np.add.at(bound, group[one], np.swapaxes(back, 1, 2) @ back)
            plane = plane_of(mesh, pair.nodes[:, 0])
            if plane and not set(flat).isdisjoint(pair.patches):
                normal = np.einsum("kji,j->ki", turn[one], plane.normal)
                np.add.at(bound, group[one], normal[:, :, None] * normal[:, None, :])
        return cls(nodes, group, _whole(turn), _whole(_free(bound)))

    def projected(self, displacement: FloatArray) -> FloatArray:
        """Return displacements (N, 3) in which all nodes of a group have the mean of theirs, each as it is turned.

        It is an orthogonal projection: so a gradient by the result becomes one by the argument.
        """
        if not len(self.nodes):
            return displacement
        out, own = np.array(displacement), np.einsum("kji,kj->ki", self.turn, displacement[self.nodes])
        count = np.bincount(self.group)
        mean = np.stack([np.bincount(self.group, weights=own[:, i]) / count for i in range(3)], axis=1)
        mean = np.einsum("gij,gj->gi", self.free, mean)
        out[self.nodes] = np.einsum("kij,kj->ki", self.turn, mean[self.group])
        return out

    def complete(self, inside: BoolArray) -> BoolArray:
        """Return which nodes are in a mask (N,), those of groups only with all of their group."""
        out = np.array(inside)
        if len(self.nodes):
            all_in = np.bincount(self.group, weights=~inside[self.nodes]) == 0
            out[self.nodes] &= all_in[self.group]
        return out

    def closed(self, nodes: IntArray, size: int) -> IntArray:
        """Return sorted nodes (L,) with those of their groups; `size` is the number of nodes of the mesh."""
        if not len(self.nodes):
            return nodes
        some = np.zeros(size, dtype=np.bool_)
        some[nodes] = True
        return np.flatnonzero(~self.complete(~some) | some)

    def among(self, nodes: IntArray) -> Images:
        """Return the groups of which all nodes are among distinct ones (M,); their nodes are rows of these."""
        if not len(self.nodes) or not len(nodes):
            return Images()
        row = np.full(max(int(self.nodes[-1]), int(nodes.max())) + 1, -1, dtype=np.intp)
        row[nodes] = np.arange(len(nodes))
        own = self.within(row >= 0)
        order = np.argsort(row[own.nodes])
        return Images(row[own.nodes][order], own.group[order], own.turn[order], own.free)

    def within(self, inside: BoolArray) -> Images:
        """Return the groups of which all nodes are in a mask (N,)."""
        rows = np.flatnonzero(self.complete(inside)[self.nodes]) if len(self.nodes) else self.nodes
        groups, group = np.unique(self.group[rows], return_inverse=True)
        return Images(self.nodes[rows], group.ravel(), self.turn[rows], self.free[groups])


def is_thin(mesh: Mesh, pair: Periodic) -> bool:
    """Whether a pair is the two sides of a plane or axisymmetric case one cell thick."""
    return any(name in mesh.names and mesh.patch(name).constraint in THIN for name in pair.patches)


def plane_of(mesh: Mesh, nodes: IntArray) -> Plane | None:
    """Return the plane, in a plane mesh the line, that all these nodes (K,) are in; None if there is none."""
    points = mesh.points[nodes]
    if len(points) < (2 if mesh.plane else 3):
        return None
    plane = Plane.fitted(points, mesh.plane)
    off = float(np.abs(plane.distance(points)).max())
    return plane if off <= FLAT * float(np.ptp(points, axis=0).max()) else None


def _groups(ends: IntArray, count: int) -> IntArray:
    """Return which group (count,) each of so many nodes is in, given which are images of one another, (P, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # takes a while to load

    graph = coo_array((np.ones(len(ends), dtype=np.bool_), (ends[:, 0], ends[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)


def _free(bound: FloatArray) -> FloatArray:
    """Return the projections (G, 3, 3) on the directions that matrices (G, 3, 3) send to zero."""
    some = np.abs(bound).max(axis=(1, 2)) > CLOSED
    free = np.tile(np.eye(3), (len(bound), 1, 1))
    values, vectors = np.linalg.eigh(bound[some])
    vectors = vectors * (values > CLOSED)[:, None, :]
    free[some] -= vectors @ np.swapaxes(vectors, 1, 2)
    return free


def _turns(sides: Sequence[tuple[Periodic, IntArray]], group: IntArray) -> FloatArray:
    """Return the rotation (K, 3, 3) from the first node of each group to each node, from pair to pair."""
    turn = np.tile(np.eye(3), (len(group), 1, 1))
    known = np.zeros(len(group), dtype=np.bool_)
    known[np.unique(group, return_index=True)[1]] = True
    while not known.all():
        for pair, (one, other) in ((pair, own.T) for pair, own in sides):
            for start, end, rotation in ((one, other, pair.rotation), (other, one, pair.rotation.T)):
                new = known[start] & ~known[end]
                turn[end[new]] = rotation @ turn[start[new]]
                known[end[new]] = True
    return turn


def _whole(values: FloatArray) -> FloatArray:
    """Return numbers of which those that are almost whole are so."""
    near = np.round(values) + 0.0
    return np.asarray(np.where(np.abs(values - near) < WHOLE, near, values))
