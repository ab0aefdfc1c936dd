"""The hinge moment of a pressure field that is kept while the surface moves: its derivative with the angle.

The total derivative of a hinge moment has two parts: what the moving surface does to the same pressures, and what the
pressures do. The first is geometric; it follows from a solver's pressures and from d(points)/d(angle) alone.
"""

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from studies.flow.setup import Hinge


def hinge_moment(points: FloatArray, triangles: IntArray, pressure: FloatArray, hinge: Hinge) -> float:
    """Return the moment (N m) of pressures on a surface about a hinge's axis, right-handed along it.

    Parameters
    ----------
    points : (N, 3) metres.
    triangles : (T, 3) node indices, whose normals point out of the flow, into the body.
    pressure : (T,) pascals, beside that of the undisturbed air.
    hinge : the axis.
    """
    centre, area = _centres_and_areas(points, triangles)
    arm = centre - np.array(hinge.point)
    return float(np.cross(arm, pressure[:, None] * area).sum(axis=0) @ np.array(hinge.axis))


def hinge_moment_rate(
    points: FloatArray, rates: FloatArray, triangles: IntArray, pressure: FloatArray, hinge: Hinge
) -> float:
    """Return the derivative of `hinge_moment` with the angle at frozen pressures, N m per unit of the angle.

    Parameters
    ----------
    points, triangles, pressure, hinge : as of `hinge_moment`.
    rates : (N, 3) d(points)/d(angle), metres per degree: `Result.sensitivity`.
    """
    centre, area = _centres_and_areas(points, triangles)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    da, db, dc = (rates[triangles[:, i]] for i in range(3))
    d_centre = (da + db + dc) / 3.0
    d_area = 0.5 * (np.cross(db - da, c - a) + np.cross(b - a, dc - da))
    arm = centre - np.array(hinge.point)
    torque = np.cross(d_centre, area) + np.cross(arm, d_area)
    return float((pressure[:, None] * torque).sum(axis=0) @ np.array(hinge.axis))


def _centres_and_areas(points: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return (a + b + c) / 3.0, 0.5 * np.cross(b - a, c - a)
