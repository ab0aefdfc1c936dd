"""One step: from displacements of the moving nodes to those of every node inside the box."""

from dataclasses import dataclass, field

import numpy as np

from cases.case import AdaptationSettings
from cases.own.boundary import Boundary
from cases.own.fits import Fits, Known, fitted, fitted_again, on_same_centers
from cases.own.near import Nearest
from cases.own.sites import Sites
from cases.own.turns import Rings
from cases.progress import Report
from deform.duplicates import IndexArray
from deform.kernels import FloatArray

ROUNDS = 8  # of putting nodes on several walls, one after another


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The mesh at the start of a step, and what of it is known.

    Attributes
    ----------
    boundary, sites : the job's nodes and where they are interpolated.
    points : (N, 3) coordinates of the whole mesh.
    free : (Q,) nodes inside that are not on a moving, fixed or sliding patch.
    nearest, carrying : boundary nodes near the free ones; moving and fixed nodes near the sliding ones.
    rings : edges between the boundary nodes.
    """

    boundary: Boundary
    sites: Sites
    points: FloatArray = field(repr=False)
    free: IndexArray = field(repr=False)
    nearest: Nearest = field(repr=False)
    carrying: Nearest = field(repr=False)
    rings: Rings = field(repr=False)

    @classmethod
    def of(cls, boundary: Boundary, sites: Sites, inside: IndexArray, points: FloatArray) -> "Start":
        """Sort the nodes inside."""
        free = np.setdiff1d(inside, sites.known)
        known, parts = points[sites.known], sites.parts(boundary)
        nearest = Nearest.of(points[free], known, parts, sites.reach)
        certain = len(sites.nodes) + len(sites.still)
        carrying = Nearest.of(points[sites.slid], known, [part[part < certain] for part in parts], sites.reach)
        rings = Rings.of(known, sites.edges(boundary), certain)
        return cls(boundary, sites, points, free, nearest, carrying, rings)

    @property
    def settings(self) -> AdaptationSettings:
        """Settings of the adaptation."""
        return self.boundary.job.fitting.settings(self.sites.tolerance)

    def known(self, slid: bool) -> Known:
        """Return the points of known displacement, with the sliding nodes or before they are known."""
        sites = self.sites
        carried = [sites.slid[sites.carried]] if slid else []
        nodes = [sites.nodes[sites.distinct], sites.still[sites.sampled], *carried]
        return Known(self.points[np.concatenate(nodes)], sites.zero, len(sites.distinct))

    def values(self, move: FloatArray, slid: FloatArray | None = None) -> FloatArray:
        """Return the displacements of the known points, given those of moving (K, 3) and sliding nodes."""
        parts = [move[self.sites.distinct], np.zeros((len(self.sites.sampled), 3))]
        return np.vstack(parts if slid is None else [*parts, slid[self.sites.carried]])

    def boundary_values(self, move: FloatArray, slid: FloatArray) -> FloatArray:
        """Return the displacements of `sites.known`, given those of moving (K, 3) and sliding nodes."""
        return np.vstack([move, np.zeros((len(self.sites.still), 3)), slid])


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """The fits of one step, and the displacement that follows.

    Attributes
    ----------
    first : the fit by which sliding nodes are carried, where there are any; they are then put on their shapes.
    fits : the fit with all boundary nodes.
    slid : (L, 3) displacement of the sliding nodes.
    error : largest distance of a boundary node from its place before it was put there.
    points : (N, 3) coordinates at the end of the step.
    """

    first: Fits | None
    fits: Fits
    slid: FloatArray = field(repr=False)
    error: float
    points: FloatArray = field(repr=False)


def solve(start: Start, move: FloatArray, report: Report, earlier: Solution | None = None) -> Solution:
    """Carry out one step: moving nodes (K, 3) go by `move`, on the centres of an earlier solution if there is one."""
    first, slid = None, np.empty((0, 3))
    if len(start.sites.slid):
        first = _fit(start, False, start.values(move), report, earlier.first if earlier else None)
        slid = _kept(start, _carried(start, first.interpolant(start.points[start.sites.slid]), move))
        fits = _fit(start, True, start.values(move, slid), report, earlier.fits if earlier else None)
    else:
        fits = _fit(start, False, start.values(move), report, earlier.fits if earlier else None)
    values = start.boundary_values(move, slid)
    interpolant, points, known = fits.interpolant, start.points.copy(), start.sites.known
    off = np.linalg.norm(values - interpolant(points[known]), axis=1)
    if values.any():
        turns = start.rings.rotations(values)
        points[start.free] += start.nearest.followed(interpolant(points[start.free]), values, turns)
        points[known] += values
    return Solution(first, fits, slid, float(off.max()), points)


def rate(start: Start, solution: Solution, move: FloatArray, speed: FloatArray) -> FloatArray:
    """Return d(points)/d(angle) (N, 3) at the end of a step, given that (K, 3) of the moving nodes.

    The displacement is linear in the known values as long as the centres stay: a second right-hand side for the
    same factor gives its derivative exactly.
    """
    fitting, slid = start.boundary.job.fitting, np.empty((0, 3))
    if solution.first is not None:
        known = start.known(False)
        nodes = start.points[start.sites.slid]
        carried_by = on_same_centers(solution.first, known, start.values(speed), fitting)(nodes)
        carried = _carried(start, solution.first.interpolant(nodes), move)
        slid = _kept_rate(start, carried, _carried_rate(start, carried_by, move, speed))
        speeds = on_same_centers(solution.fits, start.known(True), start.values(speed, slid), fitting)
    else:
        speeds = on_same_centers(solution.fits, start.known(False), start.values(speed), fitting)
    values, rates = start.boundary_values(move, solution.slid), start.boundary_values(speed, slid)
    out = np.zeros_like(start.points)
    turning = start.rings.rotation_rates(values, rates)
    out[start.free] = start.nearest.followed(speeds(start.points[start.free]), rates, turning)
    out[start.sites.known] = rates
    return out


def _fit(start: Start, slid: bool, values: FloatArray, report: Report, earlier: Fits | None) -> Fits:
    known, fitting = start.known(slid), start.boundary.job.fitting
    if earlier is None:
        return fitted(known, values, fitting, start.settings, report)
    return fitted_again(earlier, known, values, fitting, start.settings, report)


def _carried(start: Start, displacement: FloatArray, move: FloatArray) -> FloatArray:
    """Let sliding nodes follow the moving and fixed ones nearby, before they are put on their shapes."""
    values = start.boundary_values(move, np.zeros_like(displacement))
    return start.carrying.followed(displacement, values, start.rings.rotations(values))


def _carried_rate(start: Start, speeds: FloatArray, move: FloatArray, speed: FloatArray) -> FloatArray:
    """Differentiate `_carried`."""
    none = np.zeros_like(speeds)
    values, rates = start.boundary_values(move, none), start.boundary_values(speed, none)
    return start.carrying.followed(speeds, rates, start.rings.rotation_rates(values, rates))


def _sheets(start: Start) -> list[tuple[int, IndexArray]]:
    """Return the place of each sheet in the boundary with the rows of the sliding nodes on it."""
    return [(i, np.searchsorted(start.sites.slid, nodes)) for i, nodes in start.sites.sliding]


def _kept(start: Start, displacement: FloatArray) -> FloatArray:
    """Put sliding nodes on their shapes; those on several, on one after another."""
    points, sheets = start.points[start.sites.slid], _sheets(start)
    for _ in range(ROUNDS if len(sheets) > 1 else 1):
        for i, rows in sheets:
            wall = start.boundary.sheets[i].wall
            displacement[rows] = wall.kept(points[rows], displacement[rows])
    return displacement


def _kept_rate(start: Start, displacement: FloatArray, speed: FloatArray) -> FloatArray:
    points, sheets = start.points[start.sites.slid], _sheets(start)
    for _ in range(ROUNDS if len(sheets) > 1 else 1):
        for i, rows in sheets:
            wall = start.boundary.sheets[i].wall
            speed[rows] = wall.rate(points[rows], displacement[rows], speed[rows])
            displacement[rows] = wall.kept(points[rows], displacement[rows])
    return speed
