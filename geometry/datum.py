"""Data of control surfaces and fuselage for a deformation, as plain arrays from the parameters alone.

Arrays are float64 in metres. "Inboard" is the end next to the parent component: the lower one of a rudder.
"""

from math import cos, radians

import numpy as np

from .parameters import (
    BURIED,
    HINGE_LOWER,
    HINGE_UPPER,
    MIRROR,
    TE,
    Fighter,
    FloatArray,
    aileron_span,
    fin_section,
    rudder_span,
    tail_pivot,
    tail_section,
    wing_section,
)

SURFACES = ("aileron_left", "aileron_right", "tail_left", "tail_right", "rudder")


def hinged(surface: str) -> bool:
    """Return True for wedges on a hinge (ailerons, rudder), False for tails, which turn as a whole."""
    return not surface.startswith("tail")


def ends(fighter: Fighter, surface: str) -> FloatArray:
    """Return undeflected sections (2, 6, 3) at a surface's inboard and outboard end, for a tail from the fuselage.

    ValueError if there is no control surface of that name.
    """
    if surface not in SURFACES:
        raise ValueError(f"no control surface {surface!r}; there are {', '.join(SURFACES)}")
    if surface == "rudder":
        sections = [fin_section(fighter.fin, z) for z in rudder_span(fighter)]
    elif hinged(surface):
        span = aileron_span(fighter)
        sections = [wing_section(fighter.wing, y) for y in (span.inboard, span.outboard)]
    else:
        buried = BURIED * fighter.fuselage.radius * cos(radians(fighter.tail.anhedral))
        sections = [tail_section(fighter.tail, fighter.fuselage, y) for y in (buried, fighter.tail.half_span)]
    factor = MIRROR if surface.endswith("_left") else MIRROR**2
    return np.asarray(np.array(sections) * factor, dtype=np.float64)


def hinge_line(fighter: Fighter, surface: str) -> FloatArray:
    """Return two points (2, 3) of the axis about which a surface turns.

    A positive right-handed turn moves the trailing edge down, a rudder's to port. Ailerons and rudder
    turn about the line half way between their hinge edges, tails about their pivot.
    """
    if not hinged(surface):
        pivot = tail_pivot(fighter.tail, fighter.fuselage) * (MIRROR if surface.endswith("_left") else 1.0)
        return np.array([pivot, pivot + np.array([0.0, 0.01, 0.0])])
    edges = hinge_edges(fighter, surface)
    line: FloatArray = 0.5 * (edges[0] + edges[1])
    return line if surface == "aileron_right" else line[::-1]


def hinge_edges(fighter: Fighter, surface: str) -> FloatArray:
    """Return edges (2, 2, 3) along which the surface meets its parent: [upper, lower][inboard, outboard].

    A rudder's upper edge is the starboard one. ValueError for tails, which have none.
    """
    if not hinged(surface):
        raise ValueError(f"{surface} has no hinge edges; it turns as a whole about hinge_line")
    sections = ends(fighter, surface)
    return np.array([sections[:, HINGE_UPPER], sections[:, HINGE_LOWER]])


def trailing_edge(fighter: Fighter, surface: str) -> FloatArray:
    """Return the undeflected trailing edge (2, 3), inboard end first; a tail's begins inside the fuselage."""
    return np.asarray(ends(fighter, surface)[:, TE], dtype=np.float64)


def ribs(fighter: Fighter, surface: str) -> FloatArray:
    """Return stations (k,) of the surface's ends that face its parent.

    They are the y of an aileron's ends and the z of a rudder's, inboard first; a tail has none.
    """
    sections = ends(fighter, surface)
    facing = len(parent_ribs(fighter, surface))
    return np.array([section[TE, 2 if surface == "rudder" else 1] for section in sections[:facing]])


def parent_ribs(fighter: Fighter, surface: str) -> FloatArray:
    """Return stations (k,) of the parent's ribs across the gaps; equal to `ribs` where there is no gap."""
    if not hinged(surface):
        return np.empty(0)
    if surface == "rudder":
        lower, upper = rudder_span(fighter)
        return np.array([lower] if upper == fighter.fin.z_tip else [lower, upper])
    span, side = aileron_span(fighter), -1.0 if surface.endswith("_left") else 1.0
    stations = [span.wing_rib] if span.outboard == fighter.wing.half_span else [span.wing_rib, span.outer_rib]
    return side * np.array(stations)


def cylinder(fighter: Fighter) -> tuple[FloatArray, FloatArray, float]:
    """Return a point (3,) on the axis, the axis' direction (3,) and the radius of the rear fuselage."""
    point = np.array([fighter.fuselage.nose_length, 0.0, 0.0])
    return point, np.array([1.0, 0.0, 0.0]), fighter.fuselage.radius
