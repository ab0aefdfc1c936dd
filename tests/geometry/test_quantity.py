from dataclasses import dataclass

import numpy as np
import pytest

from sdm_deflect.geometry.quantity import check_quantities, quantity


@dataclass(frozen=True, slots=True)
class Sample:
    length: float = quantity(1.0, "m", 0.5, 2.0, "a length")
    count: int = quantity(3, "", 1, 9, "a number of things")
    name: str = "free"

    def __post_init__(self) -> None:
        check_quantities(self, "sample")


def test_values_on_the_border_of_the_range_are_accepted():
    assert Sample(length=0.5, count=9).length == 0.5
    assert Sample(length=np.float64(2.0), count=np.int64(1)).count == 1


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"length": -1.0}, r"sample.length = -1 m is outside 0.5 ... 2 m"),
        ({"length": float("nan")}, r"sample.length = nan m is outside"),
        ({"length": float("inf")}, r"sample.length = inf m is outside"),
        ({"length": True}, r"sample.length = True is not a number"),
        ({"length": "1"}, r"sample.length = '1' is not a number; it must be 0.5 ... 2 m"),
        ({"count": 2.5}, r"sample.count = 2.5 is not a whole number; it must be 1 ... 9$"),
        ({"count": 10}, r"sample.count = 10 is outside 1 ... 9$"),
    ],
)
def test_the_message_names_value_unit_and_range(values, message):
    with pytest.raises(ValueError, match=message):
        Sample(**values)
