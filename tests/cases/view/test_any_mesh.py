"""Deflections of any mesh on display: every type of cell, sliding patches, tables, several surfaces in one box."""

import numpy as np
import pytest

from sdm_deflect.cases.api import read
from sdm_deflect.cases.report.folder import FinishedJob
from sdm_deflect.cases.run.mesh_files import write_mesh
from sdm_deflect.cases.view.labels import about, facts
from sdm_deflect.cases.view.page import Control
from sdm_deflect.cases.view.pieces import ClipPlane, ViewPieces
from sdm_deflect.cases.view.run import InteractiveRun, Spans
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.axis import Axis
from sdm_deflect.deform.mesh.quality import quality_of
from sdm_deflect.deform.surface.motions import Moving, Rotation
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import Job
from sdm_deflect.deform.volume.plan import Plan
from tests.cases.view.conftest import written
from tests.deform.blocks import two_bodies
from tests.limits import limited
from tests.meshing.formats.examples import polyhedral

EQUAL = 1e-9  # of a mesh of size 1
BODY = ("body", [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]], 10.0)


def area(corners):
    """The area of a convex polygon (k, 3)."""
    return 0.5 * np.linalg.norm(np.cross(corners[1:-1] - corners[0], corners[2:] - corners[0]).sum(axis=0))


def total(piece):
    return sum(area(piece.points[own]) for own in np.split(piece.nodes, np.cumsum(piece.sizes)[:-1]) if len(own) > 2)


def test_a_hybrid_mesh_that_slides_is_reproduced(hybrid, wing_folder):
    points = FinishedJob.of(wing_folder).points
    frame = hybrid.at(10.0)
    assert hybrid.boxes[0].steps[0].first
    assert np.abs(frame.points - points).max() < EQUAL
    assert frame.verified
    assert np.array_equal(hybrid.at(0.0).points, hybrid.mesh.points)
    symmetry = hybrid.mesh.patch("symmetry").nodes
    assert np.abs(hybrid.at(7.0).points[symmetry, 1]).max() == 0.0


def test_the_quality_has_the_measure_of_each_type_of_cell(hybrid):
    frame = hybrid.at(10.0)
    parts = zip(hybrid.mesh.cells, hybrid.touched.rows, strict=True)
    expected = np.concatenate([quality_of(frame.points, block, rows) for block, rows in parts])
    assert np.array_equal(frame.quality, expected)
    shown = {row["id"]: row["value"] for row in facts(frame, hybrid, ViewPieces.of(hybrid))}
    shapes = np.repeat([block.shape for block in hybrid.mesh.cells], list(map(len, hybrid.touched.rows)))
    assert shown["smallest-wedge"] == f"{expected[shapes == 'wedge'].min():.3f}"
    assert "mesh units" in about(hybrid)["run_facts"]


@pytest.mark.parametrize("many", [False, True])
def test_a_section_through_cells_of_any_type_tiles_the_plane(block, bare_deflection, many):
    mesh = polyhedral(block) if many else block
    run = InteractiveRun.of(
        FinishedJob.of(bare_deflection(mesh, "case/x.foam" if many else "x.su2", *BODY, fixed="?-"))
    )
    pieces, plane = ViewPieces.of(run), ClipPlane(1, 0.1)
    sections = [pieces.moving(run.at(10.0), plane, None)["section"], pieces.standing(plane, None)["around"]]
    assert sum(map(total, sections)) == pytest.approx(16.0 - 1.0)
    assert all(np.allclose(piece.points[:, 1], 0.1) for piece in sections)


def test_inverted_polyhedra_are_shown_whole(block, bare_deflection):
    run = InteractiveRun.of(FinishedJob.of(bare_deflection(polyhedral(block), "case/x.foam", *BODY)))
    frame = run.at(80.0)
    assert len(frame.inverted)
    pieces = ViewPieces.of(run).moving(frame, None, None)
    assert len(pieces["marks"].points) == len(frame.inverted)
    assert pieces["inverted"].sizes.min() >= 3


def test_several_surfaces_turn_in_one_box(tmp_path):
    write_mesh(None, two_bodies(), two_bodies().points, tmp_path / "two.su2")
    surfaces = tuple(
        Moving((name,), Rotation(Axis(np.array([x, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))), angle)
        for name, x, angle in (("left", -1.25, 8.0), ("right", 1.25, -4.0))
    )
    result = deflect(Plan.of(read(tmp_path / "two.su2"), Job(surfaces=surfaces)), 8.0)
    run = InteractiveRun.of(FinishedJob.of(written(tmp_path / "report", result)))
    assert [(one.name, one.factor) for one in run.surfaces] == [("left", 1.0), ("right", -0.5)]
    assert np.abs(run.at(8.0).points - result.points).max() < EQUAL
    boundary = run.boxes[0].plan.boundary
    expected = run.mesh.points[boundary.nodes] + boundary.displacement((4.0, -2.0))
    assert np.array_equal(run.at(4.0).points[boundary.nodes], expected)
    assert "right × -0.5" in about(run)["run_facts"]


def test_a_table_is_shown_by_its_share(block, bare_deflection, tmp_path):
    nodes = block.patch("body").nodes
    table = tmp_path / "table.npz"
    np.savez(table, points=block.points[nodes], vectors=np.tile([0.0, 0.0, 0.2], (len(nodes), 1)))
    run = InteractiveRun.of(FinishedJob.of(bare_deflection(block, "x.su2", "body", None, 0.5, table=str(table))))
    assert np.abs(run.at(1.0).points[nodes] - block.points[nodes] - [0.0, 0.0, 0.2]).max() < EQUAL
    assert run.unit == " of the table"
    spans = Spans.of(run)
    assert 0.5 in spans.verified
    assert spans.possible.high == pytest.approx(1.5)
    assert Control.of(run).first().angle == 0.5


def test_sums_that_fit_into_no_memory_are_computed_at_every_angle(hybrid, wing_folder, monkeypatch):
    limited(monkeypatch, matrix=0)
    run = InteractiveRun.of(FinishedJob.of(wing_folder))
    assert run.boxes[0].steps[0].all[0].kernel is None
    assert np.abs(run.at(4.0).points - hybrid.at(4.0).points).max() < EQUAL


def test_another_mesh_under_the_same_name_is_refused(wing_folder, hybrid):
    source = wing_folder.parent / "wing.su2"
    kept = source.read_bytes()
    try:
        source.unlink()
        write_mesh(None, hybrid.mesh, hybrid.mesh.points + 1e-4, source)
        with pytest.raises(InputError, match=r"interpolant\.npz does not belong"):
            InteractiveRun.of(FinishedJob.of(wing_folder))
    finally:
        source.write_bytes(kept)
