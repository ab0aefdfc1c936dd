"""One step: from displacements of the moving nodes to those of every node inside the box."""

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.cases.own.fits import Fits, fitted, fitted_again
from sdm_deflect.cases.own.start import Start
from sdm_deflect.cases.progress import Report
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray

ROUNDS = 8  # of putting nodes on several walls, one after another


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
        slid = _kept(start, carried_along(start, first.interpolant(start.points[start.sites.slid]), move))
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


def _fit(start: Start, slid: bool, values: FloatArray, report: Report, earlier: Fits | None) -> Fits:
    known, fitting = start.known(slid), start.boundary.job.fitting
    if earlier is None:
        return fitted(known, values, fitting, start.settings, report)
    return fitted_again(earlier, known, values, fitting, start.settings, report)


def carried_along(start: Start, displacement: FloatArray, move: FloatArray) -> FloatArray:
    """Let sliding nodes follow the moving and fixed ones nearby, before they are put on their shapes."""
    values = start.boundary_values(move, np.zeros_like(displacement))
    return start.carrying.followed(displacement, values, start.rings.rotations(values))


def rounds(sheets: list[tuple[int, IndexArray]]) -> int:
    """Return how often to go round: once for a single wall."""
    return ROUNDS if len(sheets) > 1 else 1


def sheets_of(start: Start) -> list[tuple[int, IndexArray]]:
    """Return the place of each sheet in the boundary with the rows of the sliding nodes on it."""
    return [(i, np.searchsorted(start.sites.slid, nodes)) for i, nodes in start.sites.sliding]


def _kept(start: Start, displacement: FloatArray) -> FloatArray:
    """Put sliding nodes on their shapes; those on several, on one after another."""
    points, sheets = start.points[start.sites.slid], sheets_of(start)
    for _ in range(rounds(sheets)):
        for i, rows in sheets:
            wall = start.boundary.sheets[i].wall
            displacement[rows] = wall.kept(points[rows], displacement[rows])
    return displacement
