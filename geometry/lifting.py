"""Wing, aileron, tail, fin and rudder as polyhedra (starboard side), corner by corner."""

from math import cos, radians

from sdm_deflect.geometry.layout import aileron_span, rudder_span
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.geometry.polyhedron import FloatArray, Loops, prism
from sdm_deflect.geometry.sections import (
    FRONT_LOWER,
    FRONT_UPPER,
    HINGE_LOWER,
    HINGE_UPPER,
    LE,
    TE,
    fin_section,
    tail_section,
    wing_section,
)

# A section without its trailing-edge wedge, and the wedge alone.
BOX = [LE, FRONT_UPPER, HINGE_UPPER, HINGE_LOWER, FRONT_LOWER]
WEDGE = [HINGE_UPPER, TE, HINGE_LOWER]

# How far inside the fuselage a root lies, by its radius: deep enough for a tail turned by 30 degrees.
BURIED = 0.42


def wing_polyhedra(fighter: Fighter) -> list[Loops]:
    """The wing without its aileron: inboard of the kink, the box outboard of it, the rest of the wedge."""
    wing, span = fighter.wing, aileron_span(fighter)
    root = wing_section(wing, BURIED * fighter.fuselage.radius)
    kink, tip = wing_section(wing, wing.y_kink), wing_section(wing, wing.half_span)
    polyhedra = [prism(root, kink), prism(kink[BOX], tip[BOX])]
    for inner, outer in ((wing.y_kink, span.wing_rib), (span.outer_rib, wing.half_span)):
        if inner < outer:
            polyhedra.append(prism(wing_section(wing, inner)[WEDGE], wing_section(wing, outer)[WEDGE]))
    return polyhedra


def aileron_ends(fighter: Fighter) -> tuple[FloatArray, FloatArray]:
    """Wing sections (6, 3) at the aileron's inboard and outboard end."""
    span = aileron_span(fighter)
    return wing_section(fighter.wing, span.inboard), wing_section(fighter.wing, span.outboard)


def tail_ends(fighter: Fighter) -> tuple[FloatArray, FloatArray]:
    """Tail sections (6, 3) at the root, inside the fuselage, and at the tip."""
    buried = BURIED * fighter.fuselage.radius * cos(radians(fighter.tail.anhedral))
    sections = (tail_section(fighter.tail, fighter.fuselage, y) for y in (buried, fighter.tail.half_span))
    root, tip = sections
    return root, tip


def fin_polyhedra(fighter: Fighter) -> list[Loops]:
    """The fin without its rudder: the box down into the pedestal, and the rest of the wedge."""
    fin = fighter.fin
    lower, upper = rudder_span(fighter)
    buried = 0.75 * fighter.fuselage.radius
    foot, tip = fin_section(fin, buried), fin_section(fin, fin.z_tip)
    polyhedra = [prism(foot[BOX], tip[BOX])]
    for low, high in ((buried, lower), (upper, fin.z_tip)):
        if low < high:
            polyhedra.append(prism(fin_section(fin, low)[WEDGE], fin_section(fin, high)[WEDGE]))
    return polyhedra


def rudder_ends(fighter: Fighter) -> tuple[FloatArray, FloatArray]:
    """Fin sections (6, 3) at the rudder's lower and upper end."""
    lower, upper = rudder_span(fighter)
    return fin_section(fighter.fin, lower), fin_section(fighter.fin, upper)
