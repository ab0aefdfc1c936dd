"""The page of a run in a browser: offline, without complaints, turnable; and nothing in a name becomes markup."""

import re
from base64 import b64decode
from collections import Counter
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from sdm_deflect.cases.aircraft.metrics import metrics
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.aircraft.report import report_data_of
from sdm_deflect.cases.aircraft.run_folder import finished_case
from sdm_deflect.cases.report.page import LARGEST, page, policy
from sdm_deflect.cases.report.pictures import draw_pictures
from sdm_deflect.cases.report.scene3d import thin_patch, turnable
from sdm_deflect.cases.report.slices import triangles_of
from tests.cases.conftest import UNFOLD

PICTURE = re.compile(r"data:image/(?:png|webp);base64,([\w+/=]+)")
DRAWN = "#turnable[data-state={}]"

pytestmark = pytest.mark.mesher


def data_of(run):
    """What the page of a run shows, of one that has just ended."""
    return report_data_of(run.case, run.deflection).with_verdict(run.checks, metrics(run))


def seen(tab):
    """Pixels (H, W, 3) of the canvas."""
    tab.wait_for_timeout(700)
    shot = tab.locator("#turnable canvas").screenshot()
    return np.asarray(Image.open(BytesIO(shot)).convert("RGB"), dtype=int)


def changed(before, after):
    return np.count_nonzero(np.abs(before - after).max(axis=2) > 24)


@pytest.mark.parametrize(
    "name", ["aileron", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("tail", "aileron-chimera"))]
)
def test_a_page_is_small(name, finish):
    _, folder = finish(case_named(name), name if name == "aileron" else f"{name}-report", report=True)
    assert (folder / "report.html").stat().st_size <= LARGEST == 4_000_000


def test_a_page_that_would_be_too_large_names_a_picture_instead_of_shrinking_it(aileron_run, tmp_path, monkeypatch):
    data = data_of(aileron_run[0])
    gallery = draw_pictures(data, tmp_path)
    whole = page(data, gallery)
    monkeypatch.setattr("sdm_deflect.cases.report.page.LARGEST", len(whole.encode()) - 1)
    small = page(data, gallery)
    sizes = [[Image.open(BytesIO(b64decode(one))).width for one in PICTURE.findall(text)] for text in (whole, small)]
    assert len(sizes[1]) == len(sizes[0]) - 1
    assert set(sizes[1]) <= set(sizes[0])
    assert f"the picture <code>figures/{gallery.exhibits[-1].path.name}</code> is in its folder" in small


def test_the_policy_of_a_page_allows_no_network():
    allowed = dict(one.strip().split(" ", 1) for one in policy(["let a = 1;"]).split(";"))
    assert allowed["default-src"] == "'none'"
    sources = " ".join(allowed.values()).split()
    assert {one for one in sources if not one.startswith("'sha256-")} == {"'none'", "'unsafe-inline'", "data:", "blob:"}


def test_page_is_offline_complete_and_turnable(aileron_run, opened):
    run, folder = aileron_run
    tab, asked, complaints = opened(folder / "report.html")
    rows = tab.locator("#verdict-table tbody tr")
    assert rows.count() == len(run.checks)
    assert [rows.nth(i).locator("b").first.inner_text() for i in range(rows.count())] == [c.name for c in run.checks]
    tab.evaluate(UNFOLD)
    deflected = seen(tab)
    assert deflected.std() > 5.0
    tab.check("#scene-undeflected", force=True)
    tab.wait_for_selector(DRAWN.format("undeflected"))
    undeflected = seen(tab)
    assert changed(undeflected, deflected) > 200
    tab.check("#scene-sites")
    assert changed(undeflected, seen(tab)) > 1000
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
    assert len([url for url in asked if url.startswith("file:")]) == 1
    assert complaints == []


def test_the_picture_turns_by_keys_and_shows_displacement_and_a_section(aileron_run, opened):
    run, folder = aileron_run
    tab, _, complaints = opened(folder / "report.html")
    tab.evaluate(UNFOLD)
    before = seen(tab)
    tab.select_option("#scene-colour", "displacement")
    moved = (run.deflected.points - run.mesh.points)[
        run.mesh.on("aileron_left")
    ]  # the surface: nodes inside go farther
    farthest = 1e3 * np.linalg.norm(moved, axis=1).max()
    assert tab.locator("#scene-bar-title").inner_text() == "displacement, mm"
    assert float(tab.locator("#scene-bar-high").inner_text()) == pytest.approx(farthest, rel=5e-3)
    tab.select_option("#scene-colour", "patch")
    assert changed(before, seen(tab)) < 500
    tab.focus("#turnable")
    for _ in range(4):
        tab.keyboard.press("ArrowLeft")
    turned = seen(tab)
    assert changed(before, turned) > 1000
    tab.keyboard.press("Home")
    tab.evaluate("document.activeElement.blur()")
    assert changed(before, seen(tab)) < 500
    tab.select_option("#scene-axis", "y")
    first = tab.locator("#scene-where").inner_text()
    cut = seen(tab)
    assert changed(before, cut) > 1000
    tab.locator("#scene-place").fill("30")
    assert tab.locator("#scene-where").inner_text() != first
    assert changed(cut, seen(tab)) > 500
    tab.wait_for_selector("#still:not([hidden])", state="attached")
    assert complaints == []


def test_nothing_is_closed_on_paper(aileron_run, opened):
    tab, _, _ = opened(aileron_run[1] / "report.html")
    closed = tab.locator("details:not([open])").count()
    tab.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert closed > 5
    assert tab.locator("details:not([open])").count() == 0
    tab.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert tab.locator("details:not([open])").count() == closed


def test_every_picture_says_what_it_shows(aileron_run, opened):
    tab, _, _ = opened(aileron_run[1] / "report.html")
    for image in tab.locator("img:not(#still)").all():
        words = image.get_attribute("alt")
        assert len(words) > 60
        assert re.search(r"\d", words)
        assert image.evaluate("one => one.naturalWidth") > 400
    assert "aileron_left" in tab.locator("#turnable").get_attribute("aria-label")
    assert tab.locator("figure:not(.paper)").count() == 5
    linked = [link.get_attribute("href") for link in tab.locator("nav a").all()]
    assert all(tab.locator(target).count() == 1 for target in linked)


def test_page_is_made_anew_from_the_folder(aileron_run, tmp_path):
    run, folder = aileron_run
    fresh, stored = data_of(run), finished_case(folder).rejudged_data()
    assert stored.checks == fresh.checks
    (own,), (other,) = stored.boxes, fresh.boxes
    assert [(c.box, c.directions, c.centres) for c in own.fits.convergence] == [
        (c.box, c.directions, c.centres) for c in other.fits.convergence
    ]
    np.testing.assert_array_equal(own.fits.centres["z"], other.fits.centres["z"])
    assert turnable(replace(stored, motion=None)) == turnable(fresh)
    assert [one["name"] for one in turnable(stored)["turn"]["surfaces"]] == ["aileron_left"]


def test_turnable_picture_holds_the_meshes(tail_run):
    run, _ = tail_run
    scene = turnable(data_of(run))
    triangles = {name: len(run.mesh.patch(name)) for name in run.mesh.names if name != "far_field"}
    assert {one["name"]: len(b64decode(one["faces"])) // 12 for one in scene["patches"]} == triangles
    assert {one["name"] for one in scene["patches"] if one["goes"]} == {"tail_left", "fuselage_panel_left"}
    (tail,) = (one for one in scene["patches"] if one["name"] == "tail_left")
    points = sum(np.frombuffer(b64decode(tail[name]), "<f4").reshape(-1, 3) for name in ("points", "rest"))
    np.testing.assert_allclose(points, run.deflected.points[run.mesh.on("tail_left")], atol=1e-6)


def test_large_patches_are_thinned_away_from_the_hexahedra(tail_run):
    run, _ = tail_run
    data = data_of(run)
    mesh = data.mesh
    inside = data.boxes[0].nodes
    for name in ("fuselage", "tail_left", "tail_right"):
        whole = triangles_of(mesh.patch(name).faces)
        shown = thin_patch(mesh, mesh.patch(name), inside, 150)
        edges, ends = ({tuple(sorted(pair)) for pair in sides(one)} for one in (shown, whole))
        counts = Counter(tuple(sorted(pair)) for pair in sides(whole))
        assert set(shown.ravel()) <= set(whole.ravel())
        assert {pair for pair in ends if counts[pair] == 1} <= edges  # what it shares with other patches
        fixed = whole[np.isin(whole, inside).all(axis=1)]
        assert set(map(tuple, fixed)) <= set(map(tuple, shown))
        assert (len(shown) < 0.8 * len(whole)) == (name != "tail_left")
        assert area(mesh.points[shown]) == pytest.approx(area(mesh.points[whole]), rel=0.1)
    names = {one["name"] for one in turnable(data, most_triangles=150)["patches"]}
    assert {"fuselage (thinned)", "tail_left"} <= names


def sides(triangles):
    return np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).tolist()


def area(corners):
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()


def test_dots_are_thinned_and_counted(tail_run, monkeypatch):
    data = data_of(tail_run[0])
    (whole,) = (one for one in turnable(data)["dots"] if one["name"] == "sites on the surface")
    monkeypatch.setattr("sdm_deflect.cases.report.scene3d.MOST_DOTS", 100)
    few = turnable(data)["dots"][0]
    assert len(b64decode(few["points"])) <= 100 * 12 < len(b64decode(whole["points"]))
    assert few["count"] == whole["count"]
    assert few["name"].startswith("sites on the surface, 1 in ")
