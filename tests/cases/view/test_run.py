"""A run turned to other angles: what it must reproduce, keep and own up to."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.aircraft.run_folder import FinishedCase
from sdm_deflect.cases.view.run import InteractiveRun, Spans
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.quality import mean_ratio
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline

pytestmark = pytest.mark.mesher
EQUAL = 1e-11  # m


def adapted(case, **values):
    return replace(case, adaptation=replace(case.adaptation, **values))


@pytest.mark.parametrize(
    "case",
    [
        case_named("aileron"),
        adapted(case_named("aileron"), strategy="mv"),
        case_named("tail"),
        case_named("rudder"),
        case_named("aileron-chimera"),
        case_named("all"),
    ],
    ids=lambda case: f"{case.name}-{case.strategy}",
)
def test_the_runs_angle_gives_the_runs_mesh(case, bare_run):
    folder = bare_run(case)
    finished = FinishedCase.of(folder)
    run, stored = InteractiveRun.of(finished), finished.deflected
    frame = run.at(case.angle)
    assert np.abs(frame.points + run.moved - stored.points).max() < EQUAL
    assert run.repaired(frame).fits


def test_every_step_of_a_run_in_steps_is_met(stepped_folder):
    finished = FinishedCase.of(stepped_folder)
    run, stored = InteractiveRun.of(finished), finished.deflected
    assert [len(box.steps) for box in run.boxes] == [2]
    assert np.abs(run.at(-12.0).points - stored.points).max() < EQUAL
    before, after = run.at(-6.0), run.at(-6.0 - 1e-6)  # the first step's end is the second's beginning
    assert before.fits
    assert np.abs(before.points - after.points).max() < 1e-8


def test_zero_is_the_undeflected_mesh_bit_for_bit(aileron, tail):
    for run in (aileron, tail):
        frame = run.at(0.0)
        assert np.array_equal(frame.points, run.mesh.points)
        assert frame.residual == 0.0
        assert frame.fits


@pytest.mark.parametrize("angle", [-12.0, 7.5, 30.0])
def test_the_residual_is_that_of_an_interpolant_fitted_afresh(aileron, angle):
    (box,), frame = aileron.boxes, aileron.at(angle)
    state, worst = box.steps[0].state, 0.0
    groups = state.groups(state.values(box.plan.boundary.displacement((angle,))), sliding=False)
    for prepared, group in zip(box.steps[0].all, groups, strict=True):
        fresh = fit(ThinPlateSpline(), *(at[prepared.basis.chosen] for at in (group.points, group.values)))
        worst = max(worst, np.abs(fresh(group.points) - group.values).max())
    assert frame.residual == pytest.approx(worst, rel=1e-6, abs=1e-12)


def test_the_quality_is_that_of_the_cells_that_can_change(aileron):
    frame, tets = aileron.at(-20.0), aileron.mesh.cells[0].nodes
    (rows,) = aileron.touched.rows
    assert np.array_equal(frame.quality, mean_ratio(frame.points, tets[rows]))
    whole = np.sort(mean_ratio(frame.points, tets))
    outer = np.delete(tets, rows, axis=0)
    parts = np.sort(np.concatenate([frame.quality, mean_ratio(aileron.mesh.points, outer)]))
    assert np.array_equal(whole, parts)


def test_a_mesh_with_an_inverted_cell_does_not_fit_unless_it_was_before(aileron):
    bad = replace(aileron.at(-12.0), inverted=np.array([7]))
    assert not bad.fits
    assert replace(bad, before=np.array([7])).fits


def test_a_motion_that_does_not_exist_is_refused(tail):
    with pytest.raises(InputError):
        tail.at(45.0)
    for angle in (91.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match=r"outside -85 \.\.\. 85"):
            tail.at(angle)


def test_the_spans_end_where_it_fails(tail):
    """Its centres are those of 12 degrees: on some meshes the error is above the tolerance from 5 degrees on."""
    spans = Spans.of(tail)
    assert tail.at(12.0).fits
    assert spans.fits.low < 0.0 < spans.fits.high
    for angle in (spans.fits.low, spans.fits.high):
        assert tail.at(angle).fits
    assert not tail.at(spans.fits.high + 0.5).fits
    for angle in (spans.possible.low - 0.5, spans.possible.high + 0.5):
        with pytest.raises(InputError):
            tail.at(angle)
    assert "leave the box" in spans.possible.below or "leaves the fuselage" in spans.possible.below
