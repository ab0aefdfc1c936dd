"""Near a boundary the mesh follows the boundary nodes around, and turns with them: prism layers keep their heights.

The interpolant is smooth across a thin surface, but nothing makes it rigid beside one, and at boundary nodes that are
no centres it is off by up to the tolerance. Two things mend that. Some mesh nodes beside a moving surface, the
*layer sites*, become data sites that go where their node x_j carries them, x_j + u_j + R_j (p - x_j), R_j being the
surface's local rotation: the field then turns with the surface. And every node p close to a boundary is moved to

    p + u(p) + psi (v(p) - u(p)),    v(p) = sum of w_j (u_j + (R_j - 1)(p - x_j)),

with u the interpolant, v the mean of the rigid motions of the boundary nodes around (Luke, Collins and Blades, J.
Comput. Phys. 231, 2012), and a weight psi that fades out away from the boundary, and where another one that may move
otherwise comes as near: in the middle of a gap the interpolant is alone. The share w_j of a node at distance d is
(1 / d - 1 / D)**`POWER`, D being the distance of the nearest node that is left out (Franke and Nielson, Int. J. Numer.
Meth. Eng. 15, 1980): v does not jump where the nodes around change, which would invert the flat cells of a wake.

Both are corrections of what the interpolant misses, and reach no farther than that asks for (`Reach`): where they end,
they shear the mesh. Layer sites stand beside nodes where the motion shears the surface, as a blended strip does: there
the layers must turn otherwise from column to column. Where the surface turns rigidly, thin plate splines without them
bend the mesh less in a narrow slot. `benchmarks/layers.md` has the figures, also for the constants.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.base.arrays import FloatArray, IntArray, union
from sdm_deflect.deform.base.compiled import compiled_exactly
from sdm_deflect.deform.rbf.problem import DataSites

from .addition import Acting, Addition
from .local_rotation import LocalRotation

NEAR = 0.2  # of the distance up to which there are layer sites: none is nearer
FAR = 0.05, 0.5  # edges of the surface: that distance is between these, so only meshes with layers have any
COARSE = 5.0  # times the edge over the surface's size: that distance, in edges
LAYERS = 8.0  # first heights: that distance, at least
ALONE = 0.5  # of the distance to another part of the boundary: layer sites are nearer to their own
MOST_LAYER_SITES = 30_000  # layer sites
AROUND, POWER = 32, 5  # boundary nodes whose mean a point follows, and the power of their weights
LEAST = 2.0**-100  # distance; a power of two, so that a point on a node goes with it to the bit
BEYOND = 1.001  # times the distance of the next node: where the weight of a node is zero
FADE = 4.0  # times that distance: where the mesh no longer follows
ERRORS = 10.0  # tolerances, at least: an error of one that fades shears the mesh by no more than some tenth
KEPT = 0.005  # largest change of the first height, as a share, by an error of the tolerance that fades


class Nearby(NamedTuple):
    """For each of M points: the nearest boundary node, its distance, and the distance of the next part."""

    node: IntArray
    first: FloatArray
    second: FloatArray

    @classmethod
    def of(cls, points: FloatArray, boundary: FloatArray, parts: Sequence[IntArray]) -> "Nearby":
        """Look among boundary nodes (K, 3); `parts` are rows of those that may move differently, each in one part."""
        first, second = np.full(len(points), np.inf), np.full(len(points), np.inf)
        node = np.zeros(len(points), dtype=np.intp)
        for part in parts:
            if len(part):
                distance, nearest = cKDTree(boundary[part]).query(points)
                closer = distance < first
                second = np.where(closer, first, np.minimum(second, distance))
                node[closer], first[closer] = part[nearest[closer]], distance[closer]
        return cls(node, first, second)


@dataclass(frozen=True, slots=True, eq=False)
class RigidFollow:
    """Points that boundary nodes carry along.

    Attributes
    ----------
    rows : (Q,) rows of the points.
    places : (Q, 3) the points.
    boundary : (K, 3) the boundary nodes.
    nodes : (Q, A) rows of the boundary nodes that carry each point, the nearest first.
    ends : (Q,) distance at which the weight of a node is zero; infinite where no node is left out.
    """

    rows: IntArray = field(repr=False)
    places: FloatArray = field(repr=False)
    boundary: FloatArray = field(repr=False)
    nodes: IntArray = field(repr=False)
    ends: FloatArray = field(repr=False)

    @classmethod
    def of(cls, points: FloatArray, boundary: FloatArray, rows: IntArray, nearby: Nearby) -> "RigidFollow":
        """Let the nearest boundary node alone carry each of some rows of the points."""
        nodes: IntArray = nearby.node[rows, None].astype(np.int32)
        return cls(rows, points[rows], boundary, nodes, np.full(len(rows), np.inf))

    @classmethod
    def around(cls, points: FloatArray, boundary: FloatArray, rows: IntArray, known: IntArray) -> "RigidFollow":
        """Let the nearest of the boundary nodes `known` carry each of some rows of the points, by inverse distance."""
        count = min(AROUND, len(known))
        nodes: IntArray = np.empty((len(rows), count), np.int32)
        ends: FloatArray = np.full(len(rows), np.inf)
        if nodes.size:
            tree, neighbours = cKDTree(boundary[known]), list(range(1, count + 2))
            distance, nearest = tree.query(points[rows], k=neighbours, workers=-1)  # infinite beyond all nodes
            nodes[:], ends = known[nearest[:, :count]], BEYOND * distance[:, count]
        return cls(rows, points[rows], boundary, nodes, ends)

    def displaced(self, boundary: FloatArray, turns: FloatArray) -> FloatArray:
        """Return the displacements (Q, 3) for those (K, 3) of the boundary, turned by R - 1 (K, 3, 3)."""
        motions = np.concatenate([boundary[:, :, None], turns], axis=2)
        return _carried(self.places, self.boundary, self.nodes, self.ends, motions)


@compiled_exactly
def _carried(
    places: FloatArray, known: FloatArray, nodes: IntArray, ends: FloatArray, motions: FloatArray
) -> FloatArray:
    """Return the weighted means (Q, 3) of the rigid motions (K, 3, 4) of boundary nodes: u_j, and R_j - 1."""
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


def first_height(nearby: Nearby, count: int) -> float:
    """Return the median distance of the first of `count` boundary nodes from the point nearest to each; inf without."""
    least: FloatArray = np.full(count, np.inf)
    of_these = nearby.node < count
    np.minimum.at(least, nearby.node[of_these], nearby.first[of_these])
    least = least[np.isfinite(least) & (least > 0.0)]
    return float(np.median(least)) if len(least) else np.inf


class Reach(NamedTuple):
    """Distances from a boundary within which its own motion is better than the interpolant.

    Attributes
    ----------
    sites : up to there layer sites are.
    follow : up to there the mesh follows; 0: nowhere.
    """

    sites: float
    follow: float

    @classmethod
    def of(cls, height: float, edge: float, size: float, tolerance: float) -> "Reach":
        """Take a surface of some size with median edges and a first layer of some height.

        Between nodes the interpolant is off by an amount that grows with the square of the edge over the size: that is
        how far layer sites are. An error of the tolerance t fades over at least `ERRORS` t, and changes the height h by
        at most `KEPT` h: psi is 1 - 10 (h / L)**2 there, hence L**2 = 10 h t / `KEPT`. Nothing reaches farther than an
        edge.
        """
        low, high = (share * edge for share in FAR)
        sites = min(high, max(low, COARSE * edge**2 / max(size, edge), LAYERS * height))
        least = max(ERRORS * tolerance, (10.0 * height * tolerance / KEPT) ** 0.5)
        return cls(sites, min(edge, max(FADE * sites, least)))


def layer_sites(nearby: Nearby, nodes: IntArray, far: float) -> IntArray:
    """Return rows of the points that become data sites: the farthest allowed one for each of some nodes.

    Parameters
    ----------
    nearby : Of the points.
    nodes : Rows of the boundary nodes that have layer sites.
    far : Largest distance of a layer site.
    """
    first = nearby.first
    good = np.isin(nearby.node, nodes) & (first > NEAR * far) & (first < far) & (first < ALONE * nearby.second)
    rows = np.flatnonzero(good)
    rows = rows[np.lexsort((-first[rows], nearby.node[rows]))]
    _, own = np.unique(nearby.node[rows], return_index=True)
    return rows[own][:: max(1, -(-len(own) // MOST_LAYER_SITES))]


@dataclass(frozen=True, slots=True, eq=False)
class NearWall:
    """Points near a boundary, and how far they follow it.

    Attributes
    ----------
    follow : those points.
    weight : (Q,) psi(r) = (1 - r)**4 (4 r + 1) of Wendland: 1 at the boundary, with no slope there.
    """

    follow: RigidFollow
    weight: FloatArray = field(repr=False)

    @classmethod
    def of(
        cls, points: FloatArray, boundary: FloatArray, nearby: Nearby, parts: Sequence[IntArray], reach: float
    ) -> "NearWall":
        """Take the points within `reach` of boundary nodes (K, 3) of the parts, and nearer to one than to another."""
        limit = np.minimum(reach, nearby.second)
        rows = np.flatnonzero(nearby.first < limit)
        r = nearby.first[rows] / limit[rows]
        return cls(RigidFollow.around(points, boundary, rows, union(*parts)), (1.0 - r) ** 4 * (4.0 * r + 1.0))

    def following(self, displacement: FloatArray, boundary: FloatArray, turns: FloatArray) -> FloatArray:
        """Return the displacement (M, 3) of points that follow a boundary displaced by (K, 3), turned by R - 1."""
        out, rows = np.array(displacement), self.follow.rows
        out[rows] += self.weight[:, None] * (self.follow.displaced(boundary, turns) - out[rows])
        return out


@dataclass(frozen=True, slots=True, eq=False)
class FollowWalls(Addition):
    """The mesh near walls follows them.

    Attributes
    ----------
    known : (B,) nodes of known displacement, the first `certain` of which move or stay; the others follow.
    certain : number of these.
    parts : rows of `known` that may move differently, each in one part.
    surfaces : nodes of each moving surface.
    edges : (E, 2) rows of `known` that an edge of the boundary joins.
    sheared : rows of `known` beside which the motion is not rigid.
    edge, tolerance : lengths: of the surfaces' median edge, and of a site's largest error.
    normal : (3,) of the plane of a plane mesh.
    components : directions in which nodes move.
    """

    known: IntArray = field(repr=False)
    certain: int
    parts: tuple[IntArray, ...] = field(repr=False)
    surfaces: tuple[IntArray, ...] = field(repr=False)
    edges: IntArray = field(repr=False)
    sheared: IntArray = field(repr=False)
    edge: float
    tolerance: float
    normal: FloatArray | None
    components: tuple[int, ...]

    def at(self, points: FloatArray, free: IntArray) -> "FollowingWalls":
        """See `Addition`."""
        known, places = points[self.known], points[free]
        nearby = Nearby.of(places, known, self.parts)
        size = min(float(np.linalg.norm(np.ptp(points[nodes], axis=0))) for nodes in self.surfaces)
        reach = Reach.of(first_height(nearby, self.certain), self.edge, size, self.tolerance)
        layers = RigidFollow.of(places, known, layer_sites(nearby, self.sheared, reach.sites), nearby)
        near = NearWall.of(places, known, nearby, self.parts, reach.follow)
        late, parts = known[self.certain :], [part[part < self.certain] for part in self.parts]
        bound = NearWall.of(late, known, Nearby.of(late, known, parts), parts, reach.follow)
        turning = LocalRotation.of(known, self.edges, self.certain, self.normal)
        return FollowingWalls(self.components, reach.follow, layers, bound, near, turning)


@dataclass(frozen=True, slots=True, eq=False)
class FollowingWalls(Acting):
    """Near walls, in one step.

    Attributes
    ----------
    components : directions in which nodes move.
    reach : how far from boundary nodes the mesh follows them.
    layers : free nodes that are data sites beside the moving surface.
    bound, free : the nodes that follow boundary nodes nearby, of those that bind and of the free ones.
    turning : how boundary nodes turn.
    """

    components: tuple[int, ...]
    reach: float
    layers: RigidFollow = field(repr=False)
    bound: NearWall = field(repr=False)
    free: NearWall = field(repr=False)
    turning: LocalRotation = field(repr=False)

    def sites(self, known: FloatArray, last: bool) -> Sequence[DataSites]:
        """Return the layer sites; what they follow is certain in both passes."""
        del last
        if not len(self.layers.places):
            return ()
        values = self.layers.displaced(known, self.turning.rotations(known))
        return (DataSites(self.layers.places, values[:, self.components], self.components),)

    def corrected(self, u: FloatArray, known: FloatArray, last: bool) -> FloatArray:
        """Let nodes follow the boundary nodes nearby."""
        return (self.free if last else self.bound).following(u, known, self.turning.rotations(known))
