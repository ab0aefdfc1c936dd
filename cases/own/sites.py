"""Where displacements are known at the start of a step: nodes of the boundary, and zero sites on the box."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own.boundary import SAME, Boundary
from sdm_deflect.cases.own.region import Region
from sdm_deflect.cases.own.spacing import in_front, spacing_for, surface_edge
from sdm_deflect.cases.zero_sites import APART, apart_from
from sdm_deflect.deform.edges import edges_of, polygons_of
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray, first_coincident

NEIGHBOURS = 7
REACH = 1.0  # median edges
MOST_STILL = 30_000  # sites on fixed patches; a larger patch is thinned, and verified as a whole


@dataclass(frozen=True, slots=True, eq=False)
class Sites:
    """Rows of nodes whose displacement is known, and points on the box.

    Attributes
    ----------
    nodes : (K,) moving nodes.
    distinct : rows of `nodes` at places of their own: coincident nodes move as one.
    still : (F,) fixed nodes inside.
    sampled : rows of `still` that are data sites, at most `MOST_STILL`, none where a moving node is.
    sliding : sheets' nodes inside that neither move nor stay, with the sheet's place in the boundary.
    carried : rows of `slid` that are data sites, at most `MOST_STILL`.
    zero : (Z, 3) points of zero displacement on the box.
    spacing, edge, tolerance, reach : lengths: between zero sites, of the surface's median edge, of a site's error, and
        from a surface to where the mesh no longer follows it rigidly.
    """

    nodes: IndexArray = field(repr=False)
    distinct: IndexArray = field(repr=False)
    still: IndexArray = field(repr=False)
    sampled: IndexArray = field(repr=False)
    sliding: tuple[tuple[int, IndexArray], ...] = field(repr=False)
    carried: IndexArray = field(repr=False)
    zero: FloatArray = field(repr=False)
    spacing: float
    edge: float
    tolerance: float
    reach: float

    @property
    def slid(self) -> IndexArray:
        """Sorted, distinct indices of all sliding nodes inside."""
        return _union(self.sliding)

    @property
    def known(self) -> IndexArray:
        """Indices of all nodes of known displacement inside: moving, fixed, sliding; each once."""
        return np.concatenate([self.nodes, self.still, self.slid])

    def parts(self, boundary: Boundary) -> list[IndexArray]:
        """Return rows of `known` that may move differently: each moving surface, and the rest."""
        owner = np.full(len(self.known), len(boundary.surfaces))
        for i, surface in reversed(list(enumerate(boundary.surfaces))):
            owner[np.searchsorted(self.nodes, surface.nodes)] = i
        return [np.flatnonzero(owner == i) for i in range(len(boundary.surfaces) + 1)]

    def edges(self, boundary: Boundary) -> IndexArray:
        """Return the edges (E, 2) between nodes of `known`, as rows; of near neighbours where there are no faces."""
        subject, known = boundary.subject, self.known
        faces = subject.faces_of(boundary.declared)
        if not faces:
            near = cKDTree(subject.points[known]).query(subject.points[known], min(NEIGHBOURS, len(known)))[1]
            return np.column_stack([np.repeat(near[:, 0], near.shape[1] - 1), near[:, 1:].ravel()])
        row = np.full(len(subject.points), -1, dtype=np.int32)
        row[known] = np.arange(len(known))
        edges = row[edges_of(polygons_of(faces))[0]]
        return np.unique(np.sort(edges[(edges >= 0).all(axis=1)], axis=1), axis=0).astype(np.intp)

    @property
    def coincident(self) -> int:
        """Number of moving nodes that are at the place of another."""
        return len(self.nodes) - len(self.distinct)

    @classmethod
    def of(cls, boundary: Boundary, region: Region, share: float) -> "Sites":
        """Place the sites; `share` is the tolerance in median edges unless the job gives a length."""
        subject, fitting = boundary.subject, boundary.job.fitting
        still = np.intersect1d(boundary.still, region.inside, assume_unique=True)
        sliding = tuple(_sliding(boundary, region, still))
        distinct, sampled, carried = _distinct(boundary, still, _union(sliding))
        edge = surface_edge(boundary, distinct)
        spacing = spacing_for(region, fitting.spacing_edges * edge)
        known = np.concatenate([boundary.nodes, still, *(nodes for _, nodes in sliding)])
        zero = in_front(boundary, region.hexahedron.face_sites(spacing))
        zero = apart_from(zero, subject.points[known], APART * spacing)
        tolerance = fitting.tolerance or share * edge
        reach = REACH * edge
        return cls(
            boundary.nodes, distinct, still, sampled, sliding, carried, zero, spacing, edge, tolerance, reach
        )  # fmt: skip


def _union(sliding: Sequence[tuple[int, IndexArray]]) -> IndexArray:
    return np.unique(np.concatenate([np.empty(0, dtype=np.intp), *(nodes for _, nodes in sliding)]))


def _distinct(boundary: Boundary, still: IndexArray, slid: IndexArray) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Return rows of moving, fixed and sliding nodes at places of their own.

    Raises
    ------
    InputError
        If coincident nodes are to move differently.
    """
    subject, tol = boundary.subject, SAME * boundary.size
    nodes = np.concatenate([boundary.nodes, still, slid])
    first = first_coincident(subject.points[nodes], tol)
    move = np.vstack([boundary.displacement(boundary.job.angle), np.zeros((len(still), 3))])
    torn = np.flatnonzero(np.abs(move - move[first[: len(move)]]).max(axis=1) > 10.0 * tol)
    if len(torn):
        raise InputError(
            f"{subject.name}: {len(torn)} nodes of the moving surface lie exactly on nodes that move otherwise, such "
            f"as nodes {nodes[first[torn[0]]]} and {nodes[torn[0]]}"
        )
    own = first == np.arange(len(nodes))
    moving, fixed, carried = np.split(own, [len(boundary.nodes), len(move)])
    return np.flatnonzero(moving), _sampled(fixed), _sampled(carried)


def _sampled(own: NDArray[np.bool_]) -> IndexArray:
    """Return the rows of a mask, every n-th of them if they are more than `MOST_STILL`."""
    rows = np.flatnonzero(own)
    return rows[:: max(1, -(-len(rows) // MOST_STILL))]


def _sliding(boundary: Boundary, region: Region, still: IndexArray) -> list[tuple[int, IndexArray]]:
    known = np.union1d(boundary.nodes, still)
    return [
        (i, np.setdiff1d(np.intersect1d(sheet.nodes, region.inside, assume_unique=True), known, assume_unique=True))
        for i, sheet in enumerate(boundary.sheets)
    ]
