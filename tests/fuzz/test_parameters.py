"""The program that draws parameters: they are in range, the same for a seed, and judged by what becomes of them."""

from itertools import islice

from sdm_deflect.cases.aircraft.registry import CASES as REGISTERED
from tests.fuzz.parameters import SENTENCE, SETTINGS, TABLES, assignments, built, ranges, sets


def test_sets_are_in_range_and_the_same_for_a_seed():
    known = ranges(REGISTERED["tail"], TABLES + SETTINGS)
    assert {"wing.half_span", "blending.strip", "confinement.aft", "angle"} <= known.keys()
    first, again, other = (list(islice(sets(seed), 200)) for seed in (1, 1, 2))
    assert first == again != other
    for name, changed in first:
        assert name in REGISTERED
        assert 1 <= len(changed) <= 4
        assert all(known[key][1] <= value <= known[key][2] for key, value in changed.items())


def test_a_set_that_builds_nothing_is_a_sentence():
    changed = {"pedestal.x_apex": 0.0}
    assert assignments(changed) == ["pedestal.x_apex=0.0"]
    kind, text = built("aileron", changed)
    assert (kind, "pedestal.x_apex = 0" in text) == (SENTENCE, True)
