"""The scripts of the guide do what their pages say."""

import subprocess
import sys
from pathlib import Path

import airfoils
import animated
import blending
import evaluate_interpolant
import greedy_centres
import greedy_rules
import mean_ratio as shapes
import numpy as np
import own_case
import own_surface
import picture_of_run
import pictures
import point_cloud
import pytest
import screens
import tail_root
from PIL import Image

from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.meshing.formats.vtu import write_vtu
from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.quality import mean_ratio, signed_volumes
from tests.pictures import differing, inked, pixels, shades, share

EXAMPLES = Path(pictures.__file__).parent
FIGURES = EXAMPLES.parent / "figures"


def test_pictures_of_the_page_are_of_its_sources():
    """If this fails: python docs/examples/screens.py docs/figures, look at the pictures, and commit them."""
    assert (FIGURES / "screens.txt").read_text(encoding="utf-8").strip() == screens.digest()


def test_every_picture_of_the_guide_is_drawn_as_stored_and_small(tmp_path):
    pictures.main(tmp_path)
    for name in pictures.PICTURES:
        image = pixels(tmp_path / f"{name}.png")
        assert inked(image) > 0.05
        assert shades(image) > 100
        assert differing(image, pixels(FIGURES / f"{name}.png")) < 0.03
        assert (tmp_path / f"{name}.png").stat().st_size < 300_000


def coarse(image, size=16):
    """The mean colour of squares of an image: lines that another processor's rounding moves by a pixel do not count."""
    rows, columns = (length // size for length in image.shape[:2])
    return image[: rows * size, : columns * size].reshape(rows, size, columns, size, -1).mean(axis=(1, 3))


@pytest.mark.mesher
def test_the_animated_picture_shows_deflected_meshes_and_is_stored_as_drawn(tmp_path, aileron_mesh):
    airfoils.build(tmp_path)
    still, down = (np.asarray(image) for image in animated.frames(tmp_path / "naca0012.su2", [0.0, 1.0]))
    half = still.shape[1] // 2
    for side in (slice(half), slice(half, None)):
        assert differing(still[:, side], down[:, side]) > 0.01
    moved = np.abs(coarse(still[:, half:]) - coarse(down[:, half:])).mean()
    with Image.open(FIGURES / "deflecting.gif") as stored:
        assert stored.n_frames == animated.PERIOD
        for place, drawn in ((0, still), (animated.PERIOD // 4, down)):
            stored.seek(place)
            off = np.abs(coarse(np.asarray(stored.convert("RGB"))[:, half:]) - coarse(drawn[:, half:])).mean()
            assert off < moved / 3.0
    assert (FIGURES / "deflecting.gif").stat().st_size < 3_000_000


def test_points_of_the_cloud_move_in_the_box_alone():
    points = np.random.default_rng(3).uniform((-0.1, -0.2, -0.2), (0.3, 0.5, 0.2), (2000, 3))
    after = point_cloud.deflected(points, 15.0)
    outside = ~point_cloud.REGION.contains(points)
    np.testing.assert_array_equal(after[outside], points[outside])
    assert np.abs(after - points)[~outside].max() > 0.005


def test_flap_of_the_cloud_turns_rigidly():
    flap = point_cloud.flap(0.0125)
    turned = point_cloud.HINGE.rotated(flap, 15.0)
    assert np.abs(point_cloud.deflected(flap, 15.0) - turned).max() < 1e-4


def test_greedy_centres_mend_the_worst_residual():
    errors = [greedy_centres.residual(greedy_centres.adapted(count)).max() for count in greedy_centres.COUNTS]
    assert errors[0] > 5.0 * errors[1] > 10.0 * errors[2]


def test_separated_blocks_take_fewer_iterations():
    found = {name: greedy_rules.adapted(name) for name in greedy_rules.RULES}
    iterations = {name: one.history[-1].iteration for name, one in found.items()}
    assert all(one.max_error < greedy_rules.TOLERANCE for one in found.values())
    assert 5 * iterations["Separated"] < iterations["Worst, 10 at a time"] < iterations["Worst, 1 at a time"]


def test_blending_in_a_strip_keeps_the_rest_planar():
    nodes = blending.upper_side()
    beyond = nodes[:, 1] >= blending.STRIP
    assert blending.bulge(nodes, blending.chordwise(nodes)).max() < 1e-12
    assert blending.bulge(nodes, blending.in_strip(nodes))[beyond].max() < 1e-12
    assert blending.bulge(nodes, blending.at_once(nodes))[beyond].max() > 1e-6


def test_root_ends_on_the_cylinder_and_the_panel_stays_there():
    turned, onto = tail_root.extended(tail_root.root())
    assert np.abs(tail_root.FUSELAGE.distance(turned)).max() > 1e-4
    assert np.abs(tail_root.FUSELAGE.distance(onto)).max() < 1e-15
    nodes = tail_root.panel()
    assert np.abs(tail_root.FUSELAGE.distance(tail_root.followed(nodes))).max() < 1e-15
    assert np.abs(tail_root.FUSELAGE.distance(tail_root.bulging(nodes))).max() > 1e-4


@pytest.mark.parametrize("matrix", [shapes.sheared(2.6), shapes.squeezed(0.2), np.eye(3)])
def test_mean_ratio_is_three_over_the_energy(matrix):
    assert shapes.quality(matrix) == pytest.approx(3.0 / shapes.energy(matrix))


def test_sheared_cell_has_the_quality_of_the_theory():
    assert shapes.quality(shapes.sheared(2.6)) == pytest.approx(3.0 / (3.0 + 2.6**2))


def test_own_kernel_runs_in_a_process_of_its_own():
    words = [sys.executable, str(EXAMPLES / "own_kernel.py")]
    out = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    thin_plate, own = (line.split() for line in out.splitlines())
    assert (thin_plate[0], own[0]) == ("ThinPlateSpline:", "InverseMultiquadric:")
    assert float(thin_plate[5]) < 1e-5
    assert float(own[5]) < 1e-5


def test_own_case_differs_in_what_it_replaces():
    tail, own = case_named("tail"), own_case.elevator()
    assert [one.surface for one in own.deflections] == ["tail_left", "tail_right"]
    assert (own.angle, own.mesh, own.confinement) == (-8.0, tail.mesh, tail.confinement)


@pytest.mark.mesher
def test_own_case_runs(aileron_mesh, tmp_path, capsys):
    run = own_case.main(tmp_path / "elevator")
    assert [check.name for check in run.checks if not check.passed] == []
    assert capsys.readouterr().out.count(", passed\n") == len(run.checks)
    assert 'name = "elevator"' in (tmp_path / "elevator" / "case.toml").read_text()
    assert (tmp_path / "elevator" / "report.html").exists()


@pytest.mark.mesher
def test_own_surface_bends_the_fin_and_nothing_else(aileron_mesh, tmp_path):
    mesh, _ = aileron_mesh
    write_vtu(tmp_path / "mesh.vtu", mesh)
    after = own_surface.main(tmp_path / "mesh.vtu")
    moved = np.flatnonzero((after.points != mesh.points).any(axis=1))
    assert own_surface.REGION.contains(mesh.points[moved]).all()
    assert np.isin(np.intersect1d(moved, mesh.on(*mesh.names)), mesh.on("fin", "rudder")).all()
    assert signed_volumes(after.points, tets_of(after)).min() > 0.0
    assert mean_ratio(after.points, tets_of(after)).min() > 0.15
    fin = mesh.on("fin", "rudder")
    np.testing.assert_array_equal(after.points[fin][:, [0, 2]], mesh.points[fin][:, [0, 2]])


@pytest.mark.mesher
def test_stored_interpolant_equals_the_run(finished):
    mesh, result, folder = finished
    flow = np.setdiff1d(result.plan.boxes[0].region.inside, mesh.on(*mesh.names))
    elsewhere = evaluate_interpolant.displacement(folder / "interpolant.npz", mesh.points[flow])
    np.testing.assert_allclose(elsewhere, (result.points - mesh.points)[flow], atol=1e-9)


@pytest.mark.mesher
def test_picture_of_a_run_names_what_moved(finished, tmp_path):
    folder = finished[2]
    words = [sys.executable, str(EXAMPLES / "picture_of_run.py"), str(folder), str(tmp_path / "run.png")]
    out = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert out.split() == ["aileron_left"]
    image = pixels(tmp_path / "run.png")
    assert inked(image) > 0.2
    assert share(image, (0xCC, 0x66, 0x77), 80) > 5e-3
    assert share(image, (107, 117, 128)) > 1e-3
    (edges,) = picture_of_run.hexahedra(folder / "interpolant.npz")
    assert Hexahedron(np.asarray(edges.points, dtype=np.float64)).contains(np.asarray(edges.center)[None]).all()
