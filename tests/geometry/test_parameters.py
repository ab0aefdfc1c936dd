"""Parameters and their cross checks."""

from dataclasses import fields, is_dataclass
from math import inf

import pytest

from sdm_deflect.base.schema import Range, settings_in
from sdm_deflect.geometry.parameters import (
    Aileron,
    Fighter,
    Fin,
    Fuselage,
    Pedestal,
    Rudder,
    Tail,
    VentralFin,
    Wing,
    aileron_span,
)


def test_every_parameter_is_a_plain_number_with_unit_range_and_meaning():
    for component in fields(Fighter):
        section = getattr(Fighter(), component.name)
        assert is_dataclass(section)
        for parameter in settings_in(type(section)).values():
            assert parameter.note(Range).high < inf
            assert parameter.doc.text
            assert isinstance(parameter.of(section), float)


@pytest.mark.parametrize(
    ("section", "values", "message"),
    [
        (Wing, {"half_span": -1.0}, "^half_span = -1 m must be a number from 0.05 to 5 m$"),
        (Wing, {"half_span": float("nan")}, "^half_span = nan m must"),
        (Fuselage, {"panel_angle": 90.0}, "panel_angle = 90 deg must be a number from 20 to 75 deg"),
        (Aileron, {"gap": -0.001}, "gap = -0.001 m must be"),
    ],
)
def test_single_values_are_checked(section, values, message):
    with pytest.raises(ValueError, match=message):
        section(**values)


@pytest.mark.parametrize(
    ("components", "message"),
    [
        ({"aileron": Aileron(gap=0.5)}, "aileron.gap = 0.5 m is wider than the aileron"),
        ({"aileron": Aileron(gap=0.05, y_inboard=0.2, y_outboard=0.22)}, "wider than the aileron"),
        ({"aileron": Aileron(gap=1e-4)}, "aileron.gap = 0.0001 m is too narrow"),
        ({"aileron": Aileron(y_outboard=0.4)}, "aileron.y_outboard = 0.4 m is beyond the tip"),
        ({"aileron": Aileron(y_inboard=0.25, y_outboard=0.2)}, "must be at least 0.003 m apart"),
        ({"aileron": Aileron(gap=0.003, y_inboard=0.116)}, "aileron.y_inboard leaves a strip"),
        ({"aileron": Aileron(y_outboard=0.303)}, "aileron.y_outboard leaves a strip"),
        ({"wing": Wing(tip_chord=0.4)}, "wing.tip_chord = 0.4 m must lie at least"),
        ({"wing": Wing(y_kink=0.068)}, "fuselage.radius = 0.067 m must lie at least"),
        ({"tail": Tail(root_chord=0.18)}, "fuselage.panel_front = 0.755 m must lie at least"),
        ({"tail": Tail(le_sweep=60.0)}, "tail.le_sweep"),
        ({"tail": Tail(anhedral=30.0), "fuselage": Fuselage(panel_angle=35.0)}, "tail.anhedral = 30 deg"),
        ({"fuselage": Fuselage(panel_front=0.95)}, "fuselage.panel_front = 0.95 m"),
        ({"pedestal": Pedestal(half_width=0.037)}, "reaches the panels beside the tails"),
        ({"rudder": Rudder(z_inboard=0.08)}, "rudder.z_inboard = 0.08 m"),
        ({"rudder": Rudder(z_inboard=0.15, z_outboard=0.14)}, "rudder.z_outboard = 0.14 m"),
        ({"rudder": Rudder(z_outboard=0.212)}, "rudder.z_outboard = 0.212 m must be the fin's tip"),
        ({"fin": Fin(le_sweep=65.0)}, "fin.le_sweep"),
        ({"fin": Fin(root_chord=0.17)}, "pedestal.x_aft"),
        ({"ventral": VentralFin(x_te=0.78)}, "ventral.x_te = 0.78 m"),
    ],
)
def test_components_that_do_not_fit_are_named_in_one_line(components, message):
    with pytest.raises(ValueError, match=message) as caught:
        Fighter(**components)
    assert "\n" not in str(caught.value)


def test_the_aileron_reaches_the_tip_by_default_whatever_the_span():
    for half_span in (0.25, 0.3048, 0.4):
        span = aileron_span(Fighter(wing=Wing(half_span=half_span)))
        assert span.outboard == span.outer_rib == half_span
        assert span.wing_rib == span.inboard


def test_with_a_gap_the_wing_ends_at_its_kink_by_default():
    for gap in (0.002, 0.00427, 0.0042672):
        fighter = Fighter(aileron=Aileron(gap=gap))
        span = aileron_span(fighter)
        assert span.wing_rib == fighter.wing.y_kink
        assert span.inboard == pytest.approx(span.wing_rib + gap, abs=1e-12)


def test_an_aileron_short_of_the_tip_has_a_second_gap_of_the_same_width():
    span = aileron_span(Fighter(aileron=Aileron(gap=0.004, y_inboard=0.15, y_outboard=0.25)))
    assert span.inboard - span.wing_rib == pytest.approx(0.004, abs=1e-15)
    assert span.outer_rib - span.outboard == pytest.approx(0.004, abs=1e-15)
