"""Reference area, lengths and point of a control surface, for coefficients of its forces."""

import numpy as np

from sdm_deflect.geometry.datum import ends, hinge_line, hinged, trailing_edge
from sdm_deflect.geometry.parameters import LE, MIRROR, TE, Fighter, FloatArray, ReferenceValues, tail_section


def surface_reference(fighter: Fighter, surface: str) -> ReferenceValues:
    """Return those of a control surface: its planform behind the hinge, of a tail the whole outside the fuselage.

    The chord is the mean one, and the point lies on the hinge.
    """
    hinge = hinge_line(fighter, surface)
    if hinged(surface):
        front, back = _along(hinge), _along(trailing_edge(fighter, surface))
    else:
        beside = tail_section(fighter.tail, fighter.fuselage, abs(float(hinge[0, 1])))
        if surface.endswith("_left"):
            beside = beside * MIRROR
        sections = np.array([beside, ends(fighter, surface)[1]])
        front, back = sections[:, LE], sections[:, TE]
    diagonals = back[1] - front[0], back[0] - front[1]
    area = 0.5 * float(np.linalg.norm(np.cross(*diagonals)))
    span = float(np.linalg.norm((back[1] - back[0])[1:]))
    return ReferenceValues(area, area / span, span, tuple(hinge[0].tolist()))


def _along(line: FloatArray) -> FloatArray:
    """Return two points (2, 3) with the one nearer to the fuselage first."""
    return line if np.linalg.norm(line[0, 1:]) <= np.linalg.norm(line[1, 1:]) else line[::-1]
