"""The bisection brackets the angle at which the quality falls below the threshold."""

import csv
from dataclasses import replace
from math import ceil, log2

import numpy as np
import pytest

from sdm_deflect.cases.sdm.limit import attempt, find_limits, write_limits
from sdm_deflect.cases.sdm.registry import case_named
from sdm_deflect.deform.fitting import LARGEST_ANGLE
from tests.pictures import pixels, share

pytestmark = pytest.mark.mesher


def test_limits_bracket_the_threshold(aileron_mesh, tmp_path):
    mesh, _ = aileron_mesh
    case, threshold, resolution = case_named("aileron"), 0.3, 6.0
    limits = find_limits(case, mesh.as_mesh(), threshold, resolution, lambda text, fraction: None)
    for sign, limit in zip((-1.0, 1.0), limits, strict=True):
        assert sign * limit.angle > 0.0
        good = [t for t in limit.trials if t.quality_min >= threshold]
        bad = [t for t in limit.trials if t.quality_min < threshold]
        assert max(abs(t.angle) for t in good) == abs(limit.angle)
        if bad:
            assert 0.0 < min(abs(t.angle) for t in bad) - abs(limit.angle) <= resolution
        else:
            assert abs(limit.angle) == LARGEST_ANGLE
        assert attempt(case, mesh.as_mesh(), limit.angle).quality_min >= threshold
        assert len(limit.trials) <= 1 + ceil(log2(LARGEST_ANGLE / resolution))
    write_limits(limits, case, threshold, tmp_path)
    rows = list(csv.DictReader((tmp_path / "limit.csv").read_text().splitlines()))
    assert len(rows) == sum(len(limit.trials) for limit in limits)
    image = pixels(tmp_path / "limit.png")
    assert share(image, (0x00, 0x72, 0xB2)) > 1e-3  # the angles tried
    grey = np.abs(image - 102).max(axis=-1) <= 60
    assert grey.sum(axis=1).max() > 0.85 * image.shape[1]  # the threshold, from edge to edge


def test_no_surface_is_tried_beyond_what_any_can_turn(aileron_mesh):
    case = case_named("all")
    case = replace(case, deflections=tuple(one for one in case.deflections if one.surface == "rudder"))
    limits = find_limits(case, aileron_mesh[0].as_mesh(), 0.01, 30.0, lambda text, fraction: None)
    assert max(abs(trial.angle) for limit in limits for trial in limit.trials) == LARGEST_ANGLE / 1.25
    with pytest.raises(ValueError, match=r"turns the rudder by 91\.25 deg; at most 90 deg"):
        replace(case, angle=73.0)


def test_a_tail_whose_root_misses_the_fuselage_is_no_limit_but_has_a_reason(aileron_mesh):
    trial = attempt(case_named("tail"), aileron_mesh[0].as_mesh(), 60.0)
    assert (trial.quality_min, trial.steps) == (0.0, 0)
    assert "root misses the fuselage" in trial.reason


def test_an_aileron_that_leaves_its_hexahedron_is_no_limit_but_has_a_reason(aileron_mesh):
    case = case_named("aileron")
    low = replace(case, confinement=replace(case.confinement, up=0.005))
    assert attempt(low, aileron_mesh[0].as_mesh(), 5.0).reason == ""
    trial = attempt(low, aileron_mesh[0].as_mesh(), -30.0)
    assert (trial.quality_min, trial.steps) == (0.0, 0)
    assert "moving nodes of aileron_left leave the box at -30; enlarge it (confinement.up, down" in trial.reason
