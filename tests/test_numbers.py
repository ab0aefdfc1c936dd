"""Numbers in sentences."""

import pytest

from sdm_deflect.base.numbers import apart, percent


@pytest.mark.parametrize(
    ("value", "limit", "texts"),
    [
        (2.875, 2.88, ("2.875", "2.88")),
        (2.9, 2.88, ("2.9", "2.88")),
        (1.0, 1.0, ("1", "1")),
        (0.99999999, 1.0, ("0.99999999", "1")),
        (float("nan"), 1.0, ("nan", "1")),
    ],
)
def test_a_value_that_passed_looks_as_if_it_did(value, limit, texts):
    assert apart(value, limit) == texts


def test_per_cent_has_a_space():
    assert (percent(0.784), percent(0.00123, 3)) == ("78 %", "0.123 %")
