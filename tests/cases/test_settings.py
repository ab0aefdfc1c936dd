"""Settings from text: what is set is set, what is not is as before, what is wrong is named."""

from dataclasses import replace
from tomllib import loads

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.aircraft.registry import CASES, case_named, resolve
from sdm_deflect.cases.settings.conversion import parse_assignments, structure, to_toml, with_values

AILERON = CASES["aileron"]


@given(st.floats(0.25, 0.45), st.integers(1, 50))
def test_assignment_replaces_that_value_alone(half_span, n_add):
    nested = parse_assignments([f"wing.half_span={half_span!r}", f"adaptation.n_add={n_add}"])
    after = with_values(AILERON, nested)
    assert after.fighter.wing.half_span == half_span
    assert after.adaptation.n_add == n_add
    wing = replace(after.fighter.wing, half_span=AILERON.fighter.wing.half_span)
    restored = replace(after, fighter=replace(after.fighter, wing=wing), adaptation=AILERON.adaptation)
    assert restored == AILERON


@pytest.mark.parametrize("scale", ["small", "medium", "paper"])
@pytest.mark.parametrize("name", sorted(CASES))
def test_toml_repeats_the_case(name, scale, tmp_path):
    case = case_named(name, scale)
    (tmp_path / "case.toml").write_text(to_toml(case), encoding="utf-8")
    assert structure(loads(to_toml(case)), type(case)) == case
    assert resolve("", config=tmp_path / "case.toml") == case


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("wing.half_span=-1", "wing.half_span = -1 m must be a number from 0.05 to 5 m"),
        ("wing.half_span=nan", "wing.half_span = nan is not a finite number"),
        ("wing.half_span=0.3\nangle=3", "wing.half_span = '0.3\\nangle=3' is not a number"),
        ("wing.half_span=wide", "wing.half_span = 'wide' is not a number"),
        ("wing.halfspan=0.3", "unknown setting wing.halfspan; did you mean half_span?"),
        ("wng.half_span=0.3", "unknown setting wng; did you mean wing?"),
        ("adaptation.n_add=1.5", "adaptation.n_add = 1.5 is not a whole number"),
        ("adaptation.max_centers=9", "adaptation.max_centers = 9 is fewer than the 20 initial centres"),
        ("aileron.gap=0.5", "gap"),
        ("angle=95", "angle = 95 deg must be a number from -85 to 85 deg"),
        ("adaptation.strategy=both", "adaptation.strategy = 'both' is not one of squv, mv"),
        ("strategy=mv", "unknown setting strategy; did you mean adaptation.strategy?"),
        ("half_span=0.3", "unknown setting half_span; did you mean wing.half_span, tail.half_span?"),
        ("domain=moon", "domain = 'moon' is not one of aircraft, block"),
        ("name=foo", "name = 'foo': a case keeps its name, aileron"),
        ("scale=huge", "unknown scale 'huge'; there are small, medium, paper"),
        ("wing=3", "wing = 3 is no table"),
        ("confinement.slide=1", "confinement.slide = 1 is neither true nor false"),
        ("confinement.corners=[[0, 1]]", "confinement.corners[0] = [0, 1] must hold 3 values"),
        ("deflections=[]", "deflections is empty; a case turns at least one control surface"),
        ("deflections=[{surface='ruder'}]", "unknown control surface 'ruder'; did you mean rudder?"),
        ("deflections=[{surface='rudder', factr=2}]", "unknown setting deflections[0].factr; did you mean factor"),
        ("deflections=[{factor=2}]", "deflections[0].surface is missing"),
        ("half_span", "not of the form key=value"),
        ("wing.=1", "not of the form key=value"),
    ],
)
def test_wrong_value_is_named(assignment, message):
    with pytest.raises(InputError) as caught:
        resolve("aileron", assignments=[assignment])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_scale_that_is_set_brings_its_sizes():
    assert resolve("aileron", assignments=["scale=medium"]) == case_named("aileron", "medium")


def test_a_configuration_keeps_its_sizes(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(to_toml(case_named("aileron", "medium")), encoding="utf-8")
    with pytest.raises(InputError, match="holds the sizes of medium"):
        resolve("", scale="paper", config=path)
    assert resolve("", scale="medium", angle=3.0, config=path) == replace(case_named("aileron", "medium"), angle=3.0)


@pytest.mark.parametrize("key", ["wing.half_span", "fighter.wing.half_span"])
def test_a_setting_of_the_aircraft_is_honoured_with_and_without_the_name_of_its_table(key):
    assert resolve("tail", assignments=[f"{key}=0.4"]).fighter.wing.half_span == 0.4
    with pytest.raises(InputError, match=r"unknown setting wing\.half_spanx; did you mean half_span"):
        resolve("tail", assignments=[f"{key}x=1"])
