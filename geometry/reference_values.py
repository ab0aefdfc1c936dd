"""Reference area, lengths and point of the aircraft, for coefficients of forces."""

from dataclasses import dataclass

from sdm_deflect.geometry.parameters import Fighter


@dataclass(frozen=True, slots=True)
class ReferenceValues:
    """Area (m2), chord and span (m) to which coefficients refer, and the point (3,) of moments (m)."""

    area: float
    chord: float
    span: float
    point: tuple[float, float, float]


def reference_values(fighter: Fighter) -> ReferenceValues:
    """Return those of the wing's trapezoid, continued to the plane of symmetry.

    The chord is the mean aerodynamic one, and moments are about its quarter point.
    """
    wing = fighter.wing
    taper = wing.tip_chord / wing.root_chord
    chord = 2.0 / 3.0 * wing.root_chord * (1.0 + taper + taper**2) / (1.0 + taper)
    area = wing.half_span * (wing.root_chord + wing.tip_chord)
    return ReferenceValues(area, chord, 2.0 * wing.half_span, (wing.x_te - 0.75 * chord, 0.0, 0.0))
