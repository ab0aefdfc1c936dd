"""The method in the browser: the page's own fit is the package's, and its controls do what they say."""

import numpy as np
import pytest

from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import kernel_of
from tests.cases.accessible import grave
from tests.docs.commands import ROOT

PAGE = ROOT / "docs" / "playground.html"
# Of values up to 1.
AGREED = 1e-9


@pytest.fixture
def tab(browser):
    """The page; it must not ask for anything, nor complain."""
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    page, asked, complaints = context.new_page(), [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(PAGE.as_uri())
    yield page
    assert (asked, complaints) == ([PAGE.as_uri()], [])
    context.close()


def state(tab):
    return tab.evaluate("sdm.state()")


def test_the_page_is_small(tab):
    assert PAGE.stat().st_size <= 60_000
    assert tab.evaluate("sdm.nodes.length") <= 1_500
    assert "http" not in PAGE.read_text(encoding="utf-8").lower()


@pytest.mark.parametrize("name", ["tps", "mq", "wendland", "cubic"])
def test_its_fit_is_that_of_the_package(tab, name):
    rng = np.random.default_rng(7)
    sites, points = rng.uniform(-0.3, 1.4, (90, 2)), rng.uniform(-0.3, 1.4, (400, 2))
    values = np.column_stack([np.sin(3 * sites[:, 0]), np.cos(2 * sites[:, 1])])
    asked = "([x, v, p, kernel]) => { const f = sdm.fit(x, v, kernel); return [f.at(p), f.history]; }"
    kernel = {"name": name, "radius": 0.6}
    found, history = tab.evaluate(asked, [sites.tolist(), values.tolist(), points.tolist(), kernel])
    with_z = [np.column_stack([some, np.zeros(len(some))]) for some in (sites, points)]
    own = fit(kernel_of(name, 0.6), with_z[0], values)(with_z[1])
    assert np.abs(np.array(found) - own).max() < AGREED
    assert len(history) == 1
    assert history[0] < AGREED


def test_centres_are_added_where_the_error_is_largest_until_the_tolerance(tab):
    before = state(tab)
    tab.click("#one")
    after = state(tab)
    assert after["centres"] == [before["centres"][0] + 1]
    tab.click("#all")
    joint = state(tab)
    assert joint["error"] <= 0.01 < before["error"]
    assert len(joint["history"][0]) == joint["centres"][0] - before["centres"][0] + 1
    tab.check("[value=SQUV]")
    tab.click("#all")
    own = state(tab)
    assert own["error"] <= 0.01
    assert own["centres"][0] < own["centres"][1] <= joint["centres"][0] + 2
    assert tab.inner_text("#cost") == str(sum(own["centres"]))
    tab.click("#again")
    assert state(tab)["centres"] == [5, 5]


def test_the_keyboard_alone_does_it(tab):
    reached = set()
    for _ in range(11):
        tab.keyboard.press("Tab")
        reached.add(tab.evaluate("document.activeElement.id || document.activeElement.value"))
    assert reached >= {"angle", "zeros", "MV", "kernel", "tolerance", "one", "all", "again"}
    tab.focus("#all")
    tab.keyboard.press("Enter")
    assert state(tab)["error"] <= 0.01
    worst = tab.inner_text("#worst")
    tab.focus("#angle")
    for _ in range(15):
        tab.keyboard.press("ArrowRight")
    assert tab.inner_text("[for=angle]") == "35°"
    assert tab.inner_text("#worst") != worst
    label = tab.get_attribute("#mesh", "aria-label")
    assert "turned by 35 degrees" in label


def test_a_click_on_a_side_of_the_box_places_a_site(tab):
    count = state(tab)["sites"]
    area = tab.locator("#mesh").bounding_box()
    tab.mouse.click(area["x"] + area["width"] * (1.42 - 0.42) / 1.08, area["y"] + area["height"] / 2 + 11)
    assert state(tab)["sites"] == count + 1
    tab.mouse.click(area["x"] + area["width"] / 2, area["y"] + area["height"] / 4)
    assert state(tab)["sites"] == count + 1


def test_anyone_can_use_it(tab):
    assert grave(tab) == {}
