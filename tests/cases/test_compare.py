"""`sdm compare`: what differs is said in words, pictures of one mesh fit over each other, the page is offline."""

import json
import shutil
from dataclasses import replace
from functools import partial
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from sdm_deflect import deflect, read
from sdm_deflect.cases.compare import pictures
from sdm_deflect.cases.compare.figures import Row, alike, differing_settings, read_runs, tables
from sdm_deflect.cases.compare.page import page, write_page
from sdm_deflect.cases.compare.pictures import overlaid
from sdm_deflect.cases.report.folder import folder_of, write_run_folder
from sdm_deflect.cases.report.pictures import Gallery
from sdm_deflect.cases.run.mesh_files import write_mesh
from tests.meshing.formats.wing import wing

EVIL = "x<b id=injected>"
KINDS = {"tps": (8.0, {}), "wendland": (8.0, {"kernel": "wendland"}), "steep": (14.0, {"kernel": "mq"})}


def finished(home, mesh, out, hinge, angle, **options):
    """Deflect a file and write the folder beside its result, without pictures; return the folder."""
    options = {"motion": "blended", "fixed": "wing_*", "slide": "symmetry:plane", "repair": "off", **options}
    one = deflect(read(home / mesh), "flap_*", hinge, angle, **options)
    folder = folder_of(home / out)
    write_run_folder(folder, one.deflection, one.checks, home / out, {})
    return folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory, hybrid_wing):
    """Three deflections of one mesh, and one of a coarser mesh; by name."""
    home, coarse = tmp_path_factory.mktemp("runs"), wing(cells=3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sdm_deflect.cases.report.pictures.drawn", lambda *_: Gallery(()))
        for name, one in (("wing.su2", hybrid_wing), ("coarse.su2", coarse)):
            write_mesh(None, one.mesh, one.mesh.points, home / name)
        own = {
            name: finished(home, "wing.su2", f"{name}.su2", hybrid_wing.hinge, angle, **options)
            for name, (angle, options) in KINDS.items()
        }
        return own | {"coarse": finished(home, "coarse.su2", "coarse-8.su2", coarse.hinge, 8.0)}


@pytest.fixture(scope="module")
def runs(folders):
    return read_runs([folders[name] for name in KINDS])


@pytest.fixture(scope="module")
def page_path(runs, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "compare.html"
    write_page(runs, path)
    return path


def rows_of(runs):
    return {row.name: row for table in tables(runs) for row in table.rows}


def test_figures_are_those_of_the_runs(runs):
    rows = rows_of(runs)
    figures = [run.data.figures for run in runs]
    assert rows["kernel"].values == ("tps", "wendland", "mq")
    assert rows["kernel"].texts == ("tps", "wendland", "mq")
    for direction in "xyz":
        expected = tuple(one["adaptation"][direction]["centers"] for one in figures)
        assert rows[f"centres, {direction}"].values == expected
    assert rows["condition"].values == tuple(
        max(fit["condition"] for fit in one["adaptation"].values()) for one in figures
    )
    assert rows["error between the sites, largest"].values == tuple(
        one["error_between_sites"]["max"] for one in figures
    )
    least = tuple(one["quality_inside"]["after"]["wedge"]["min"] for one in figures)
    assert rows["wedge: least quality, deflected"].values == least
    assert rows["points"].same
    assert not rows["moves"].same
    assert [run.name for run in runs] == ["tps-report", "wendland-report", "steep-report"]


def test_settings_that_differ_and_no_others(runs):
    found = {row.name: row.values for row in differing_settings(runs)}
    assert found["kernel"] == ("tps", "wendland", "mq")
    assert found["surface[0].angle"] == (8.0, 8.0, 14.0)
    assert found["kernel_radius"] == tuple(run.data.figures["kernel"]["radius"] or 0.0 for run in runs)
    assert not {"strategy", "fixed", "surface[0].hinge"} & found.keys()
    assert differing_settings(runs[:1] * 2) == ()


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ((100, 100), ("100", "100")),
        ((1000, 1090), ("1,000", "1,090 (+9 %)")),
        ((1.0, 0.5001), ("1", "0.5001 (-50 %)")),
        ((2.0, 10.0, 2.0), ("2", "10 (× 5)", "2")),
        ((0.0, 3.0), ("0", "3 (+3)")),
        ((-1.0, 1.0), ("-1", "1 (+2)")),
        ((1.0, 1.0 + 1e-5), ("1", "1 (by less than 0.05 %)")),
        ((None, 3.0, "a"), ("–", "3", "a")),
    ],
)
def test_changes_are_told_in_words(values, texts):
    row = Row("a", values, form="," if isinstance(values[0], int) else ".4g")
    assert row.texts == texts
    assert row.same == (len(set(values)) == 1)


@pytest.mark.nightly
def test_pictures_over_each_other_have_the_same_axes(runs, tmp_path):
    """Labels and colours are the same to the pixel; what lies between them is not."""
    found = overlaid(runs, tmp_path)
    assert found.missing == ()
    assert [list(one.exhibits) for one in found.overlays] == 3 * [["undeflected", *(run.name for run in runs)]]
    for one in found.overlays:
        images = [np.asarray(Image.open(exhibit.path).convert("RGB"), dtype=int) for exhibit in one.exhibits.values()]
        assert len({image.shape for image in images}) == 1
        for image in images[1:]:
            assert 0.001 < (np.abs(image - images[0]).max(axis=2) > 60).mean() < 0.5
    section = found.overlays[0]
    images = [np.asarray(Image.open(one.path).convert("L"), dtype=int) for one in section.exhibits.values()]
    width = images[0].shape[1]
    for beyond in (np.s_[:, : int(0.12 * width)], np.s_[:, int(0.83 * width) :]):  # labels, colours
        assert all(np.abs(image[beyond] - images[0][beyond]).max() < 60 for image in images)


def test_another_mesh_is_compared_by_figures_alone(folders, tmp_path):
    runs = read_runs([folders["tps"], folders["coarse"]])
    assert alike(runs) == runs[:1]
    found = overlaid(runs, tmp_path)
    assert found.overlays == ()
    (sentence,) = found.missing
    assert "coarse-8-report" in sentence
    assert not rows_of(runs)["points"].same
    assert "coarse-8-report" in page(runs, tables(runs), differing_settings(runs), found)


def test_surfaces_without_room_are_named(runs, tmp_path, monkeypatch):
    monkeypatch.setattr(pictures, "MOST", 0)
    (pair,) = pictures._surfaces(runs)[0]
    assert [surface.name for _, surface in pair] == 3 * ["flap"]
    two = [replace(run, data=replace(run.data, boxes=run.data.boxes)) for run in runs]
    for run in two:
        box = run.data.boxes[0]
        other = replace(box.surfaces[0], name="second", patches=("other",))
        object.__setattr__(run.data, "boxes", (replace(box, surfaces=(box.surfaces[0], other)),))
    assert pictures._surfaces(two)[1] == ["second"]


def pixels(tab, overlay):
    tab.wait_for_timeout(100)
    return np.asarray(Image.open(BytesIO(overlay.screenshot())).convert("RGB"), dtype=int)


@pytest.fixture
def shown(browser):
    """Open the page at a width; return it, what it asked of any network, and what it complained of."""
    contexts = []

    def show(path, width=1200, scheme="light"):
        contexts.append(browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme))
        tab, asked, complaints = contexts[-1].new_page(), [], []
        tab.on("request", lambda request: asked.append(request.url))
        tab.on("console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None)
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.goto(path.as_uri())
        return tab, asked, complaints

    yield show
    for context in contexts:
        context.close()


@pytest.mark.nightly
def test_the_line_moves_by_keys_and_each_side_is_one_run(page_path, shown):
    tab, asked, complaints = shown(page_path)
    figure = tab.locator("figure.compared").first
    over, line = figure.locator(".over"), figure.locator("input")
    assert over.locator("img:visible").count() == 2
    line.focus()
    tab.keyboard.press("Home")
    right = pixels(tab, over)
    assert line.get_attribute("aria-valuetext") == "0 % tps-report, then wendland-report"
    tab.keyboard.press("End")
    left = pixels(tab, over)
    assert line.input_value() == "100"
    line.fill("50")
    both, middle = pixels(tab, over), left.shape[1] // 2
    labels = slice(60, None)  # below the names of the runs
    assert np.abs(left - right)[labels].max() > 60
    assert np.abs(both - left)[labels, : middle - 8].max() < 20
    assert np.abs(both - right)[labels, middle + 8 :].max() < 20
    figure.locator("select").nth(1).select_option("undeflected")
    assert np.abs(pixels(tab, over) - both)[labels, middle + 8 :].max() > 60
    assert over.locator(".tag.right").inner_text() == "undeflected"
    assert asked == [page_path.as_uri(), *(url for url in asked if url.startswith("data:"))]
    assert complaints == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_telephone_scrolls_tables_and_not_the_page(scheme, page_path, shown):
    tab, _, complaints = shown(page_path, 390, scheme)
    assert tab.evaluate("document.documentElement.scrollWidth") == 390
    ground = tab.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(255, 255, 255)") == (scheme == "light")
    assert complaints == []


def test_differences_are_words_not_colours_alone(page_path, shown):
    tab, _, _ = shown(page_path)
    for row in tab.locator("table.figures tbody tr").all():
        marked = "differs" in (row.get_attribute("class") or "")
        assert row.locator("td").last.inner_text() == ("differs" if marked else "same")
    assert tab.locator("tr.differs").count() > 5
    for image in tab.locator("img").all():
        assert len(image.get_attribute("alt")) > 60


def test_names_cannot_inject_markup(runs, shown, tmp_path):
    evil = tuple(replace(run, name=f"{EVIL}{i}", data=replace(run.data, title=EVIL)) for i, run in enumerate(runs[:2]))
    write_page(evil, tmp_path / "compare.html")
    tab, _, complaints = shown(tmp_path / "compare.html")
    assert tab.locator("#injected").count() == 0
    assert EVIL in tab.locator("ol.runs").inner_text()
    assert complaints == []


@pytest.fixture
def compare(sdm, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return partial(sdm, "compare")


def test_the_command_writes_the_page_and_prints_the_numbers(folders, compare, tmp_path):
    code, out, _ = compare(folders["tps"], folders["steep"], "--json")
    found = json.loads(out)
    assert code == 0
    assert [one["name"] for one in found["runs"]] == ["tps-report", "steep-report"]
    assert found["same_mesh"]
    assert found["settings"]["kernel"] == ["tps", "mq"]
    rows = {row["name"]: row for row in found["tables"]["Interpolation"]}
    assert rows["kernel"] == {"name": "kernel", "unit": "", "values": ["tps", "mq"], "same": False}
    assert (tmp_path / found["page"]).stat().st_size > 1e5
    code, out, _ = compare(folders["tps"], folders["steep"], "--out", "other.html", "-q")
    assert (code, out.startswith("other.html: ")) == (0, True)


def test_what_cannot_be_compared_is_one_sentence(folders, compare, tmp_path):
    damaged = tmp_path / "damaged"
    shutil.copytree(folders["steep"], damaged)
    (damaged / "metrics.json").write_text("{")
    edited, figures = tmp_path / "edited", json.loads((folders["steep"] / "metrics.json").read_text())
    shutil.copytree(folders["steep"], edited)
    figures["validation"]["checks"][0]["limit"] = "none"
    (edited / "metrics.json").write_text(json.dumps(figures))
    for copy in (damaged, edited):  # their mesh stands beside the others
        text = (copy / "settings.toml").read_text()
        (copy / "settings.toml").write_text(text.replace("../", f"{folders['steep'].parent}/"))
    one, other = folders["tps"], folders["steep"]
    for words, said in (
        ([one], "1 runs cannot be compared: give 2 to 8"),
        ([one] * 9, "9 runs cannot be compared"),
        ([one, one], "is given twice"),
        ([one, tmp_path], "has no case.toml and no settings.toml"),
        ([one, tmp_path / "none"], "has no case.toml and no settings.toml"),
        ([one, damaged], "metrics.json"),
        ([one, edited], "edited: no whole folder of a run"),
        ([one, other, "--out", "page.pdf"], "the suffix must be .html"),
        ([one, other, "--out", tmp_path / "folder.html"], "is there and no file"),
    ):
        (tmp_path / "folder.html").mkdir(exist_ok=True)
        code, _, err = compare(*words, "-q")
        assert (code, said in err, err.count("\n")) == (2, True, 1), (words, err)
    assert not list(tmp_path.glob("*.pdf"))


def test_figures_that_are_missing_or_of_another_kind_are_left_out(runs):
    """As in folders of earlier versions, or edited ones."""
    odd = {"deflections": {"flap": {"adaptation": {"x": {"centers": "many"}}, "kernel": 5}}, "mesh": [], "points": {}}
    one = replace(runs[0], data=replace(runs[0].data, figures=odd))
    rows = rows_of([runs[1], one])
    assert rows["condition"].values[1] is None
    assert rows["kernel"].values == ("wendland", None)
    assert not rows["kernel"].same
    assert "flap" in rows["moves"].values[1]
