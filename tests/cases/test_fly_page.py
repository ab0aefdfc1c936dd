""" "Fly the mesh": its positions, centres and counts are the package's, and anyone can use it."""

import json
import re
from base64 import b64decode

import numpy as np
import pytest

from docs.fly import facts
from docs.fly.flight import MOST, Shown, flight, planned, unpacked
from docs.fly.page import PAGE, whole
from docs.fly.tail import Tail
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from tests.cases.accessible import grave

SOURCE = PAGE.read_text(encoding="utf-8")
DATA = re.compile(r'(<script id="flight" type="text/plain">)([^<]*)')
# Of values up to 1: what sums in another order change.
AGREED = 1e-9
# Of positions, in metres: half a quantum of 16 bits of each field, and of single precision.
ROUNDED = 6e-7
# Roll, pitch and yaw, as shares of the ranges.
POSES = (
    *((0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1)),
    *((0.5, 0.5, 0.5), (-0.3, 0.9, -0.7), (0.7, -0.7, 1), (0, 0, 0)),
)
# What a page without WebGL 2 sees.
NO_WEBGL = """const own = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
    return kind === "webgl2" ? null : own.call(this, kind, ...more);
};"""
# Interpolate columns of two values at all sites.
FIT = """([sites, values, points]) => {
    const x = Float64Array.from(sites), rows = [...Array(x.length / 3).keys()];
    return Array.from(new fly.Interpolant(x, values, 2, rows, fly.scaling(x)).at(Float64Array.from(points)));
}"""
FOCUSED = "(({id, value, innerText}) => id || value || innerText)(document.activeElement)"
# Addresses that nobody should write, and the step that they open.
STRANGE = {
    "step=9": 1, "step=-2": 1, "step=abc": 1, "step=4.7&more=1e9": 4, "step=4&more=-3&pitch=nan": 4,
    "step=3&sites=2": 3, "step=2&parts=99": 2, "step=1&roll=7&surface=wing": 1, "#&&=": 1, "step=5&pitch=-Infinity": 5,
}  # fmt: skip


@pytest.fixture(scope="module")
def said():
    return json.loads(facts.KEPT.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def kept(said):
    return said["tail"]


@pytest.fixture(scope="module")
def plan():
    return planned()


@pytest.fixture(scope="module")
def tail():
    return Tail.at()


@pytest.fixture
def tab(browser):
    """The page; it must not ask for anything, nor say anything on its console."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    page, asked, said = context.new_page(), [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda line: said.append(line.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(PAGE.as_uri())
    page.wait_for_selector("body[data-ready]", timeout=60_000)
    yield page
    assert [url for url in asked if not url.startswith("data:")] == [PAGE.as_uri()]
    assert said == []
    context.close()


def at(tab, address):
    """Open a state; return what its cells are judged as."""
    tab.evaluate("address => fly.at(address)", address)
    return tab.evaluate("fly.judged()")


def number(tab, name):
    """Return the first number of a readout."""
    return float(re.match(r"[\d.,−+]+", tab.inner_text(f"#{name}"))[0].replace(",", "").replace("−", "-"))


def test_it_is_one_small_file_made_of_todays_parts_and_data():
    assert len(SOURCE.encode()) <= 1_000_000
    assert not re.search("https?:", SOURCE.lower())
    data = flight()
    assert DATA.sub(r"\1", whole(data)) == DATA.sub(r"\1", SOURCE)
    (meta, arrays), (old, held) = unpacked(data), unpacked(b64decode(DATA.search(SOURCE)[2]))
    assert meta["arrays"] == old["arrays"]
    for name, values in arrays.items():
        apart = np.abs(values.astype(float) - held[name]).max()
        field = name == "lattice" or name == "whole" or name.startswith("fields")
        assert apart <= (2 if field else 1e-6 if values.dtype.kind == "f" else 0), name
    quanta = [(one["quanta"], two["quanta"]) for one, two in zip(meta["surfaces"], old["surfaces"], strict=True)]
    for new, before in (*quanta, (meta["free"], old["free"]), (meta["lattice"]["quanta"], old["lattice"]["quanta"])):
        assert new == pytest.approx(before, rel=2 / MOST)


def test_its_numbers_are_data():
    """The text as written has none but those of names of steps, of commands, and the ideal quality."""
    written = (PAGE.parent / "fly" / "page.html").read_text(encoding="utf-8")
    without = r"<(style|script|code|h2|b|sub|button).*?</\1>|<[^>]*>|\{\w+\}|1 is ideal"
    assert re.findall(r"\d", re.sub(without, "", written, flags=re.DOTALL)) == []


def test_positions_are_those_of_the_plan(tab, plan, tail):
    nodes = Shown.of(tail, plan).nodes
    for roll, pitch, yaw in POSES:
        at(tab, f"step=1&roll={roll}&pitch={pitch}&yaw={yaw}")
        amounts = dict(zip([one.name for one in plan.controls], tab.evaluate("fly.amounts"), strict=True))
        assert amounts == pytest.approx({
            "aileron_left": 20 * roll, "aileron_right": -20 * roll, "tail_left": 20 * pitch, "tail_right": 20 * pitch,
            "rudder": -25 * yaw,
        })  # fmt: skip
        own = np.array(tab.evaluate("Array.from(fly.points)")).reshape(-1, 3)
        start = np.array(tab.evaluate("Array.from(fly.flight.start)")).reshape(-1, 3)
        assert np.abs(start - plan.start[nodes]).max() < ROUNDED
        assert np.abs(own - plan.at(amounts)[nodes]).max() < ROUNDED


def test_all_cells_that_can_change_are_counted(tab, tail, plan, said):
    judged = at(tab, "step=1&pitch=1")
    rows = np.flatnonzero(np.isin(tail.tets, np.concatenate(plan.rows)).any(axis=1))
    quality, inverted = tail.quality(plan.at({"tail_left": 20, "tail_right": 20}), rows)
    assert judged["count"] == len(rows) == said["lesson"]["page"]["cells"]
    assert judged["inverted"] == inverted.sum() == said["lesson"]["page"]["inverted"] == 0
    assert judged["worse"] == pytest.approx(said["lesson"]["page"]["worse"], abs=1)
    assert judged["least"] == pytest.approx(quality.min(), abs=1e-3)
    assert number(tab, "least") == pytest.approx(quality.min(), abs=1e-3)


def test_the_box_tears_without_its_sites_and_holds_with_them(tab, kept):
    judged = at(tab, "step=3&sites=0")
    assert judged["inverted"] == kept["without_box"]["inverted"] == number(tab, "inverted")
    assert judged["worse"] == kept["without_box"]["worse"]
    assert number(tab, "jump") == pytest.approx(1e3 * kept["jump"], abs=0.06)
    assert number(tab, "motion") == pytest.approx(1e3 * kept["motion"], abs=0.06)
    tab.click("#sites")
    judged = tab.evaluate("fly.judged()")
    assert judged["inverted"] == kept["with_box"]["inverted"] == 0
    assert judged["least"] == pytest.approx(kept["with_box"]["least"], abs=1e-3)
    assert tab.inner_text("#jump") == "0"


def test_centres_are_those_of_the_package(tab, tail, kept):
    for count, one in kept["centres"].items():
        judged = at(tab, f"step=4&more={int(count) - 8}")
        assert number(tab, "centres") == int(count)
        assert judged["inverted"] == one["inverted"], count
        assert judged["least"] == pytest.approx(one["least"], abs=1e-3)
        assert number(tab, "error") == pytest.approx(1e3 * one["error"], abs=0.06)
    chosen = tab.evaluate("fly.state.field.centres")
    assert chosen == tail.greedy(len(chosen)).chosen.tolist()
    at(tab, "step=4&more=1e9")
    assert number(tab, "centres") == 200
    assert tab.is_disabled("#more-20")
    tab.click("#all-centres")
    assert not tab.is_disabled("#more-20")
    assert tab.evaluate("fly.judged().inverted") == 0
    assert number(tab, "centres") == kept["sites"]


def test_its_field_is_the_fit_of_its_sites(tab):
    at(tab, "step=4&pitch=-0.6&more=30")
    ask = "Object.fromEntries(Object.entries({sites: fly.tail.sites, values: fly.tail.values, free: fly.tail.free,"
    ask += " nodes: fly.state.field.nodes}).map(([name, array]) => [name, Array.from(array)]))"
    own = {name: np.array(values) for name, values in tab.evaluate(ask).items()}
    sites, free = own["sites"].reshape(-1, 3), own["free"].reshape(-1, 3)
    values, nodes = own["values"].reshape(len(sites), -1), own["nodes"].reshape(len(free), -1)
    chosen = tab.evaluate("fly.state.field.centres")
    assert len(chosen) == 38
    assert np.abs(fit(ThinPlateSpline(), sites[chosen], values[chosen])(free) - nodes).max() < AGREED


def test_its_fit_is_that_of_the_package(tab):
    rng = np.random.default_rng(7)
    sites, points = rng.uniform(-0.3, 1.4, (90, 3)), rng.uniform(-0.3, 1.4, (400, 3))
    values = np.column_stack([np.sin(3 * sites[:, 0]), np.cos(2 * sites[:, 1])])
    found = tab.evaluate(FIT, [sites.ravel().tolist(), values.ravel().tolist(), points.ravel().tolist()])
    assert np.abs(np.array(found).reshape(-1, 2) - fit(ThinPlateSpline(), sites, values)(points)).max() < AGREED


def test_the_sum_is_complete_with_its_linear_part(tab):
    at(tab, "step=2&parts=1")
    assert "one function" in tab.inner_text("#caption")
    for _ in range(8):
        tab.click("#more-parts")
    assert "the whole sum" in tab.inner_text("#caption")
    assert tab.is_disabled("#more-parts")
    at(tab, "step=2&parts=9")
    assert "the whole sum" in tab.inner_text("#caption")


def test_keys_alone_do_it(tab):
    reached = set()
    for _ in range(24):
        tab.keyboard.press("Tab")
        reached.add(
            tab.evaluate(
                "document.activeElement.id || document.activeElement.value || document.activeElement.innerText"
            )
        )
    assert reached >= {"view", "stick", "yaw", "release", "1", "4", "6", "Guide as text", "Lesson as text", "Slides"}
    tab.focus("#stick")
    for _ in range(5):
        tab.keyboard.press("ArrowUp")
    tab.keyboard.press("ArrowRight")
    assert number(tab, "tail_left") == 10
    assert number(tab, "aileron_left") == 2
    tab.keyboard.press("0")
    assert number(tab, "tail_left") == 0
    tab.focus("#yaw")
    tab.keyboard.press("End")
    assert number(tab, "rudder") == -25
    tab.focus("#steps button[value='4']")
    tab.keyboard.press("Enter")
    tab.focus("#more-20")
    tab.keyboard.press("Enter")
    assert number(tab, "centres") == 28
    assert tab.evaluate("location.hash") == "#step=4"


def test_the_stick_follows_a_pointer(tab):
    area = tab.locator("#stick").bounding_box()
    x, y, size = area["x"] + area["width"] / 2, area["y"] + area["height"] / 2, area["width"]
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 0.2 * size, y)
    assert number(tab, "aileron_left") == pytest.approx(10, abs=0.5)
    tab.mouse.move(x, y - 3 * size)
    assert number(tab, "tail_left") == 20
    tab.mouse.up()
    tab.mouse.move(x, y)
    assert number(tab, "tail_left") == 20


@pytest.mark.parametrize(("address", "step"), STRANGE.items())
def test_a_strange_address_opens_a_state(tab, address, step):
    judged = at(tab, address)
    assert tab.get_attribute("[aria-current]", "value") == str(step)
    assert 0 <= judged["least"] <= 1
    assert all(-25 <= amount <= 25 for amount in tab.evaluate("fly.amounts"))


def test_without_webgl_the_figure_stands_there(browser):
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    page = context.new_page()
    page.add_init_script(NO_WEBGL)
    page.goto(PAGE.as_uri())
    page.wait_for_selector("body[data-ready]", timeout=60_000)
    assert page.is_visible("#figure-picture")
    page.click("#steps button[value='3']")
    assert page.is_visible("#section")
    assert not page.is_visible("#figure-picture")
    context.close()


def test_a_browser_that_is_too_old_is_told_so(browser):
    context = browser.new_context()
    page = context.new_page()
    page.add_init_script("delete window.DecompressionStream;")
    page.goto(PAGE.as_uri())
    assert page.inner_text("#caption").startswith("This browser is older than 2023")
    context.close()


def test_on_paper_it_is_the_figure_and_the_text_of_all_steps(tab):
    tab.emulate_media(media="print")
    assert tab.is_visible("#figure-picture")
    assert not tab.is_visible("#panel")
    assert tab.locator("#says h2").evaluate_all("all => all.every(one => one.offsetHeight > 0)")


def test_anyone_can_use_it(tab):
    for step in (1, 4, 6):
        at(tab, f"step={step}")
        assert grave(tab) == {}, step


def test_a_phone_has_the_picture_before_all_else(tab):
    tab.set_viewport_size({"width": 390, "height": 844})
    order = ["#view", "#steps", "#says", "#panel"]
    tops = [tab.locator(name).bounding_box()["y"] for name in order]
    assert tops == sorted(tops)
    assert tops[0] < 140
    assert tab.evaluate("getComputedStyle(document.querySelector('#view canvas')).touchAction") == "pan-y"
