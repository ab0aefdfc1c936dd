"""Case 5.1 end to end on one real mesh."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np
import pytest
import pyvista as pv

from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.output import RUN
from sdm_deflect.meshing.formats.vtu import read_vtu
from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.quality import mean_ratio

pytestmark = pytest.mark.mesher


def test_every_check_passes(aileron_run):
    run, _ = aileron_run
    assert {c.name: c.passed for c in run.checks} == dict.fromkeys((c.name for c in run.checks), True)
    names = {c.name for c in run.checks}
    assert {"outside_moved", "inverted_cells", "fixed_surfaces_moved", "surface_to_cad", "planarity",
            "quality_min"} <= names  # fmt: skip


@pytest.mark.parametrize(
    ("angle", "least"),
    [
        pytest.param(50.0, 0.584, marks=pytest.mark.nightly),
        pytest.param(60.0, 0.511, marks=pytest.mark.nightly),
        (-60.0, 0.476),
    ],
)
def test_sixty_degrees_from_a_box_that_begins_ahead_of_the_hinge(turned, angle, least):
    """On other meshes the skins of the wedge cross at +60 degrees, because the repair slides nodes on its faces."""
    case = replace(case_named("aileron"), angle=angle)
    case = replace(case, confinement=replace(case.confinement, ahead=0.006))
    mesh, moved, checks = turned(case)
    assert {c.name: (c.value, c.where) for c in checks if not c.passed} == {}
    changed = (moved.points != mesh.points).any(axis=1)[tets_of(mesh)].any(axis=1)
    assert mean_ratio(moved.points, tets_of(moved)[changed]).min() == pytest.approx(least, abs=1e-3)


def test_files_of_the_contract(aileron_run):
    run, folder = aileron_run
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["mesh"]["cells"] == len(tets_of(run.mesh))
    assert {p.name for p in folder.iterdir()} >= {
        "case.toml", "undeflected.vtu", "deflected.vtu", "interpolant.npz", "convergence.csv", "report.html",
        "figures",
    }  # fmt: skip
    files = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
    assert not [name for name in files if not any(fnmatchcase(name, pattern) for pattern in RUN)]
    before, after = read_vtu(folder / "undeflected.vtu"), read_vtu(folder / "deflected.vtu")
    np.testing.assert_array_equal(before.points, run.mesh.points)
    np.testing.assert_array_equal(tets_of(after), tets_of(before))
    arrays = pv.read(folder / "deflected.vtu")
    np.testing.assert_array_equal(arrays["displacement"], after.points - before.points)
    np.testing.assert_allclose(arrays["quality"][: len(tets_of(after))], mean_ratio(after.points, tets_of(after)))


def test_interpolant_file_alone_gives_the_interior(aileron_run):
    run, folder = aileron_run
    with np.load(folder / "interpolant.npz", allow_pickle=False) as file:
        assert str(file["kernel"]) == "thin_plate_spline"
        inner = np.setdiff1d(run.deflection.boxes[0].plan.region.inside, run.mesh.on(*run.mesh.names))
        x = run.mesh.points[inner]
        for column, d in enumerate("xyz"):
            r = np.linalg.norm(x[:, None] - file[f"centers_{d}"], axis=2)
            phi = r**2 * np.log(np.where(r > 0.0, r, 1.0))
            s = np.column_stack([np.ones(len(x)), x]) @ file[f"alpha_{d}"] + phi @ file[f"beta_{d}"]
            moved = (run.deflection.boxes[0].interpolated - run.mesh.points)[inner, column]
            np.testing.assert_allclose(s, moved, atol=1e-11)


def test_trailing_edge_turns_and_all_else_stays(aileron_run):
    run, _ = aileron_run
    moved = np.any(run.deflected.points != run.mesh.points, axis=1)
    assert set(np.flatnonzero(moved)) <= set(run.deflection.boxes[0].plan.region.inside)
    still = run.mesh.on(*(n for n in run.mesh.names if n != "aileron_left"))
    interpolated = run.deflection.boxes[0].interpolated  # a repair may move nodes within the planes of the wing
    assert interpolated[still].tobytes() == run.mesh.points[still].tobytes()
    nodes = run.mesh.on("aileron_left")
    trailing = nodes[run.mesh.points[nodes, 0] > run.case.fighter.wing.x_te - 1e-6]
    outboard = trailing[run.mesh.points[trailing, 1] < -0.15]
    assert np.all(run.deflected.points[outboard, 2] > 1e-3)  # negative angle: trailing edge up


def test_squv_needs_fewest_centres_in_y_and_both_strategies_converge(aileron_run, aileron_mv_run):
    squv = {f.components[0]: f for f in aileron_run[0].deflection.boxes[0].steps[0].fits.adaptations}
    assert len(squv[1].chosen) < min(len(squv[0].chosen), len(squv[2].chosen))
    for run, _ in (aileron_run, aileron_mv_run):
        for fit in run.deflection.boxes[0].steps[0].fits.adaptations:
            assert fit.history[-1].max_residual < run.case.adaptation.tolerance


@pytest.mark.parametrize("angle", [pytest.param(5.0, marks=pytest.mark.nightly), -20.0])
def test_other_angles_pass(turned, angle):
    assert [check for check in turned(replace(case_named("aileron"), angle=angle))[2] if not check.passed] == []


@pytest.mark.parametrize("threads", ["1", pytest.param("2", marks=pytest.mark.nightly)])
def test_second_run_writes_the_same_bytes_on_any_number_of_threads(aileron_run, tmp_path, threads):
    _, first = aileron_run
    environment = {**os.environ, "NUMBA_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
    words = [sys.executable, "-m", "sdm_deflect", "run", "aileron", "--quiet", "--no-report", "--out", str(tmp_path)]
    subprocess.run(words, env=environment, check=True, capture_output=True)
    for name in ("case.toml", "undeflected.vtu", "deflected.vtu", "interpolant.npz"):
        assert (first / name).read_bytes() == (tmp_path / name).read_bytes(), name
