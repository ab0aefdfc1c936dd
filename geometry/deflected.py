"""Control surfaces deflected in the CAD, the reference for deformed meshes."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from sdm_deflect.base.arrays import components

from .parameters import HINGE_LOWER, HINGE_UPPER, LARGEST_TURN, TE, FloatArray
from .polyhedra import WEDGE, Loops, prism
from .quantity import Checked, quantity

# How far a rigid wedge's nose reaches ahead of the hinge line, by its local half thickness: it closes the
# slot that opens when the wedge turns about a line inside the wing.
NOSE = 0.35


@dataclass(frozen=True, slots=True)
class CadTurn(Checked):
    """A deflection in the CAD: angle in degrees, and rigid or blended.

    Positive angles move the trailing edge down, the rudder's to port. "rigid" turns the whole surface about
    its axis; "blended" keeps the hinge edges and turns the trailing edge alone (paper, appendix A). Tails
    have no hinge edges and turn rigidly only. Along a `strip` beside each rib without a gap the angle of a blended
    trailing edge grows from zero; with a strip of 0 it is constant up to the rib.
    """

    angle: float = quantity(0.0, "deg", -LARGEST_TURN, LARGEST_TURN, "angle")
    mode: Literal["rigid", "blended"] = "rigid"
    strip: float = quantity(0.0, "m", 0.0, 0.5, "width of the strip beside a rib without a gap")


def rotate(points: FloatArray, axis: FloatArray, degrees: float) -> FloatArray:
    """Return points (..., 3) turned right-handed about the line from `axis[0]` to `axis[1]`, (2, 3)."""
    direction = axis[1] - axis[0]
    turn = Rotation.from_rotvec(np.radians(degrees) * direction / np.linalg.norm(direction)).as_matrix()
    return np.asarray(components(points - axis[0], turn) + axis[0])


def wedge(inner: FloatArray, outer: FloatArray) -> Loops:
    """Return the trailing-edge wedge between two sections (6, 3), undeflected."""
    return prism(inner[WEDGE], outer[WEDGE])


def deflected_wedge(
    inner: FloatArray, outer: FloatArray, axis: FloatArray, deflection: CadTurn, ribs: int = 0
) -> list[Loops]:
    """Return the wedge between two sections (6, 3) turned about `axis` (2, 3), as closed pieces.

    `ribs` is the number of ends, counted from the inner one, that meet the parent without a gap.
    """
    if deflection.mode == "blended":
        return _blended_wedge(inner, outer, axis, deflection, ribs)
    return [tuple(rotate(loop, axis, deflection.angle) for loop in _with_nose(inner, outer))]


def turned_surface(loops: Loops, axis: FloatArray, angle: float) -> Loops:
    """Return a whole surface turned rigidly about `axis` (2, 3)."""
    return tuple(rotate(loop, axis, angle) for loop in loops)


def _blended_wedge(inner: FloatArray, outer: FloatArray, axis: FloatArray, turn: CadTurn, ribs: int) -> list[Loops]:
    """Return the wedge between sections (6, 3) with its trailing edge alone turned about `axis` (2, 3).

    Beside ribs the faces are ruled: two opposite edges of each are straight, but not in one plane.
    """
    share = turn.strip / float(np.linalg.norm((outer - inner)[TE, 1:]))
    inside, outside = (share if share and ribs > end else 0.0 for end in (0, 1))
    stations = [(0.0, not inside), (inside, True), (1.0 - outside, True), (1.0, not outside)]
    rings = []
    for station, follows in sorted(set(stations)):
        at = inner + station * (outer - inner)
        trailing = rotate(at[TE], axis, turn.angle) if follows else at[TE]
        rings.append(np.array([at[HINGE_UPPER], trailing, at[HINGE_LOWER]]))
    return [prism(first, last) for first, last in pairwise(rings)]


def _with_nose(inner: FloatArray, outer: FloatArray) -> Loops:
    """Return the wedge between sections (6, 3) with a ridge ahead of the hinge line, inside the wing at both ends."""
    upper, trailing, lower = (np.array([inner[i], outer[i]]) for i in (HINGE_UPPER, TE, HINGE_LOWER))
    half = 0.5 * np.linalg.norm(upper - lower, axis=1)
    ridge = 0.5 * (upper + lower) - np.outer(NOSE * half, [1.0, 0.0, 0.0])
    along = (ridge[1] - ridge[0]) / np.linalg.norm(ridge[1] - ridge[0])
    nose = ridge + np.outer(half * [1.0, -1.0], along)
    sides = pairwise((upper, trailing, lower, nose, upper))
    quads = [np.array([a[0], a[1], b[1], b[0]]) for a, b in sides]
    ends = [np.array([upper[i], trailing[i], lower[i]]) for i in (0, 1)]
    noses = [np.array([upper[i], lower[i], nose[i]]) for i in (0, 1)]
    return (*quads, *ends, *noses)
