"""Data sites, and the groups that SQUV and MV make of them."""

import numpy as np
import pytest

from sdm_deflect.deform.rbf.data_sites import DataSites, fixed_sites, join, multivariate, univariate

GRID = np.stack(np.meshgrid(*[np.arange(4.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def test_sites_reject_what_makes_the_matrix_singular():
    twice = np.vstack([GRID, GRID[5:7]])
    with pytest.raises(ValueError, match="2 data sites coincide with another, for example rows 5 and 64"):
        fixed_sites(twice)


@pytest.mark.parametrize(
    ("points", "values", "components", "match"),
    [
        (np.zeros((3, 2)), np.zeros((3, 1)), (0,), "points"),
        (np.zeros((0, 3)), np.zeros((0, 1)), (0,), "N > 0"),
        (GRID, np.zeros((64, 2)), (0,), "values"),
        (GRID, np.zeros((64, 1)), (3,), "components"),
        (GRID, np.zeros((64, 0)), (), "components"),
        (GRID, np.zeros((64, 2)), (1, 1), "twice"),
        (GRID, np.full((64, 1), np.nan), (1,), "values has a number that is not finite"),
    ],
)
def test_sites_reject_bad_arrays(points, values, components, match):
    with pytest.raises(ValueError, match=match):
        DataSites(points, values, components)


def test_joining_drops_and_counts_what_is_there_already():
    moved = DataSites(GRID[:10], np.zeros((10, 3)))
    both = join([moved, fixed_sites(GRID[5:20] + 1e-12)])
    assert len(both) == 20
    assert both.merged == 5
    assert np.array_equal(both.points[:10], GRID[:10])


def test_joining_refuses_contradictions():
    moved = DataSites(GRID[:10], np.ones((10, 3)))
    with pytest.raises(ValueError, match="5 pairs of coinciding data sites are to move differently"):
        join([moved, fixed_sites(GRID[5:20])])
    with pytest.raises(ValueError, match="cannot join"):
        join([moved, fixed_sites(GRID[20:], (1,))])
    with pytest.raises(ValueError, match="no data sites"):
        join([])


def _chimera():
    surface = DataSites(GRID[:10], np.arange(30.0).reshape(10, 3))
    return [surface, fixed_sites(GRID[10:30]), fixed_sites(GRID[30:40], (1,))]


def test_squv_is_one_problem_per_direction_with_its_own_sites():
    x, y, z = univariate(_chimera())
    assert [g.components for g in (x, y, z)] == [(0,), (1,), (2,)]
    assert [len(g) for g in (x, y, z)] == [30, 40, 30]
    assert np.array_equal(y.values[:10, 0], np.arange(1.0, 30.0, 3.0))
    assert not y.values[10:].any()


def test_mv_joins_the_directions_that_share_their_sites():
    xz, y = multivariate(_chimera())
    assert xz.components == (0, 2)
    assert y.components == (1,)
    assert [len(xz), len(y)] == [30, 40]
    (all_three,) = multivariate(_chimera()[:2])
    assert all_three.components == (0, 1, 2)


def test_directions_without_sites_are_no_problem_of_their_own():
    assert [g.components for g in univariate([fixed_sites(GRID, (2,))])] == [(2,)]
    assert [g.components for g in multivariate([fixed_sites(GRID, (2,))])] == [(2,)]
