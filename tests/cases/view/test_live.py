"""A run turned to other angles: what it must reproduce, keep and own up to."""

from dataclasses import replace

import numpy as np
import pytest
from sdm_deflect.cases.view.stored import Stored

from sdm_deflect.cases.sdm.registry import case_named
from sdm_deflect.cases.view.live import Live
from sdm_deflect.cases.view.span import Spans
from sdm_deflect.deform.errors import InputError
from sdm_deflect.deform.quality import mean_ratio
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline

pytestmark = pytest.mark.mesher
EQUAL = 1e-11  # m


@pytest.mark.parametrize(
    "case",
    [
        case_named("aileron"),
        replace(case_named("aileron"), strategy="mv"),
        case_named("tail"),
        case_named("rudder"),
        case_named("aileron-chimera"),
        case_named("all"),
    ],
    ids=lambda case: f"{case.name}-{case.strategy}",
)
def test_the_runs_angle_gives_the_runs_mesh(case, bare_run):
    folder = bare_run(case)
    live, stored = Live.of(folder), Stored.of(folder)
    frame = live.at(case.angle)
    assert np.abs(frame.points - stored.deflected).max() < EQUAL
    assert frame.verified


def test_every_step_of_a_run_in_steps_is_met(stepped_folder):
    live, stored = Live.of(stepped_folder), Stored.of(stepped_folder)
    assert [len(part.stages) for part in live.parts] == [2]
    assert np.abs(live.at(-12.0).points - stored.deflected).max() < EQUAL
    before, after = live.at(-6.0), live.at(-6.0 - 1e-6)  # the first stage's end is the second's beginning
    assert before.verified
    assert np.abs(before.points - after.points).max() < 1e-8


def test_zero_is_the_undeflected_mesh_bit_for_bit(aileron, tail):
    for live in (aileron, tail):
        frame = live.at(0.0)
        assert np.array_equal(frame.points, live.mesh.points)
        assert frame.residual == 0.0
        assert frame.verified


@pytest.mark.parametrize("angle", [-12.0, 3.0, 25.0])
def test_nodes_outside_keep_their_bits(aileron, tail, angle):
    for live in (aileron, tail):
        inside = np.concatenate([part.changed for part in live.parts])
        outside = np.setdiff1d(np.arange(len(live.mesh.points)), inside)
        assert np.array_equal(live.at(angle).points[outside], live.mesh.points[outside])


@pytest.mark.parametrize("angle", [-12.0, 7.5, 30.0])
def test_the_residual_is_that_of_an_interpolant_fitted_afresh(aileron, angle):
    (part,), frame = aileron.parts, aileron.at(angle)
    surface, worst = part.target(angle) - aileron.mesh.points[part.nodes], 0.0
    for group in part.stages[0].groups:
        values = np.zeros((len(group.sites), len(group.components)))
        values[: len(surface)] = surface[:, group.components]
        fresh = fit(ThinPlateSpline(), group.sites[group.chosen], values[group.chosen])
        worst = max(worst, np.abs(fresh(group.sites) - values).max())
    assert frame.residual == pytest.approx(worst, rel=1e-6, abs=1e-12)


def test_the_quality_is_that_of_the_cells_that_can_change(aileron):
    frame = aileron.at(-20.0)
    assert np.array_equal(frame.quality, mean_ratio(frame.points, aileron.cells))
    whole = np.sort(mean_ratio(frame.points, aileron.mesh.tets))
    parts = np.sort(np.concatenate([frame.quality, mean_ratio(aileron.mesh.points, aileron.outer)]))
    assert np.array_equal(whole, parts)


def test_the_surface_is_where_its_motion_puts_it(tail):
    part = tail.parts[0]
    assert np.array_equal(tail.at(5.0).points[part.nodes], part.target(5.0))


def test_far_beyond_the_run_it_is_not_verified(aileron):
    frame = aileron.at(45.0)
    assert frame.residual > frame.tolerance
    assert not frame.verified


def test_an_inverted_cell_is_not_verified(aileron):
    frame = aileron.at(-12.0)
    quality = frame.quality.copy()
    quality[7] = 0.0
    bad = replace(frame, quality=quality)
    assert bad.inverted.tolist() == [7]
    assert not bad.verified


def test_a_motion_that_does_not_exist_is_refused(tail):
    with pytest.raises(InputError):
        tail.at(45.0)
    for angle in (61.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match=r"outside -60 \.\.\. 60 deg"):
            tail.at(angle)


def test_the_spans_end_where_it_fails(tail):
    spans = Spans.of(tail)
    assert 12.0 in spans.verified
    for angle in (spans.verified.low, spans.verified.high):
        assert tail.at(angle).verified
    assert not tail.at(spans.verified.high + 0.5).verified
    for angle in (spans.possible.low - 0.5, spans.possible.high + 0.5):
        with pytest.raises(InputError):
            tail.at(angle)
    assert "hexahedron" in spans.possible.below
