"""Repaired meshes on display: the interpolant's while the slider moves, the repaired one where it rests."""

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.run_folder import FinishedCase
from sdm_deflect.cases.report.finished import FinishedRun, moved_by_repair
from sdm_deflect.cases.view.page import View, mending
from sdm_deflect.cases.view.run import InteractiveRun
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.meshing.formats.vtu import vtu_arrays, write_vtu
from tests.cases.view.conftest import words

pytestmark = pytest.mark.mesher
EQUAL = 1e-11  # m


def test_at_rest_the_runs_angle_shows_the_runs_mesh(repaired, repaired_folder):
    stored = FinishedCase.of(repaired_folder).deflected
    moving = repaired.at(33.0)
    resting = repaired.repaired(moving)
    assert np.array_equal(resting.points, stored.points)
    assert len(moving.inverted)
    assert not len(resting.inverted)
    assert resting.fits
    assert np.abs(moving.points + repaired.moved - stored.points).max() < EQUAL
    assert resting.repaired == np.count_nonzero(repaired.moved.any(axis=1))


def test_other_angles_are_repaired_within_the_box(repaired):
    moving = repaired.at(28.0)
    resting = repaired.repaired(moving)
    assert resting.quality.min() > 2.0 * moving.quality.min()
    differing = (resting.points != moving.points).any(axis=1)
    assert np.count_nonzero(differing) == resting.repaired
    assert np.isin(np.flatnonzero(differing), repaired.changed[0]).all()


def test_a_frame_that_is_good_enough_stays(repaired, aileron):
    frame = repaired.at(2.0)
    resting = repaired.repaired(frame)
    assert resting.repaired == 0
    assert np.array_equal(resting.points, frame.points)
    off = aileron.at(-12.0)
    assert not aileron.repairs
    assert aileron.repaired(off) is off


def test_the_page_gets_the_repaired_mesh_at_rest_and_is_told(repaired_folder, aileron):
    view = View.of(FinishedCase.of(repaired_folder))
    assert "Repaired" in words(view.answer({"angle": 33.0, "rests": True}, None)[0])["notes"][-1]
    answer, moving = view.answer({"angle": 28.0}, None)
    assert "once the slider rests" in words(answer)["notes"][-1]
    answer, shown = view.answer({"angle": 28.0, "rests": True}, moving)
    least, now = moving.quality.min(), shown.quality.min()
    assert words(answer)["notes"][-1] == (
        f"Repaired: {shown.repaired:,} nodes moved, least quality {least:.3f} \N{RIGHTWARDS ARROW} {now:.3f}."
    )
    assert words(view.answer({"angle": 2.0, "rests": True}, None)[0])["notes"][-1] == "Repair: none was needed."
    assert "off" in mending(aileron.at(-12.0), aileron, 0.4)


def test_any_mesh_shows_its_repair(bare_deflection, block):
    body = ("body", [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]], 60.0)
    folder = bare_deflection(block, "x.su2", *body, repair="always", min_quality=0.9)
    finished = FinishedRun.of(folder)
    run, points = InteractiveRun.of(finished), finished.points
    assert run.moved.any()
    assert np.array_equal(run.repaired(run.at(60.0)).points, points)


def test_an_array_of_another_shape_is_refused(repaired_folder, tmp_path):
    mesh = FinishedCase.of(repaired_folder).deflected
    write_vtu(tmp_path / "deflected.vtu", mesh, {"repair": mesh.points[:, :2].copy()})
    with pytest.raises(InputError, match="its array repair is not"):
        moved_by_repair(tmp_path / "deflected.vtu", len(mesh.points))
    assert moved_by_repair(repaired_folder / "undeflected.vtu", len(mesh.points)) is None
    assert vtu_arrays(repaired_folder / "deflected.vtu")["repair"].shape == mesh.points.shape


def test_a_run_whose_repair_is_lost_is_refused(repaired_folder, tmp_path):
    for path in repaired_folder.iterdir():
        if path.is_file():
            (tmp_path / path.name).write_bytes(path.read_bytes())
    write_vtu(tmp_path / "deflected.vtu", FinishedCase.of(repaired_folder).deflected)
    with pytest.raises(InputError, match=r"deflected\.vtu does not belong"):
        InteractiveRun.of(FinishedCase.of(tmp_path))
