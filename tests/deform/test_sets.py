"""Sets of numbers are what NumPy finds."""

import numpy as np
import pytest

from sdm_deflect.base.arrays import count_distinct, distinct


@pytest.mark.parametrize("size", [0, 1, 2, 50])
def test_distinct_numbers_and_how_often_they_occur(size):
    values = np.random.default_rng(size).integers(0, 9, size).astype(np.uint64)
    known, count = np.unique(values, return_counts=True)
    assert distinct(values).tolist() == known.tolist()
    found = count_distinct(values.copy())
    assert [found[0].tolist(), found[1].tolist()] == [known.tolist(), count.tolist()]
