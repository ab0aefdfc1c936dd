"""The bisection brackets the angle at which the quality falls below the threshold."""

import csv

import pytest

from sdm_deflect.cases.limit import attempt, find_limits, write_limits
from sdm_deflect.cases.registry import case_named

pytestmark = pytest.mark.mesher


def test_limits_bracket_the_threshold(aileron_mesh, tmp_path):
    mesh, _ = aileron_mesh
    case, threshold, resolution = case_named("aileron"), 0.3, 6.0
    limits = find_limits(case, mesh, threshold, resolution, lambda text, fraction: None)
    for sign, limit in zip((-1.0, 1.0), limits, strict=True):
        assert sign * limit.angle > 0.0
        good = [t for t in limit.trials if t.quality_min >= threshold]
        bad = [t for t in limit.trials if t.quality_min < threshold]
        assert max(abs(t.angle) for t in good) == abs(limit.angle)
        assert not bad or min(abs(t.angle) for t in bad) - abs(limit.angle) <= resolution
        assert attempt(case, mesh, limit.angle).quality_min >= threshold
    write_limits(limits, case, threshold, tmp_path)
    rows = list(csv.DictReader((tmp_path / "limit.csv").read_text().splitlines()))
    assert len(rows) == sum(len(limit.trials) for limit in limits)
    assert (tmp_path / "limit.png").stat().st_size > 5_000


def test_an_angle_that_leaves_the_hexahedron_is_no_limit_but_has_a_reason(aileron_mesh):
    mesh, _ = aileron_mesh
    trial = attempt(case_named("tail"), mesh, 60.0)
    assert trial.quality_min == 0.0
    assert "hexahedron" in trial.reason or "fuselage" in trial.reason
