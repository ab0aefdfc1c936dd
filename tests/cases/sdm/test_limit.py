"""The bisection brackets the angle at which the quality falls below the threshold."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.base.threads import silent
from sdm_deflect.cases.aircraft.pipeline import case_search
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.limit import STEPS, write_limits
from sdm_deflect.geometry.parameters import LARGEST_TURN
from tests.pictures import pixels, share

pytestmark = pytest.mark.mesher
MODES = ("off", "auto")


def test_limits_bracket_the_threshold(aileron_mesh, tmp_path):
    mesh, _ = aileron_mesh
    case, threshold, resolution = replace(case_named("tail"), repair="auto"), 0.25, 10.0
    search = case_search(case, mesh, threshold, resolution)
    limits = search.limits(case.repair, silent)
    assert [(limit.repair, np.sign(limit.angle)) for limit in limits] == [(m, s) for m in MODES for s in (-1.0, 1.0)]
    for limit in limits:
        sizes, good = [abs(t.angle) for t in limit.trials], [t.quality_min >= threshold for t in limit.trials]
        assert sizes == sorted(sizes)
        k = sizes.index(abs(limit.angle))
        assert all(good[: k + 1])
        beyond = limit.trials[k + 1]
        assert not good[k + 1]
        assert 0.0 < sizes[k + 1] - sizes[k] <= resolution
        assert limit.end == beyond.reason or f"least quality {beyond.quality_min:.3f} of a cell" in limit.end
        assert max(np.diff(sizes)) <= STEPS * resolution
        assert search.trial(limit.angle, limit.repair) == limit.at
    places = ("of a cell at fuselage_panel_left", "of a cell within the flow")
    for alone, repaired, place in zip(limits[:2], limits[2:], places, strict=True):
        assert abs(repaired.angle) > abs(alone.angle)
        assert place in alone.end
        assert "root leaves the fuselage" in repaired.end
    write_limits(limits, search, tmp_path)
    rows = list(csv.DictReader((tmp_path / "limit.csv").read_text().splitlines()))
    assert len(rows) == sum(len(limit.trials) for limit in limits) - len(MODES)  # zero is in both signs
    assert {row["repair"] for row in rows} == set(MODES)
    image = pixels(tmp_path / "limit.png")
    for colour in ((0x1A, 0x73, 0xC9), (0xD1, 0x35, 0x0F)):
        assert share(image, colour) > 1e-3  # the angles tried
    grey = np.abs(image - 102).max(axis=-1) <= 60
    assert grey.sum(axis=1).max() > 0.85 * image.shape[1]  # the threshold, from edge to edge


def test_no_surface_is_tried_beyond_what_any_can_turn(aileron_mesh):
    case = case_named("all")
    case = replace(case, deflections=tuple(one for one in case.deflections if one.surface == "rudder"))
    limits = case_search(case, aileron_mesh[0], 0.01, 30.0).limits("off", silent)
    assert [limit.repair for limit in limits] == ["off", "off"]
    assert max(abs(trial.angle) for limit in limits for trial in limit.trials) == LARGEST_TURN / 1.25
    with pytest.raises(ValueError, match=r"turns the rudder by 86\.25 deg; at most 85 deg"):
        replace(case, angle=69.0)


def tried(case, mesh, angle):
    return case_search(case, mesh, 0.2, 1.0).trial(angle, case.repair)


def test_a_tail_whose_root_misses_the_fuselage_is_no_limit_but_has_a_reason(aileron_mesh):
    trial = tried(case_named("tail"), aileron_mesh[0], 60.0)
    assert (trial.quality_min, trial.steps) == (0.0, 0)
    assert "root leaves the fuselage" in trial.reason


def test_an_aileron_that_leaves_its_hexahedron_is_no_limit_but_has_a_reason(aileron_mesh):
    case = case_named("aileron")
    low = replace(case, confinement=replace(case.confinement, up=0.005))
    assert tried(low, aileron_mesh[0], 5.0).reason == ""
    trial = tried(low, aileron_mesh[0], -30.0)
    assert (trial.quality_min, trial.steps) == (0.0, 0)
    assert "moving nodes of aileron_left leave the box at -30; enlarge it (confinement.up, down" in trial.reason
