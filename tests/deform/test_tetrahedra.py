"""Compiled judgement of very many tetrahedra: the bits of the other way."""

import numpy as np
import pytest

from sdm_deflect.deform import quality
from sdm_deflect.deform.mesh import Cells


@pytest.mark.parametrize("orientation", [1.0, -1.0])
@pytest.mark.parametrize("some", [False, True])
def test_many_tetrahedra_have_the_same_bits_as_few(orientation, some, monkeypatch):
    rng = np.random.default_rng(2)
    points = rng.normal(size=(500, 3))
    points[:5] = points[5]  # cells without size
    block = Cells("tetra", rng.integers(0, 500, (20_000, 4)))
    rows = rng.permutation(20_000)[:7000] if some else None
    values, inverted = quality.judged(points, block, rows, orientation)
    assert 0 < inverted.sum() < len(inverted)
    monkeypatch.setattr(quality, "MANY", 100)
    again, other = quality.judged(points, block, rows, orientation)
    assert again.tobytes() == values.tobytes()
    assert np.array_equal(other, inverted)
    assert np.array_equal(quality.inverted_of(points, block, rows, orientation), inverted)
