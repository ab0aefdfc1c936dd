"""Pages in a real browser, from a file, without a network: sliders turn the mesh as the plan does; `sdm view`."""

import re
import socket
from contextlib import suppress
from functools import partial

import numpy as np
import pytest

from sdm_deflect import MeshMotion, deflect
from sdm_deflect.cases.run.mesh_files import write_mesh
from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.quality import quality_of
from tests.cases.accessible import found, grave, rules
from tests.cases.conftest import UNFOLD
from tests.deform.blocks import two_bodies
from tests.deform.plates import plate

pytestmark = pytest.mark.mesher
ASKED = """(wanted) => {
  const { patches, cells, milliseconds } = document.getElementById("turnable").sdm.at(wanted);
  const plain = (values) => Array.from(values);
  return {
    patches: Object.fromEntries(Object.entries(patches).map(([name, values]) => [name, plain(values)])),
    cells: cells.map(({ shape, rows, quality }) => ({ shape, rows: plain(rows), quality: plain(quality) })),
    milliseconds,
  };
}"""
SHAPES = {"wing": {"wedge", "hexahedron"}, "plate": {"triangle"}, "quads": {"quad"}, "bodies": {"hexahedron"}}
PIVOT, HOLE = [0.1, 0.0], {"box": [[-0.55, -0.55], [0.55, 0.55]]}
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
UP = np.array([0.0, 0.0, 1.0])
# Corners of a good cell of each shape, in VTK's order.
IDEAL = {
    "triangle": SQUARE[:3],
    "quad": SQUARE,
    "tetra": np.vstack([SQUARE[[0, 1, 3]], [[0.3, 0.3, 1.0]]]),
    "pyramid": np.vstack([SQUARE, [[0.5, 0.5, 0.7]]]),
    "wedge": np.vstack([SQUARE[[0, 3, 1]], SQUARE[[0, 3, 1]] + UP]),
    "hexahedron": np.vstack([SQUARE, SQUARE + UP]),
}
BODIES = [
    {"patches": "left", "hinge": [[-1.25, -1, 0], [-1.25, 1, 0]], "angle": 8.0},
    {"patches": "right", "hinge": [[1.25, -1, 0], [1.25, 1, 0]], "angle": -5.0},
]


def blended(w):
    return {"motion": "blended", "held": "wing_*", "fixed": "wing_*", "slide": "symmetry:plane"}


@pytest.fixture(scope="module")
def made(tmp_path_factory, hybrid_wing):
    """Make the report of a deflection once; return the result, its plan and the page."""
    wing = hybrid_wing
    asked = {
        "wing": (wing.mesh, "flap_*", wing.hinge, 8.0, blended(wing)),
        "plate": (plate(40, "triangle"), "hole", PIVOT, 30.0, HOLE),
        "quads": (plate(40, "quad"), "hole", PIVOT, -12.0, HOLE),
        "bodies": (two_bodies(), BODIES, None, None, {"box": [[-3.5, -1.4, -1.8], [3.5, 1.4, 1.8]]}),
    }
    kept = {}

    def make(name):
        if name not in kept:
            mesh, surfaces, hinge, angle, options = asked[name]
            result = deflect(mesh, surfaces, hinge, angle, **options)
            path = result.report(tmp_path_factory.mktemp(name) / "report")
            held = MeshMotion.load(path.parent / "plan.npz", result.plan.mesh.points)
            kept[name] = result, held, path
        return kept[name]

    return make


@pytest.fixture
def page(made, opened):
    def open_page(name):
        result, held, path = made(name)
        tab, asked, complaints = opened(path)
        tab.context.set_offline(True)
        tab.evaluate(UNFOLD)
        tab.asked, tab.complaints = asked, complaints
        return tab, result, held

    return open_page


@pytest.mark.parametrize("name", [pytest.param("wing", marks=pytest.mark.nightly), "plate", "quads", "bodies"])
def test_sliders_move_nodes_and_qualities_as_the_plan_does(name, page):
    tab, result, held = page(name)
    affected, mesh = result.plan.affected, result.plan.mesh
    size = max(float(np.ptp(mesh.points[mesh.patch(one).nodes], axis=0).max()) for one in result.plan.patches)
    rng = np.random.default_rng(8)
    poses = [held.amounts, *(tuple(rng.uniform(one.low, one.high) for one in held.controls) for _ in range(19))]
    shapes = set()
    for pose in poses:
        got = tab.evaluate(ASKED, dict(zip([one.name for one in held.controls], pose, strict=True)))
        expected = result.points if pose == held.amounts else held.at(pose)
        for patch in mesh.patches:
            if patch.name in got["patches"]:
                nodes = np.sort(patch.nodes)
                off = np.abs(np.reshape(got["patches"][patch.name], (-1, 3)) - expected[nodes]).max()
                assert off <= 1e-6 * size
        quality = affected.scores(expected)[0]
        for group in got["cells"]:
            shapes.add(group["shape"])
            np.testing.assert_allclose(group["quality"], quality[group["rows"]], atol=1e-3)
            np.testing.assert_allclose(group["quality"], quality[group["rows"]], atol=1e-9)
    assert shapes == SHAPES[name]
    assert tab.complaints == []
    assert [url for url in tab.asked if not url.startswith(("file:", "data:", "blob:"))] == []


@pytest.mark.parametrize("shape", ["triangle", "quad", "tetra", "pyramid", "wedge", "hexahedron"])
def test_the_page_measures_cells_as_the_product_does(shape, page):
    """Cells at random: good ones, folded ones and inverted ones, counted in either hand."""
    tab, _, _ = page("plate")
    rng, ideal = np.random.default_rng(2), IDEAL[shape]
    cells = ideal[None] + rng.choice([0.1, 0.3, 1.0], (200, 1, 1)) * rng.normal(size=(200, *ideal.shape))
    if shape in ("triangle", "quad"):
        cells[..., 2] = 0.0
    block = Cells(shape, np.arange(200 * len(ideal)).reshape(200, -1))
    for sign in (-1.0, 1.0):
        expected = quality_of(cells.reshape(-1, 3), block, None, sign)
        numbers = [cells.ravel().tolist(), block.nodes.ravel().tolist()]
        given = f"{numbers[0]}, {numbers[1]}, {len(ideal)}, {sign}, new Float64Array(200)"
        np.testing.assert_allclose(tab.evaluate(f"Array.from(measured('{shape}', {given}))"), expected, atol=1e-12)
    assert (expected <= 0.0).any()
    assert (expected > 0.3).any()


def test_a_slider_is_typed_dragged_and_played_and_says_what_was_measured(page):
    tab, _, held = page("wing")
    typed, slider = tab.locator("#scene-typed-flap"), tab.locator("#scene-amount-flap")
    assert typed.input_value() == "8"
    assert tab.inner_text("#scene-measured").startswith("Measured here: no cell is inside out, fitted within")
    assert not tab.is_visible("#scene-verdict")  # the head of the page has it
    least = min(row.least for row in held.measured[0] if row.amount == 8.0)
    assert float(tab.inner_text("#scene-least")) == pytest.approx(least, abs=1e-3)
    typed.fill("2,5")
    typed.press("Enter")
    assert tab.get_attribute("#turnable", "data-amounts") == '{"flap":2.5}'
    assert tab.inner_text("#scene-measured").startswith("Measured at +2\N{DEGREE SIGN} and +4\N{DEGREE SIGN}: ")
    assert tab.inner_text("#scene-verdict") == "\N{CHECK MARK} all validations passed"
    assert tab.inner_text("#scene-command").startswith("sdm apply report/plan.npz --angle=2.5 ")
    slider.fill("6")
    assert tab.get_attribute("#turnable", "data-amounts") == '{"flap":6}'
    for text, said in (
        ("99", "99 is outside \N{MINUS SIGN}8 to +8"),
        ("abc", "\u201cabc\u201d is no number"),
        ("", "no number"),
    ):
        typed.fill(text)
        typed.press("Enter")
        assert said in tab.inner_text("#scene-wrong-flap")
        assert tab.get_attribute("#turnable", "data-amounts") == '{"flap":6}'
    slider.fill("-8")
    assert tab.inner_text("#scene-wrong-flap") == ""
    assert tab.get_attribute("#turnable", "data-amounts") == '{"flap":-8}'
    tab.click("#scene-play")
    while tab.get_attribute("#turnable", "data-amounts") == '{"flap":-8}':
        tab.wait_for_timeout(50)
    assert tab.inner_text("#scene-play") == "Stop"
    tab.click("#scene-play")
    tab.click("#scene-own")
    assert tab.get_attribute("#turnable", "data-amounts") == '{"flap":8}'
    titles = tab.locator("#scene-curve title").all_text_contents()
    assert [titles[0].count(" at "), titles[1].count(" % at ")] == [len(held.measured[0])] * 2
    assert tab.locator("#scene-curve polyline").count() == 2  # one quantity an axis
    assert tab.locator("#scene-curve rect.passed").count() == 2


def test_off_the_measured_line_nothing_is_claimed(page):
    tab, _, _ = page("bodies")
    assert tab.locator("#scene-sliders input[type=range]").count() == 2
    assert tab.inner_text("#scene-measured").startswith("Measured here: ")
    for name, amount in (("left", "3"), ("right", "-2")):
        tab.locator(f"#scene-typed-{name}").fill(amount)
        tab.locator(f"#scene-typed-{name}").press("Enter")
    said = "Checks are known for one surface at a time; here 2 are moved. Least quality: of this mesh."
    assert tab.inner_text("#scene-measured") == said
    assert tab.inner_text("#scene-verdict") == "checks not measured here"
    assert 0.0 < float(tab.inner_text("#scene-least")) < 1.0
    assert "--angle=left=3,right=-2" in tab.inner_text("#scene-command")


def test_a_cut_is_seen_from_its_side_and_its_cells_go_with_it(page):
    tab, _, _ = page("wing")
    before = [tab.is_checked("#scene-cells"), tab.input_value("#scene-threshold")]
    tab.select_option("#scene-axis", "y")
    assert [tab.is_checked("#scene-cells"), tab.input_value("#scene-threshold")] == [True, "1"]
    tab.select_option("#scene-axis", "none")
    assert [tab.is_checked("#scene-cells"), tab.input_value("#scene-threshold")] == before


def test_the_worst_cell_has_a_ring_and_its_place_in_words(page):
    tab, result, _ = page("wing")
    worst = min(quality.min for quality in result.quality)
    tab.click("#scene-worst")
    assert tab.get_attribute("#scene-worst", "aria-pressed") == "true"
    tab.wait_for_selector("#scene-labels .ring", state="attached")
    said = " ".join(tab.locator("#scene-labels .worst text").all_text_contents())
    assert re.fullmatch(rf"worst cell: {worst:.3f}; \d\.\d+ before \w+ (on|\d+ cells from) \w+ at \S+, \S+, \S+", said)
    tab.click("#scene-worst")
    tab.wait_for_selector("#scene-labels .ring", state="detached")
    labels = tab.locator("#scene-labels text").all_text_contents()
    assert labels == ["flap +8\N{DEGREE SIGN}"]
    tab.check("#scene-undeflected", force=True)
    tab.wait_for_selector("#turnable[data-state=undeflected]")
    tab.wait_for_timeout(200)
    assert tab.locator("#scene-labels text").all_text_contents() == ["flap"]


def test_the_page_is_for_everyone(page):
    tab, _, _ = page("bodies")
    assert grave(tab) == {}
    tab.emulate_media(color_scheme="dark")
    assert found(tab, rules("color-contrast")) == []
    tab.set_viewport_size({"width": 390, "height": 844})
    assert tab.evaluate("document.documentElement.scrollWidth") == 390
    reached = set()
    tab.locator("body").focus()
    for _ in range(90):
        tab.keyboard.press("Tab")
        reached.add(tab.evaluate("document.activeElement.id || document.activeElement.dataset.turn || ''"))
    names = (
        "amount-left typed-left amount-right typed-right play own copy deflected view colour lines overlay box sites"
    )
    names += " centres cells threshold axis place worst"
    assert {"turnable", "left", "closer", "save", *(f"scene-{name}" for name in names.split())} - reached == set()


@pytest.mark.nightly
def test_a_large_page_is_turned_in_little_time(hybrid_wing, opened, tmp_path):
    """100,000 triangles: the script alone, the median of some frames."""
    result = deflect(plate(160, "triangle"), "hole", PIVOT, 10.0, **HOLE)
    path = result.report(tmp_path / "report")
    tab, _, _ = opened(path)
    tab.check("#scene-cells")
    tab.evaluate(UNFOLD)
    tab.locator("#scene-threshold").fill("1")
    seconds = [tab.evaluate(ASKED, {"hole": amount})["milliseconds"] for amount in np.linspace(1.0, 9.0, 9)]
    assert np.median(seconds) < 100.0  # on a busy machine


def test_a_plan_that_cannot_be_leaves_a_page_without_sliders(opened, tmp_path):
    from tests.deform.volume.test_triangulated import SIDES, warped_block

    given = {"slide": dict.fromkeys(SIDES, "surface"), "box": [[-3.0] * 3, [3.0] * 3], "force": True}
    result = deflect(warped_block(), "body", [[0, 0, 0], [0, 1, 0]], 20.0, **given)
    tab, _, complaints = opened(result.report(tmp_path / "report"))
    assert not tab.locator("#scene-sliders").count()
    assert result.figures()["angle_deg"] == 20.0
    assert complaints == []


@pytest.fixture
def view(sdm):
    return partial(sdm, "view", "--no-open", "--quiet")


def test_a_click_names_the_patch_and_two_make_a_hinge_of_any_mesh(opened, view, tmp_path, block):
    write_mesh(None, block, block.points, tmp_path / "block.su2")
    code, out, _ = view(tmp_path / "block.su2")
    assert (code, out) == (0, f"{tmp_path / 'block-view.html'}\n")
    tab, asked, complaints = opened(tmp_path / "block-view.html")
    assert "body" in tab.inner_text("table")
    assert not tab.locator("#scene-sliders").count()
    frame = tab.locator("#turnable canvas").bounding_box()
    for shift in (0, 40):
        tab.mouse.click(frame["x"] + frame["width"] / 2 + shift, frame["y"] + frame["height"] / 2)
    assert re.search(r"^body, undeflected node at \S+$", tab.inner_text("#scene-picked"))
    said = r"sdm deflect .*block.su2 --surface body \\\n  --hinge \S+ \S+ \\\n  --angle 10"
    assert re.fullmatch(said, tab.inner_text("#scene-hinge-command"))
    tab.wait_for_selector("#scene-labels .picked line", state="attached")
    assert tab.locator("#scene-labels .picked .dot").count() == 2
    assert tab.locator("#scene-labels .picked path").count() == 2  # the sense of a positive angle
    assert tab.is_visible("#scene-copy-hinge")
    assert grave(tab) == {}
    assert complaints == []
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []


def test_a_run_is_opened_and_its_page_made_if_it_is_missing(view, sdm, tmp_path, block, monkeypatch):
    write_mesh(None, block, block.points, tmp_path / "block.su2")
    words = ["--surface", "body", "--hinge", "0,0,0", "0,1,0", "--angle", "5", "--quiet"]
    assert sdm("deflect", tmp_path / "block.su2", *words)[0] == 0
    run = tmp_path / "block-deflected-report"
    shown = []
    monkeypatch.setattr("webbrowser.open", shown.append)
    assert sdm("view", run, "--quiet")[0] == 0
    assert shown == [(run / "report.html").as_uri()]
    (run / "report.html").unlink()
    code, out, _ = view(run)
    assert (code, out) == (0, f"{run / 'report.html'}\n")
    assert (run / "report.html").exists()
    assert shown[1:] == []


def test_nothing_listens(view, tmp_path, block, monkeypatch):
    def refused(*_):
        raise AssertionError("a port is opened")

    monkeypatch.setattr(socket.socket, "listen", refused)
    monkeypatch.setattr(socket.socket, "bind", refused)
    write_mesh(None, block, block.points, tmp_path / "block.su2")
    assert view(tmp_path / "block.su2", "--out", tmp_path / "page.html")[0] == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere"], "nowhere"),
        (["folder"], "folder is not the output folder of a run"),
        (["block.su2", "--out", "folder"], "is there and no file"),
    ],
)
def test_what_cannot_be_viewed_is_one_sentence(words, said, view, tmp_path, block, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    write_mesh(None, block, block.points, tmp_path / "block.su2")
    code, _, err = view(*words)
    assert (code, said in err, err.count("\n")) == (2, True, 1), err


def test_names_cannot_inject_markup(opened, tmp_path, block):
    from dataclasses import replace

    evil = "x<b id=injected>"
    named = replace(block, patches=tuple(replace(one, name=f"{evil}{one.name}") for one in block.patches))
    result = deflect(named, f"{evil}body", [[0, 0, 0], [0, 1, 0]], 5.0)
    tab, _, complaints = opened(result.report(tmp_path / "report"))
    assert tab.locator("#injected").count() == 0
    assert tab.locator("#scene-sliders label").first.inner_text() == f"{evil}body"
    with suppress(KeyError):
        assert f"{evil}body" in tab.evaluate("JSON.parse(document.getElementById('turnable').dataset.amounts)")
    assert complaints == []
