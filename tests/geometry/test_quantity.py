from dataclasses import dataclass

import numpy as np
import pytest

from sdm_deflect.geometry.quantity import Checked, quantity


@dataclass(frozen=True, slots=True)
class Sample(Checked):
    length: float = quantity(1.0, "m", 0.5, 2.0, "a length")
    count: int = quantity(3, "", 1, 9, "a number of things")
    name: str = "free"


def test_values_on_the_border_of_the_range_are_accepted():
    assert Sample(length=0.5, count=9).length == 0.5
    assert Sample(length=np.float64(2.0), count=np.int64(1)).count == 1


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"length": -1.0}, "length = -1 m must be a number from 0.5 to 2 m"),
        ({"length": float("nan")}, "length = nan m must be"),
        ({"length": float("inf")}, "length = inf m must be"),
        ({"length": True}, "length = True must be a number"),
        ({"length": "1"}, "length = '1' must be a number from 0.5 to 2 m"),
        ({"count": 2.5}, "count = 2.5 must be a whole number from 1 to 9"),
        ({"count": 10}, "count = 10 must be a whole number from 1 to 9"),
    ],
)
def test_the_message_names_value_unit_and_range(values, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        Sample(**values)
