import numpy as np
import pytest

from benchmarks.workloads import aileron, chimera, points_around, tail


@pytest.mark.parametrize(
    ("build", "sites", "initial"), [(aileron, 1_040, 10), (chimera, 21_624, 40), (tail, 25_896, 200)]
)
def test_sizes_are_the_papers(build, sites, initial):
    workload = build()
    assert len(workload.sites) == sites
    assert len(set(workload.initial.tolist())) == initial
    assert workload.region.contains(workload.sites.points, 1e-9).all()
    moving = workload.sites.values.any(axis=1)
    assert 0.05 < moving.mean() < 0.95


def test_points_are_inside_first_and_outside_then():
    region = tail().region
    points = points_around(region, 500, 2_000)
    inside = region.contains(points)
    assert inside[:500].all()
    assert not inside[500:].any()
    assert len(np.unique(points, axis=0)) == 2_500
