"""Reference values against the wing's and the surfaces' own corners."""

import numpy as np
import pytest

from sdm_deflect.geometry.datum import SURFACES, hinge_line, trailing_edge
from sdm_deflect.geometry.parameters import Fighter, reference_values
from studies.flow.reference import surface_reference


def test_the_mean_chord_is_the_integral_of_the_square_of_the_chord():
    fighter = Fighter()
    y = np.linspace(0.0, fighter.wing.half_span, 200_001)
    chord = fighter.wing.root_chord + (fighter.wing.tip_chord - fighter.wing.root_chord) * y / fighter.wing.half_span
    values = reference_values(fighter)
    assert values.point == pytest.approx((fighter.wing.x_te - 0.75 * values.chord, 0.0, 0.0))
    assert values.area == pytest.approx(2.0 * np.trapezoid(chord, y), rel=1e-9)
    assert values.chord == pytest.approx(np.trapezoid(chord**2, y) / np.trapezoid(chord, y), rel=1e-8)


@pytest.mark.parametrize("surface", SURFACES)
def test_a_surface_has_its_area_behind_the_hinge(surface):
    fighter = Fighter()
    values = surface_reference(fighter, surface)
    assert values.area == pytest.approx(values.chord * values.span)
    if surface.startswith("tail"):
        mirrored = surface_reference(fighter, "tail_left" if surface == "tail_right" else "tail_right")
        assert values.area == pytest.approx(mirrored.area)
        assert fighter.tail.root_chord > values.chord > 0.4 * fighter.tail.root_chord
        return
    front, back = hinge_line(fighter, surface), trailing_edge(fighter, surface)
    if np.linalg.norm(front[0] - back[0]) > np.linalg.norm(front[0] - back[1]):
        front = front[::-1]
    chords = back[:, 0] - front[:, 0]
    if surface != "rudder":
        assert values.chord == pytest.approx(chords.mean(), rel=1e-2)
    assert 0.5 * chords.min() < values.chord < 1.5 * chords.max()
