"""How good a cell can be whose dihedral angle at one edge is given."""

import numpy as np
import pytest

from benchmarks.repair_reliability import Trial, dihedral, dihedral_bound, table
from sdm_deflect.deform.mesh.quality import mean_ratio


def test_the_regular_tetrahedron_has_the_angle_of_the_best_one():
    assert dihedral_bound(np.arccos(1.0 / 3.0)) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.nightly
@pytest.mark.parametrize("degrees", [20.0, 110.0, 164.3, 177.3])
def test_no_cell_with_this_angle_is_better(degrees):
    rng, angle = np.random.default_rng(4), np.radians(degrees)
    best = 0.0
    for _ in range(20_000):
        (a, b, c, d), (u, v) = rng.uniform(0.05, 2.0, 4), rng.uniform(-1.0, 1.0, 2)
        corners = np.array([[-a, 0, 0], [b, 0, 0], [u, c, 0], [v, d * np.cos(angle), d * np.sin(angle)]])
        best = max(best, float(mean_ratio(corners, np.array([[0, 1, 2, 3]]))[0]))
    assert dihedral(*corners) == pytest.approx(angle)
    assert 0.9 * dihedral_bound(angle) < best <= dihedral_bound(angle)


def test_the_table_counts_what_is_short():
    good, bad = (Trial(0.5, 0.1, 2, least, 0, bound, 0.1) for least, bound in ((0.4, 1.0), (0.2, 0.21)))
    row = table({"aileron +60": [good, bad]}, {"aileron +60": 0.35}).splitlines()[2]
    assert "| 1 of 2 | 0.200 | 0.300 |" in row
    assert "| 1 of 1 |" in row
