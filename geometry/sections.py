"""Hexagonal sections (modified double wedges) of wing, tail and fin as six points each.

With thickness and bevels in constant proportion to the chord, every face between two sections is planar.
"""

from __future__ import annotations

from math import cos, radians, sin, tan
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from sdm_deflect.geometry.parameters import Fin, Fuselage, Tail, Wing

FloatArray = NDArray[np.float64]

# Positions of a section's points, once around from the leading edge.
LE, FRONT_UPPER, HINGE_UPPER, TE, HINGE_LOWER, FRONT_LOWER = range(6)

# The port side is the starboard side times this.
MIRROR = np.array([1.0, -1.0, 1.0])


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
