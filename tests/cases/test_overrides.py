"""Variations of a case: what is set is set, what is not is as before, what is wrong is named."""

from dataclasses import replace
from tomllib import loads

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdm_deflect.cases.overrides import parse_assignments, to_toml, with_overrides
from sdm_deflect.cases.registry import CASES, case_named

AILERON = CASES["aileron"]


@given(st.floats(0.25, 0.45), st.integers(1, 50))
def test_assignment_replaces_that_value_alone(half_span, n_add):
    nested = parse_assignments([f"wing.half_span={half_span!r}", f"adaptation.n_add={n_add}"])
    changed = with_overrides(AILERON, nested)
    assert changed.fighter.wing.half_span == half_span
    assert changed.adaptation.n_add == n_add
    wing = replace(changed.fighter.wing, half_span=AILERON.fighter.wing.half_span)
    restored = replace(
        changed, fighter=replace(changed.fighter, wing=wing), adaptation=AILERON.adaptation
    )
    assert restored == AILERON


@pytest.mark.parametrize("name", sorted(CASES))
def test_toml_repeats_the_case(name):
    case = case_named(name, "medium")
    assert with_overrides(case_named(name), loads(to_toml(case))) == case


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("wing.half_span=-1", r"wing\.half_span = -1 m is outside"),
        ("wing.half_span=nan", r"wing\.half_span = nan m is outside"),
        ("wing.half_span=wide", r"wing\.half_span = wide is not a number"),
        ("wing.halfspan=0.3", r"unknown parameter .*wing\.halfspan; did you mean half_span\?"),
        ("adaptation.n_add=1.5", r"adaptation\.n_add = 1\.5 is not a whole number"),
        ("adaptation.tolerance=0", r"adaptation\.tolerance = 0 m is outside"),
        ("adaptation.max_centers=9", r"adaptation\.max_centers = 9 is fewer than the 20 initial centres"),
        ("aileron.gap=0.5", r"gap"),
        ("angle=95", r"case\.angle = 95 deg is outside -60 \.\.\. 60 deg"),
        ("strategy=both", r"strategy = 'both' is not one of squv, mv"),
        ("wing=3", r"wing is a table"),
        ("half_span", r"not of the form key=value"),
    ],
)
def test_wrong_value_is_named(assignment, message):
    with pytest.raises(ValueError, match=message):
        with_overrides(AILERON, parse_assignments([assignment]))
