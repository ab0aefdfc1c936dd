"""Deflections of any mesh on display: every type of cell, sliding patches, tables, several surfaces in one box."""

import re
from shlex import split

import numpy as np
import pytest

from sdm_deflect.cases.api import read
from sdm_deflect.cases.report.finished import FinishedRun
from sdm_deflect.cases.run.mesh_files import write_mesh
from sdm_deflect.cases.view.page import View
from sdm_deflect.cases.view.run import InteractiveRun, Spans
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.axis import Axis
from sdm_deflect.deform.surface.motions import Moving, Rotation
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import Job
from sdm_deflect.deform.volume.plan import Plan
from tests.calls import sdm
from tests.cases.view.conftest import words, written
from tests.deform.blocks import two_bodies
from tests.limits import limited
from tests.meshing.formats.examples import polyhedral

EQUAL = 1e-9  # of a mesh of size 1
BODY = ("body", [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]], 10.0)


def test_a_hybrid_mesh_that_slides_is_reproduced(hybrid, wing_folder):
    points = FinishedRun.of(wing_folder).points
    frame = hybrid.at(10.0)
    assert hybrid.boxes[0].steps[0].first
    assert np.abs(frame.points - points).max() < EQUAL
    assert frame.fits
    assert np.array_equal(hybrid.at(0.0).points, hybrid.mesh.points)
    symmetry = hybrid.mesh.patch("symmetry").nodes
    assert np.abs(hybrid.at(7.0).points[symmetry, 1]).max() == 0.0


@pytest.mark.parametrize("many", [False, True])
def test_a_page_gets_the_points_and_qualities_of_cells_of_any_type(block, bare_deflection, many):
    mesh = polyhedral(block) if many else block
    folder = bare_deflection(mesh, "case/x.foam" if many else "x.su2", *BODY, fixed="?-")
    view = View.of(FinishedRun.of(folder))
    answer, frame = view.answer({"angle": "-10", "rests": True}, None)
    assert words(answer)["fits"] is frame.fits
    values = np.frombuffer(answer, dtype="<f4", offset=4 + int.from_bytes(answer[:4], "little"))
    rows = np.concatenate([own for _, own in view.parts if own is not None])
    assert np.array_equal(np.sort(rows), np.arange(len(frame.quality)))
    for nodes, own in view.parts:
        points, values = values[: 3 * len(nodes)].reshape(-1, 3), values[3 * len(nodes) :]
        assert np.array_equal(points, frame.points[nodes].astype(np.float32))
        if own is not None:
            quality, values = values[: len(own)], values[len(own) :]
            assert np.array_equal(quality, frame.quality[own].astype(np.float32))
    assert not len(values)


def test_inverted_cells_are_counted(block, bare_deflection):
    view = View.of(FinishedRun.of(bare_deflection(polyhedral(block), "case/x.foam", *BODY, repair="off")))
    answer, frame = view.answer({"angle": 80.0, "rests": True}, None)
    assert f"{len(frame.inverted)} inverted cells" in words(answer)["status"]
    assert not words(answer)["fits"]


def test_the_page_writes_nothing_and_says_that_the_command_makes_all_checks(wing_folder):
    """Once it called meshes verified that `sdm deflect` fails, and wrote them."""
    view, before = View.of(FinishedRun.of(wing_folder)), sorted(wing_folder.parent.rglob("*"))
    answer, frame = view.answer({"angle": 4}, None)
    assert "which makes all checks and writes the mesh" in view.html(1)
    assert "erified" not in words(answer)["status"] + view.html(1)
    assert "is not a number" in view.answer({"save": True}, frame)[0]["said"]
    assert sorted(wing_folder.parent.rglob("*")) == before
    command = view.finished.command
    assert command.startswith("sdm deflect")
    assert sdm(*split(command.replace("ANGLE", "4"))[1:], "--dry-run", "--quiet") == 0


@pytest.mark.parametrize(
    ("text", "angle"),
    [("12", 12.0), (" -3,5° ", -3.5), ("\u22122.25", -2.25), ("95", None), ("steep", None), ("", None)],
)
def test_angles_are_read_or_refused_with_a_sentence(wing_folder, text, angle):
    view = View.of(FinishedRun.of(wing_folder))
    answer, frame = view.answer({"angle": text}, None)
    if angle is None:
        assert frame is None
        assert re.search("is outside|is not a number of degrees|leave", answer["said"])
    else:
        assert words(answer)["angle"] == frame.angle == angle


def test_several_surfaces_turn_in_one_box(tmp_path):
    write_mesh(None, two_bodies(), two_bodies().points, tmp_path / "two.su2")
    surfaces = tuple(
        Moving((name,), Rotation(Axis(np.array([x, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))), angle)
        for name, x, angle in (("left", -1.25, 8.0), ("right", 1.25, -4.0))
    )
    result = deflect(Plan.of(read(tmp_path / "two.su2"), [Job(surfaces=surfaces)]), 8.0)
    view = View.of(FinishedRun.of(written(tmp_path / "report", result)))
    run = view.run
    notes = words(view.answer({"angle": 4.0}, None)[0])["notes"]
    assert [note.partition(":")[0] for note in notes[:2]] == ["left by +4\N{DEGREE SIGN}", "right by -2\N{DEGREE SIGN}"]
    assert sdm(*split(view.finished.command.replace("ANGLE", "4"))[1:], "--dry-run", "--quiet") == 0
    assert [(one.name, one.factor) for one in run.surfaces] == [("left", 1.0), ("right", -0.5)]
    assert np.abs(run.at(8.0).points - result.points).max() < EQUAL
    boundary = run.boxes[0].plan.boundary
    expected = run.mesh.points[boundary.nodes] + boundary.displacement((4.0, -2.0))
    assert np.array_equal(run.at(4.0).points[boundary.nodes], expected)


def test_a_table_is_shown_by_its_share(block, bare_deflection, tmp_path):
    nodes = block.patch("body").nodes
    table = tmp_path / "table.npz"
    np.savez(table, points=block.points[nodes], vectors=np.tile([0.0, 0.0, 0.2], (len(nodes), 1)))
    run = InteractiveRun.of(FinishedRun.of(bare_deflection(block, "x.su2", "body", None, 0.5, table=str(table))))
    assert np.abs(run.at(1.0).points[nodes] - block.points[nodes] - [0.0, 0.0, 0.2]).max() < EQUAL
    assert run.unit == " of the table"
    spans = Spans.of(run)
    assert 0.5 in spans.fits
    assert spans.possible.high == pytest.approx(1.5)
    assert run.angle == 0.5


def test_sums_that_fit_into_no_memory_are_computed_at_every_angle(hybrid, wing_folder, monkeypatch):
    limited(monkeypatch, matrix=0)
    run = InteractiveRun.of(FinishedRun.of(wing_folder))
    assert run.boxes[0].steps[0].all[0].kernel is None
    assert np.abs(run.at(4.0).points - hybrid.at(4.0).points).max() < EQUAL


def test_another_mesh_under_the_same_name_is_refused(wing_folder, hybrid):
    source = wing_folder.parent / "wing.su2"
    kept = source.read_bytes()
    try:
        source.unlink()
        write_mesh(None, hybrid.mesh, hybrid.mesh.points + 1e-4, source)
        with pytest.raises(InputError, match=r"interpolant\.npz does not belong"):
            InteractiveRun.of(FinishedRun.of(wing_folder))
    finally:
        source.write_bytes(kept)
