"""The mesh at the start of a step: where displacements are known, and which nodes follow whom."""

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.cases.case import AdaptationSettings
from sdm_deflect.cases.own.boundary import Boundary
from sdm_deflect.cases.own.fits import Known
from sdm_deflect.cases.own.near import Carried, Nearby, Nearest, companions
from sdm_deflect.cases.own.sites import Sites
from sdm_deflect.cases.own.turns import Rings
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The mesh at the start of a step, and what of it is known.

    Attributes
    ----------
    boundary, sites : the job's nodes and where they are interpolated.
    points : (N, 3) coordinates of the whole mesh.
    free : (Q,) nodes inside that are not on a moving, fixed or sliding patch.
    companions : rows of the free ones that are data sites beside the moving surface.
    nearest, carrying : boundary nodes near the free ones; moving and fixed nodes near the sliding ones.
    rings : edges between the boundary nodes.
    """

    boundary: Boundary
    sites: Sites
    points: FloatArray = field(repr=False)
    free: IndexArray = field(repr=False)
    companions: Carried = field(repr=False)
    nearest: Nearest = field(repr=False)
    carrying: Nearest = field(repr=False)
    rings: Rings = field(repr=False)

    @classmethod
    def of(cls, boundary: Boundary, sites: Sites, inside: IndexArray, points: FloatArray) -> "Start":
        """Sort the nodes inside."""
        free = np.setdiff1d(inside, sites.known)
        places, known, parts = points[free], points[sites.known], sites.parts(boundary)
        nearby = Nearby.of(places, known, parts)
        beside = Carried.of(places, known, companions(nearby, len(sites.nodes), sites.edge), nearby)
        nearest = Nearest.of(places, known, nearby, sites.reach)
        certain = len(sites.nodes) + len(sites.still)
        places = points[sites.slid]
        nearby = Nearby.of(places, known, [part[part < certain] for part in parts])
        carrying = Nearest.of(places, known, nearby, sites.reach)
        rings = Rings.of(known, sites.edges(boundary), certain)
        return cls(boundary, sites, points, free, beside, nearest, carrying, rings)

    @property
    def settings(self) -> AdaptationSettings:
        """Settings of the adaptation."""
        return self.boundary.job.fitting.settings(self.sites.tolerance)

    def known(self, slid: bool) -> Known:
        """Return the points of known displacement, with the sliding nodes or before they are known."""
        sites = self.sites
        carried = [sites.slid[sites.carried]] if slid else []
        beside = self.free[self.companions.rows]
        nodes = [sites.nodes[sites.distinct], sites.still[sites.sampled], beside, *carried]
        return Known(self.points[np.concatenate(nodes)], sites.zero, len(sites.distinct))

    def values(self, move: FloatArray, slid: FloatArray | None = None) -> FloatArray:
        """Return the displacements of the known points, given those of moving (K, 3) and sliding nodes."""
        boundary = self.boundary_values(move, np.zeros((len(self.sites.slid), 3)))
        return self._at_sites(move, self.companions.displaced(boundary, self.rings.rotations(boundary)), slid)

    def rates(self, move: FloatArray, speed: FloatArray, slid: FloatArray | None = None) -> FloatArray:
        """Return the derivatives of `values`, given those of the moving and sliding nodes."""
        none = np.zeros((len(self.sites.slid), 3))
        boundary, rates = self.boundary_values(move, none), self.boundary_values(speed, none)
        turning = self.rings.rotation_rates(boundary, rates)
        return self._at_sites(speed, self.companions.displaced(rates, turning), slid)

    def boundary_values(self, move: FloatArray, slid: FloatArray) -> FloatArray:
        """Return the displacements of `sites.known`, given those of moving (K, 3) and sliding nodes."""
        return np.vstack([move, np.zeros((len(self.sites.still), 3)), slid])

    def _at_sites(self, move: FloatArray, beside: FloatArray, slid: FloatArray | None) -> FloatArray:
        parts = [move[self.sites.distinct], np.zeros((len(self.sites.sampled), 3)), beside]
        return np.vstack(parts if slid is None else [*parts, slid[self.sites.carried]])
