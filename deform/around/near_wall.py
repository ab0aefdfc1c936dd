"""Near a wall the mesh follows the wall's nodes and turns with them, so that prism layers keep their heights.

The interpolant is smooth, but it is not rigid beside a thin surface. At boundary nodes that are no centres it has
errors up to the tolerance. Two corrections help. First, some mesh nodes beside a moving surface become data sites, the
*layer sites*. Their displacement carries them rigidly with the nearest boundary node x_j: p becomes x_j + u_j + R_j (p
- x_j), where R_j is the local rotation of the surface. Second, every node p near a wall moves to

    p + u(p) + psi (v(p) - u(p)),    v(p) = sum of w_j (u_j + (R_j - 1)(p - x_j)),

Here u is the interpolant, and v the mean of the rigid motions of the boundary nodes around (Luke, Collins and Blades,
J. Comput. Phys. 231, 2012). With d the distance from the wall and r = d / L, the weight is

    psi = min(1, c / (1 - c) (1 / r - 1)).

Up to r = c the mesh is rigid: there layers keep their heights and stay upright. From there psi d falls linearly to zero
at r = 1; no other weight with such a rigid part shears the mesh less. L is the reach, about one edge of the surface, or
the distance of another part of the boundary, which may move differently: in the middle of a gap only the interpolant
acts. The share c is `RIGID`. Beside a wall node whose measured layers reach farther it is what these need, up to
`MOST_RIGID`: two walls then share the gap in three equal parts, and the middle one alone deforms.

With p = `POWER`, the share w_j of a node at distance d is (1 / d - 1 / D)**p, where D is the distance of the nearest
node that is left out (Franke and Nielson, Int. J. Numer. Meth. Eng. 15, 1980). So v does not jump where the set of
nodes changes; a jump would invert the flat cells of a wake.

Layer sites stand only where the motion shears the surface, as in a blended strip: there the columns of a
layer turn by different angles. Where the surface turns rigidly, the interpolant bends the mesh in a narrow slot less
without them. `benchmarks/layers.md` has the figures.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, union
from sdm_deflect.base.compiled import compiled_exactly
from sdm_deflect.base.ties import clearly_less
from sdm_deflect.deform.rbf.data_sites import DataSites

from .local_rotation import LocalRotation, RotationRates
from .modifier import Linearized, Modifier, ModifierAtStep

# Share of the reach up to which nodes follow the wall rigidly. It keeps five layers of a slotted airfoil upright at no
# loss; ten upright layers, by .1 of eight edges, cost .03 to .05 of the least quality.
RIGID = 0.2
# Largest such share, where measured layers need more. In a gap a third is then left for the cells between two stacks.
MOST_RIGID = 0.5
# Least and largest distance of layer sites, in edges of the surface. Structured wings are alike from .4 to .5, and
# worse below; a coarse wing, whose strip is two cells wide, has fewest inverted cells at .41.
NEAR, FAR = 0.08, 0.41
# A layer site is nearer to its part of the boundary than this share of its distance to any other part.
ALONE = 0.5
# Largest number of layer sites; larger sets are thinned.
MOST_LAYER_SITES = 30_000
# Number of boundary nodes that carry a point, and the power of their weights.
AROUND, POWER = 32, 5
# Least distance in a weight; a power of two, so that a point on a node moves exactly with it.
LEAST = 2.0**-100
# A weight is zero at this multiple of the distance to the first node that is left out.
BEYOND = 1.001


class Nearby(NamedTuple):
    """For each of M points: the nearest boundary node, its distance, and the distance of the nearest other part."""

    node: IntArray
    first: FloatArray
    second: FloatArray

    @classmethod
    def of(cls, points: FloatArray, boundary: FloatArray, parts: Sequence[IntArray]) -> "Nearby":
        """Search boundary nodes (K, 3); `parts` are the rows of each part that may move differently from the others."""
        first, second = np.full(len(points), np.inf), np.full(len(points), np.inf)
        node = np.zeros(len(points), dtype=np.intp)
        for part in parts:
            if len(part):
                distance, nearest = cKDTree(boundary[part]).query(points)
                closer = distance < first
                second = np.where(closer, first, np.minimum(second, distance))
                node[closer], first[closer] = part[nearest[closer]], distance[closer]
        return cls(node, first, second)

    def needed(self, stacked: BoolArray, reach: float) -> FloatArray:
        """Return the shares (K,) of the limits up to which layers reach; `stacked` (M,) are points of layers."""
        return self.first[stacked] / self.limits(reach)[stacked]

    def limits(self, reach: float) -> FloatArray:
        """Return the distances (M,) up to which points follow a wall: the reach, or less before another part."""
        return np.minimum(reach, self.second)

    def rigid(self, stacked: BoolArray, reach: float) -> FloatArray:
        """Return the shares (M,) of the limits up to which the mesh is rigid: `RIGID`, or what layers need.

        `stacked` (M,) are the points of layers; those over a wall node determine the share beside it.
        """
        shares = np.full(self.node.max(initial=0) + 1, RIGID)
        np.maximum.at(shares, self.node[stacked], np.minimum(self.needed(stacked, reach), MOST_RIGID))
        return np.asarray(shares[self.node])


@dataclass(frozen=True, slots=True, eq=False)
class RigidFollow:
    """Points that move rigidly with boundary nodes.

    Attributes
    ----------
    rows : (Q,) rows of the points.
    places : (Q, 3) the points.
    boundary : (K, 3) the boundary nodes.
    nodes : (Q, A) rows of the boundary nodes that carry each point, nearest first.
    ends : (Q,) distance at which a node's weight is zero; infinite if no node is left out.
    """

    rows: IntArray = field(repr=False)
    places: FloatArray = field(repr=False)
    boundary: FloatArray = field(repr=False)
    nodes: IntArray = field(repr=False)
    ends: FloatArray = field(repr=False)

    @classmethod
    def of(cls, points: FloatArray, boundary: FloatArray, rows: IntArray, nearby: Nearby) -> "RigidFollow":
        """Let each of the given rows of points follow its nearest boundary node alone."""
        nodes: IntArray = nearby.node[rows, None].astype(np.int32)
        return cls(rows, points[rows], boundary, nodes, np.full(len(rows), np.inf))

    @classmethod
    def around(cls, points: FloatArray, boundary: FloatArray, rows: IntArray, known: IntArray) -> "RigidFollow":
        """Let each of the given rows of points follow the boundary nodes around, taken from `known`."""
        count = min(AROUND, len(known))
        nodes: IntArray = np.empty((len(rows), count), np.int32)
        ends: FloatArray = np.full(len(rows), np.inf)
        if nodes.size:
            tree, neighbours = cKDTree(boundary[known]), list(range(1, count + 2))
            distance, nearest = tree.query(
                points[rows], k=neighbours, workers=-1
            )  # distances are infinite where there are fewer nodes
            nodes[:], ends = known[nearest[:, :count]], BEYOND * distance[:, count]
        return cls(rows, points[rows], boundary, nodes, ends)

    def displacement(self, boundary: FloatArray, turns: FloatArray) -> FloatArray:
        """Return the displacements (Q, 3), given the boundary's displacements (K, 3) and rotations R - 1 (K, 3, 3)."""
        motions = np.concatenate([boundary[:, :, None], turns], axis=2)
        return _carried(self.places, self.boundary, self.nodes, self.ends, motions)

    def reverse(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the gradients by the boundary's displacements (K, 3) and rotations (K, 3, 3), given (Q, 3)."""
        motions = _carried_reverse(self.places, self.boundary, self.nodes, self.ends, gradient)
        return np.ascontiguousarray(motions[:, :, 0]), motions[:, :, 1:]


@compiled_exactly
def _carried(
    places: FloatArray, known: FloatArray, nodes: IntArray, ends: FloatArray, motions: FloatArray
) -> FloatArray:
    """Return the weighted means (Q, 3) of rigid motions (K, 3, 4) of boundary nodes: u_j beside R_j - 1."""
    out, offset = np.zeros((len(places), 3)), np.zeros(3)
    for q in range(len(places)):
        total = 0.0
        for a in range(nodes.shape[1]):
            j, square = nodes[q, a], 0.0
            for i in range(3):
                offset[i] = places[q, i] - known[j, i]
                square += offset[i] * offset[i]
            share = (1.0 / max(square**0.5, LEAST) - 1.0 / ends[q]) ** POWER
            total += share
            for i in range(3):
                carried = motions[j, i, 0]
                for k in range(3):
                    carried += motions[j, i, k + 1] * offset[k]
                out[q, i] += share * carried
        for i in range(3):
            out[q, i] /= total
    return out


@compiled_exactly
def _carried_reverse(
    places: FloatArray, known: FloatArray, nodes: IntArray, ends: FloatArray, gradient: FloatArray
) -> FloatArray:
    """Return the gradient (K, 3, 4) by the motions of `_carried`, given that by its result (Q, 3)."""
    out, shares = np.zeros((len(known), 3, 4)), np.zeros(nodes.shape[1])
    for q in range(len(places)):
        total = 0.0
        for a in range(nodes.shape[1]):
            square = 0.0
            for i in range(3):
                square += (places[q, i] - known[nodes[q, a], i]) ** 2
            shares[a] = (1.0 / max(square**0.5, LEAST) - 1.0 / ends[q]) ** POWER
            total += shares[a]
        for a in range(nodes.shape[1]):
            j = nodes[q, a]
            for i in range(3):
                part = shares[a] / total * gradient[q, i]
                out[j, i, 0] += part
                for k in range(3):
                    out[j, i, k + 1] += part * (places[q, k] - known[j, k])
    return out


def layer_sites(nearby: Nearby, nodes: IntArray, edge: float) -> IntArray:
    """Return the rows of points that become data sites: for each node the first of the farthest ones allowed.

    Parameters
    ----------
    nearby : Boundary nodes nearest to the points.
    nodes : Rows of the boundary nodes that have layer sites.
    edge : Length of an edge of the surface.
    """
    node, first = nearby.node, nearby.first
    good = np.isin(node, nodes) & clearly_less(NEAR * edge, first) & clearly_less(first, FAR * edge)
    rows = np.flatnonzero(good & clearly_less(first, ALONE * nearby.second))
    farthest = np.zeros(node.max(initial=0) + 1)
    np.maximum.at(farthest, node[rows], first[rows])
    rows = rows[~clearly_less(first[rows], farthest[node[rows]])]
    _, one_each = np.unique(node[rows], return_index=True)
    return np.asarray(rows[one_each][:: max(1, -(-len(one_each) // MOST_LAYER_SITES))])


@dataclass(frozen=True, slots=True, eq=False)
class NearWall:
    """Points near a wall, and how closely they follow it.

    Attributes
    ----------
    follow : the points.
    weight : (Q,) psi.
    """

    follow: RigidFollow
    weight: FloatArray = field(repr=False)

    @classmethod
    def of(
        cls, points: FloatArray, boundary: FloatArray, nearby: Nearby, parts: Sequence[IntArray], stacked: BoolArray,
        reach: float,
    ) -> "NearWall":  # fmt: skip
        """Take the points within `reach` of boundary nodes (K, 3) that are nearer to one part than to any other.

        `stacked` (M,) are the points of layers (`Nearby.rigid`).
        """
        limit = nearby.limits(reach)
        rows = np.flatnonzero(nearby.first < limit)
        share = nearby.rigid(stacked, reach)[rows]
        r = np.maximum(nearby.first[rows] / limit[rows], share)
        weight = np.minimum(share / (1.0 - share) * (1.0 / r - 1.0), 1.0)
        return cls(RigidFollow.around(points, boundary, rows, union(*parts)), weight)

    def following(self, displacement: FloatArray, boundary: FloatArray, turns: FloatArray) -> FloatArray:
        """Return the displacement (M, 3) of points, given the boundary's displacement (K, 3) and rotations R - 1."""
        out, rows = np.array(displacement), self.follow.rows
        out[rows] += self.weight[:, None] * (self.follow.displacement(boundary, turns) - out[rows])
        return out


@dataclass(frozen=True, slots=True, eq=False)
class FollowWalls(Modifier):
    """Nodes near walls follow them.

    Attributes
    ----------
    known : (B,) known nodes; the first `certain` move or stay, the others are bound.
    certain : number of these.
    parts : rows of `known` for each part that may move differently.
    edges : (E, 2) rows of `known` that an edge of the boundary joins.
    sheared : rows of `known` beside which the motion shears the surface.
    stacks : sorted nodes of the measured layers.
    edge, reach : lengths: an edge of the surface, and up to where nodes follow walls if there is room.
    normal : (3,) normal of a plane mesh.
    components : directions in which nodes move.
    """

    known: IntArray = field(repr=False)
    certain: int
    parts: tuple[IntArray, ...] = field(repr=False)
    edges: IntArray = field(repr=False)
    sheared: IntArray = field(repr=False)
    stacks: IntArray = field(repr=False)
    edge: float
    reach: float
    normal: FloatArray | None
    components: tuple[int, ...]

    def at(self, points: FloatArray, free: IntArray) -> "FollowingWalls":
        known, places = points[self.known], points[free]
        nearby = Nearby.of(places, known, self.parts)
        layers = RigidFollow.of(places, known, layer_sites(nearby, self.sheared, self.edge), nearby)
        near = NearWall.of(places, known, nearby, self.parts, np.isin(free, self.stacks), self.reach)
        late, parts = self.known[self.certain :], [part[part < self.certain] for part in self.parts]
        on_late = Nearby.of(points[late], known, parts)
        bound = NearWall.of(points[late], known, on_late, parts, np.isin(late, self.stacks), self.reach)
        turning = LocalRotation.of(known, self.edges, self.certain, self.normal)
        return FollowingWalls(self.components, self.reach, layers, bound, near, turning)


@dataclass(frozen=True, slots=True, eq=False)
class FollowingWalls(ModifierAtStep):
    """Nodes near walls in one step.

    Attributes
    ----------
    components : directions in which nodes move.
    reach : distance up to which nodes follow walls.
    layers : layer sites among the free nodes.
    bound, free : points that follow walls, among the bound nodes and among the free nodes.
    turning : local rotation of the boundary nodes.
    """

    components: tuple[int, ...]
    reach: float
    layers: RigidFollow = field(repr=False)
    bound: NearWall = field(repr=False)
    free: NearWall = field(repr=False)
    turning: LocalRotation = field(repr=False)

    def sites(self, known: FloatArray, last: bool) -> Sequence[DataSites]:
        """Return the layer sites; they follow moving and fixed nodes alone, so both passes have the same."""
        del last
        if not len(self.layers.places):
            return ()
        values = self.layers.displacement(known, self.turning.rotations(known))
        return (DataSites(self.layers.places, values[:, self.components], self.components),)

    def correct(self, u: FloatArray, known: FloatArray, last: bool) -> FloatArray:
        """Let nodes near walls follow them."""
        return (self.free if last else self.bound).following(u, known, self.turning.rotations(known))

    def linearized(self, u: FloatArray, known: FloatArray, last: bool) -> "FollowingRates":
        del u
        return FollowingRates(self, self.free if last else self.bound, self.turning.linearized(known))


@dataclass(frozen=True, slots=True, eq=False)
class FollowingRates(Linearized):
    """The derivative of nodes that follow walls.

    Attributes
    ----------
    of : the nodes near walls.
    near : those of one pass.
    turning : the derivative of the boundary's local rotation.
    """

    of: FollowingWalls = field(repr=False)
    near: NearWall = field(repr=False)
    turning: RotationRates = field(repr=False)

    def sites(self, known: FloatArray) -> Sequence[DataSites]:
        """Return the layer sites with their rates."""
        if not len(self.of.layers.places):
            return ()
        values = self.of.layers.displacement(known, self.turning.forward(known))
        return (DataSites(self.of.layers.places, values[:, self.of.components], self.of.components),)

    def sites_reverse(self, gradient: FloatArray) -> FloatArray:
        """Hand the gradient at layer sites to the boundary nodes that carry them."""
        known, turns = self.of.layers.reverse(gradient)
        return known + self.turning.reverse(turns)

    def forward(self, rate: FloatArray, known: FloatArray) -> FloatArray:
        """Let rates near walls follow those of the walls: the correction is linear in them."""
        return self.near.following(rate, known, self.turning.forward(known))

    def reverse(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray | float]:
        """Hand the share of the gradient that walls carry to their nodes and rotations."""
        out, rows = np.array(gradient), self.near.follow.rows
        carried = self.near.weight[:, None] * out[rows]
        out[rows] -= carried
        known, turns = self.near.follow.reverse(carried)
        return out, known + self.turning.reverse(turns)
