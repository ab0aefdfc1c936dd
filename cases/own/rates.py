"""The derivative of a step with respect to the angle, on the same centres."""

import numpy as np

from sdm_deflect.cases.own.fits import on_same_centers
from sdm_deflect.cases.own.start import Start
from sdm_deflect.cases.own.step import Solution, carried_along, rounds, sheets_of
from sdm_deflect.deform.rbf.kernels import FloatArray


def rate(start: Start, solution: Solution, move: FloatArray, speed: FloatArray) -> FloatArray:
    """Return d(points)/d(angle) (N, 3) at the end of a step, given that (K, 3) of the moving nodes.

    The displacement is linear in the known values as long as the centres stay: a second right-hand side for the
    same factor gives its derivative exactly.
    """
    fitting, slid = start.boundary.job.fitting, np.empty((0, 3))
    if solution.first is not None:
        known = start.known(False)
        nodes = start.points[start.sites.slid]
        carried_by = on_same_centers(solution.first, known, start.rates(move, speed), fitting)(nodes)
        carried = carried_along(start, solution.first.interpolant(nodes), move)
        slid = _kept_rate(start, carried, _carried_rate(start, carried_by, move, speed))
        speeds = on_same_centers(solution.fits, start.known(True), start.rates(move, speed, slid), fitting)
    else:
        speeds = on_same_centers(solution.fits, start.known(False), start.rates(move, speed), fitting)
    values, rates = start.boundary_values(move, solution.slid), start.boundary_values(speed, slid)
    out = np.zeros_like(start.points)
    turning = start.rings.rotation_rates(values, rates)
    out[start.free] = start.nearest.followed(speeds(start.points[start.free]), rates, turning)
    out[start.sites.known] = rates
    return out


def _carried_rate(start: Start, speeds: FloatArray, move: FloatArray, speed: FloatArray) -> FloatArray:
    """Differentiate `_carried`."""
    none = np.zeros_like(speeds)
    values, rates = start.boundary_values(move, none), start.boundary_values(speed, none)
    return start.carrying.followed(speeds, rates, start.rings.rotation_rates(values, rates))


def _kept_rate(start: Start, displacement: FloatArray, speed: FloatArray) -> FloatArray:
    points, sheets = start.points[start.sites.slid], sheets_of(start)
    for _ in range(rounds(sheets)):
        for i, rows in sheets:
            wall = start.boundary.sheets[i].wall
            speed[rows] = wall.rate(points[rows], displacement[rows], speed[rows])
            displacement[rows] = wall.kept(points[rows], displacement[rows])
    return speed
