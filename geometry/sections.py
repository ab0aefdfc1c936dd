"""Hexagonal sections of wing, tail and fin, and the stations between which the movable surfaces lie.

Sections are modified double wedges of six points. With thickness and bevels in constant proportion to the chord,
every face between two of them is planar.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin, tan
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from sdm_deflect.geometry.parameters import Fighter, Fin, Fuselage, Tail, Wing

FloatArray = NDArray[np.float64]

# Positions of a section's points, once around from the leading edge.
LE, FRONT_UPPER, HINGE_UPPER, TE, HINGE_LOWER, FRONT_LOWER = range(6)

# The port side is the starboard side times this.
MIRROR = np.array([1.0, -1.0, 1.0])

# How far inside the fuselage a root lies, by its radius: deep enough for a tail turned by 30 degrees.
BURIED = 0.42

# Metres. Shorter edges cost the volume mesher its quality; narrower gaps hold no cell at all.
MIN_FEATURE = 0.003
MIN_GAP = 0.0005

# Metres. Stations closer than this are meant to be one.
SAME_STATION = 1e-4

# The paper's spanwise gap by half-span (section 5).
PAPER_GAP_RATIO = 0.014


def hexagon(leading: FloatArray, chord: float, bevel: float, half_thickness: float, up: FloatArray) -> FloatArray:
    """The section (6, 3) of a chord along x from `leading` (3,), thick along the unit vector `up` (3,)."""
    aft = np.array([0.0, bevel, chord - bevel, chord, chord - bevel, bevel])
    above = half_thickness * np.array([0.0, 1.0, 1.0, 0.0, -1.0, -1.0])
    return np.asarray(leading + np.outer(aft, [1.0, 0.0, 0.0]) + np.outer(above, up), dtype=np.float64)


def wing_section(wing: Wing, y: float) -> FloatArray:
    """The starboard wing's section (6, 3) at a span station."""
    chord = _wing_chord(wing, y)
    reference = _wing_chord(wing, max(y, wing.y_kink))
    leading = np.array([wing.x_te - chord, y, 0.0])
    half = 0.5 * wing.thickness_ratio * reference
    return hexagon(leading, chord, wing.bevel_ratio * reference, half, np.array([0.0, 0.0, 1.0]))


def _wing_chord(wing: Wing, y: float) -> float:
    return wing.root_chord + (wing.tip_chord - wing.root_chord) * y / wing.half_span


def tail_section(tail: Tail, fuselage: Fuselage, y: float) -> FloatArray:
    """The starboard tail's section (6, 3), perpendicular to the tail's plane, whose chord line is at `y`."""
    slope = radians(tail.anhedral)
    beside = fuselage.radius * cos(slope)
    chord = tail.root_chord - (y - beside) * tan(radians(tail.le_sweep))
    leading = np.array([tail.x_te - chord, y, -y * tan(slope)])
    up = np.array([0.0, sin(slope), cos(slope)])
    return hexagon(leading, chord, tail.bevel_ratio * chord, 0.5 * tail.thickness_ratio * chord, up)


def tail_pivot(tail: Tail, fuselage: Fuselage) -> FloatArray:
    """Where the tail's axis of rotation, parallel to y, pierces the starboard root chord (3,)."""
    slope = radians(tail.anhedral)
    beside = fuselage.radius * cos(slope)
    x = tail.x_te - (1.0 - tail.pivot) * tail.root_chord
    return np.array([x, beside, -beside * tan(slope)])


def fin_section(fin: Fin, z: float) -> FloatArray:
    """The fin's section (6, 3) at a height; its upper points are on the starboard side."""
    above = z - fin.z_root
    sweep = tan(radians(fin.le_sweep))
    chord = fin.root_chord - above * (sweep - tan(radians(fin.te_sweep)))
    leading = np.array([fin.x_le + above * sweep, 0.0, z])
    up = np.array([0.0, 1.0, 0.0])
    return hexagon(leading, chord, fin.bevel_ratio * chord, 0.5 * fin.thickness_ratio * chord, up)


@dataclass(frozen=True, slots=True)
class AileronSpan:
    """Span stations (y >= 0, metres) of an aileron and of the wing's ribs that face it.

    Without a gap a rib and the aileron's end coincide; `outer_rib` is the tip where the aileron reaches it.
    """

    wing_rib: float
    inboard: float
    outboard: float
    outer_rib: float


def aileron_span(fighter: Fighter) -> AileronSpan:
    """Resolve the stations; a rib within a tenth of a millimetre of the wing's kink is put on it."""
    wing, aileron = fighter.wing, fighter.aileron
    offset = aileron.gap or PAPER_GAP_RATIO * wing.half_span
    inboard = aileron.y_inboard or wing.y_kink + offset
    rib = _snapped(inboard - aileron.gap, wing.y_kink)
    outboard = _snapped(aileron.y_outboard or wing.half_span, wing.half_span)
    outer = outboard if outboard == wing.half_span else _snapped(outboard + aileron.gap, wing.half_span)
    return AileronSpan(rib, inboard, outboard, outer)


def rudder_span(fighter: Fighter) -> tuple[float, float]:
    """Heights z of the rudder's lower and upper end."""
    tip = fighter.fin.z_tip
    return fighter.rudder.z_inboard, _snapped(fighter.rudder.z_outboard or tip, tip)


def _snapped(station: float, target: float) -> float:
    return target if abs(station - target) < SAME_STATION else station
