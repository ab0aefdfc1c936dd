"""Pictures of the studies, composed from plain arrays."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from sdm_deflect.cases.report.colours import QUALITIES
from sdm_deflect.cases.report.pictures import write_png
from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.quality import mean_ratio, signed_volumes
from studies import pictures as aircraft
from studies.colours import BOX, NAVY, ORANGE, patch_colour
from studies.pictures import cells_by, histograms, shell
from studies.rendering import SCALES, figure_of, rendered
from tests.pictures import differing, inked, pixels, share


def two_tets():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=float)
    return points, np.array([[0, 1, 2, 3], [1, 2, 3, 4]])


def test_shell_is_closed_and_leaves_out_the_shared_face():
    _, tets = two_tets()
    triangles, cell = shell(tets)
    assert len(triangles) == 6
    assert np.bincount(cell).tolist() == [3, 3]
    edges = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
    for triangle, row in zip(triangles, cell, strict=True):
        assert set(triangle) <= set(tets[row])


def test_shell_of_one_tetrahedron_points_outwards():
    points, tets = two_tets()
    triangles, _ = shell(tets[:1])
    volume = sum(np.linalg.det(points[triangle]) for triangle in triangles) / 6.0
    assert volume == pytest.approx(signed_volumes(points, tets[:1])[0])


def test_better_cells_are_brighter():
    rgb = SCALES["quality"].rgb
    shades = rgb(np.linspace(QUALITIES.vmin, QUALITIES.vmax, 9)) @ [0.2126, 0.7152, 0.0722]
    assert all(a < b for a, b in pairwise(shades))
    np.testing.assert_array_equal(rgb(np.array([-1.0, 0.0])), rgb(np.full(2, QUALITIES.vmin)))


@pytest.mark.mesher
def test_histograms_hold_every_cell_before_and_after(tail_run):
    run, _ = tail_run
    figure, text = histograms([run], ["+12 deg"])
    near = np.isin(tets_of(run.mesh), run.deflection.boxes[0].plan.region.inside).any(axis=1)
    counts = [patch.get_data().values.sum() for patch in figure.axes[0].patches]
    assert counts == [len(near), len(near), near.sum(), near.sum()]
    assert "smallest" in text


@pytest.mark.mesher
def test_tail_is_drawn_before_and_after(tail_run, tmp_path):
    run, _ = tail_run
    border = aircraft.border(run.mesh, "tail_left")
    panel = run.mesh.on("fuselage_panel_left")
    np.testing.assert_array_equal(run.deflected.points[border], run.mesh.points[border])
    assert np.isin(border, panel).all()
    picture = aircraft.confinement(run)
    (image,) = rendered(picture.views)
    for colour in (NAVY, BOX, patch_colour("tail_left")):  # sites, hexahedron, tail
        assert share(image, colour) > 5e-4
    write_png(figure_of(picture), tmp_path / "figure6.png")
    assert inked(pixels(tmp_path / "figure6.png")) == pytest.approx(inked(image), abs=0.15)
    assert (tmp_path / "figure6.png").stat().st_size < 300_000
    cells, turned_cells, panel, turned_panel = rendered(aircraft.around(run).views)
    still = rendered(aircraft.around(replace(run, deflected=run.mesh)).views)
    np.testing.assert_array_equal(still, (cells, cells, panel, panel))
    assert differing(cells, turned_cells) > 0.2
    assert differing(panel, turned_panel) > 0.05
    assert all(share(image, ORANGE) > 5e-4 for image in (panel, turned_panel))


@pytest.mark.mesher
def test_gap_shows_cells_at_the_block_face_alone_that_moved(chimera_run):
    run, _ = chimera_run
    chosen = aircraft.in_gap(run)
    own, face, _ = aircraft.stations(run)
    inboard = np.sign(face - own) * (run.mesh.points[tets_of(run.mesh)[chosen]][..., 1] - own)
    assert 50 < chosen.sum() < len(chosen) / 4
    assert inboard.max() == pytest.approx(abs(face - own))
    before, after = (
        cells_by("quality", mean_ratio(mesh.points, tets_of(mesh)), mesh, chosen) for mesh in (run.mesh, run.deflected)
    )
    assert (before.rgb != after.rgb).any()
    np.testing.assert_array_equal(before.cells, after.cells)
    image, undeflected = rendered(aircraft.gaps([run, replace(run, deflected=run.mesh)]).views)
    assert differing(image, undeflected) > 0.1
    assert share(image, BOX) > 5e-4


@pytest.mark.mesher
def test_blocks_are_drawn_with_the_aircraft(aileron_run, chimera_run, tmp_path):
    picture = aircraft.blocks(aileron_run[0], chimera_run[0])
    assert "canopy" in picture.legend
    assert len(picture.views) == 2
    with pytest.raises(ValueError, match="has no Chimera block"):
        aircraft.blocks(aileron_run[0], aileron_run[0])
