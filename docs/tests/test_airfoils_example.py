"""The guide's plane meshes: a NACA 0012 with a flap, and three elements in one marker; page and view of them."""

import json
import runpy
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from sdm_deflect.cases.api import deflect
from sdm_deflect.cases.report.finished import FinishedRun
from sdm_deflect.cases.report.folder import plan_around
from sdm_deflect.cases.report.scene3d import turnable
from sdm_deflect.meshing.formats.registry import read
from sdm_deflect.meshing.mesh.quality import inverted_of
from tests.calls import sdm
from tests.ties import SEEDS, chosen, rounded_otherwise

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("airfoils")
    runpy.run_path(str(EXAMPLES / "airfoils.py"))["build"](made)
    return made


@pytest.fixture(scope="module")
def deflected(folder):
    """The NACA 0012 with a blended flap of 25 % chord, trailing edge down by 20 degrees, with its report."""
    words = ["deflect", str(folder / "naca0012.su2"), "--surface", "flap", "--fixed", "wing", "--hinge", "0.75,0"]
    assert sdm(*words, "--angle", "-20", "--motion", "blended", "--json", "--quiet") == 0
    return folder / "naca0012-deflected.su2"


@pytest.mark.parametrize("hinge", [["--hinge=0.75,0"], ["--hinge", "0.75,0"], ["--hinge", "0.75,0", "0.75,0"]])
def test_a_hinge_of_one_point(hinge, folder, capsys):
    words = ["deflect", str(folder / "naca0012.su2"), "--surface", "flap", "--fixed", "wing", "--motion", "blended"]
    assert sdm(*words, *hinge, "--angle", "3", "--dry-run", "--quiet") == 0
    capsys.readouterr()


def test_the_flap_turns_and_its_skins_stay_straight(folder, deflected):
    old, new = read(folder / "naca0012.su2"), read(deflected)
    edge = int(np.argmax(old.points[:, 0] * np.isin(np.arange(len(old.points)), old.patch("flap").nodes)))
    angle = np.radians(-20.0)
    assert new.points[edge, :2] == pytest.approx([0.75 + 0.25 * np.cos(angle), 0.25 * np.sin(angle)], abs=1e-12)
    assert new.points[old.patch("wing").nodes].tobytes() == old.points[old.patch("wing").nodes].tobytes()
    assert not any(inverted_of(new.points, block).any() for block in new.cells)


@pytest.mark.parametrize(
    ("name", "settings", "angle"),
    [
        ("naca0012", {"surfaces": "flap", "fixed": "wing", "hinge": [(0.75, 0.0)], "motion": "blended"}, -20.0),
        ("three_elements", {"surfaces": "wall#2", "fixed": "wall", "hinge": [(0.79, -0.055)]}, -20.0),
    ],
)
def test_the_same_centres_wherever_rounding_differs(folder, name, settings, angle):
    mesh, settings = read(folder / f"{name}.su2"), {**settings, "angle": angle, "repair": "off", "force": True}
    first = chosen(deflect(mesh, **settings).deflection)
    for seed in SEEDS:
        assert chosen(deflect(rounded_otherwise(mesh, seed), **settings).deflection) == first, seed


@pytest.mark.parametrize("angle", [-33.0, -22.0, 25.0])
def test_a_plan_holds_its_tolerance_up_to_an_angle_that_passes(folder, angle):
    settings = {"surfaces": "flap", "fixed": "wing", "hinge": [(0.75, 0.0)], "motion": "blended"}
    result = deflect(read(folder / "naca0012.su2"), angle=angle, **settings)
    plan = plan_around(result.deflection)
    assert result.passed
    assert np.abs(plan.at(angle) - result.points).max() < 1e-14
    between = [row for row in plan.measured[0] if 0.0 <= row.amount / angle <= 1.0]
    assert [row.failed for row in between] == [()] * len(between)
    assert len(between) >= 5


def test_settings_page_and_view_of_a_plane_mesh(folder, deflected, capsys):
    report = deflected.with_name("naca0012-deflected-report")
    figures = json.loads((report / "metrics.json").read_text())
    assert [check["name"] for check in figures["validation"]["checks"] if not check["passed"]] == []
    assert next(c["value"] for c in figures["validation"]["checks"] if c["name"] == "layer_height") < 0.05
    assert {path.name for path in (report / "figures").iterdir()} == {
        "convergence.png",
        "quality.png",
        "slices_flap.png",
    }
    again = folder / "again.su2"
    config = ["--config", str(report / "settings.toml"), "--out", str(again), "--no-report", "--quiet"]
    assert sdm("deflect", str(folder / "naca0012.su2"), *config) == 0
    assert again.read_bytes() == deflected.read_bytes()
    page = (report / "report.html").read_bytes()
    assert sdm("report", str(report), "--quiet") == 0
    assert len((report / "report.html").read_bytes()) == pytest.approx(len(page), rel=0.01)
    run = FinishedRun.of(report)
    assert run.motion.passed(0) == (run.motion.controls[0].low, run.motion.controls[0].high)
    groups = turnable(run.report_data().near, 10**6)["cells"]["groups"]
    shown = {len(one["table"]): len(b64decode(one["rows"])) // 4 for one in groups}
    assert sum(shown.values()) == run.plan.affected.count
    assert set(shown) == {3, 6}
    capsys.readouterr()


def test_the_flap_of_one_marker_turns_and_its_slot_stays(folder):
    """The second component of the marker goes down by 10 degrees, below the main element that it overlaps."""
    words = ["deflect", str(folder / "three_elements.su2"), "--surface", "wall#2", "--fixed", "wall"]
    assert sdm(*words, "--hinge", "0.79,-0.055", "--angle", "-10", "--no-report", "--quiet") == 0
    old, new = read(folder / "three_elements.su2"), read(folder / "three_elements-deflected.su2")
    assert old.names == new.names == ("wall", "far_field")
    moved = np.flatnonzero((old.points != new.points).any(axis=1))
    flap = np.intersect1d(moved, old.patch("wall").nodes)
    rest = np.setdiff1d(old.patch("wall").nodes, flap)
    main_element = rest[old.points[rest, 0] > 0.0]
    assert old.points[flap, 0].min() < old.points[main_element, 0].max() - 0.02, "they overlap"
    gaps = [cKDTree(mesh.points[main_element]).query(mesh.points[flap])[0].min() for mesh in (old, new)]
    assert gaps[1] > 0.8 * gaps[0]
    assert not any(inverted_of(new.points, block).any() for block in new.cells)
