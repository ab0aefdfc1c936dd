"""Pages for everyone: axe-core finds nothing serious on the report and the guide, and they ask no network for anything.

The view is judged with its other tests.
"""

import os
from pathlib import Path

import pytest

from tests.cases.accessible import grave

# Environment variable: the folder of the built guide.
GUIDE = "SDM_DEFLECT_GUIDE"
PAGES = sorted(page.stem for page in (Path(__file__).parents[2] / "docs").glob("*.md"))


@pytest.fixture(scope="module")
def guide():
    """The guide as it is built; a pipeline names its folder."""
    folder = Path(os.environ.get(GUIDE) or Path(__file__).parents[2] / "docs" / "_build" / "html")
    if not (folder / "index.html").is_file():
        pytest.skip(
            f"the guide is not built: sphinx-build -b html docs docs/_build/html, or name its folder by {GUIDE}"
        )
    return folder


@pytest.fixture(scope="module")
def tab(browser):
    """A tab that reaches files of this machine alone; it has what else was asked for."""
    shown = browser.new_page(reduced_motion="reduce")
    shown.asked = []

    def answer(route):
        if route.request.url.startswith(("file:", "data:", "blob:")):
            return route.continue_()
        shown.asked.append(route.request.url)
        return route.abort()

    shown.route("**/*", answer)
    yield shown
    shown.close()


@pytest.mark.nightly
@pytest.mark.parametrize("page", [*PAGES, "api/public", "tutorials/index", "tutorials/first-deflection"])
def test_a_page_of_the_guide(guide, tab, page):
    tab.goto((guide / f"{page}.html").as_uri())
    assert grave(tab) == {}
    assert tab.evaluate("[...document.images].filter((one) => !one.naturalWidth).map((one) => one.src)") == []
    assert tab.asked == []


@pytest.mark.nightly
def test_numbers_stand_beside_formulas_on_a_phone(guide, tab):
    tab.set_viewport_size({"width": 390, "height": 844})
    tab.goto((guide / "theory.html").as_uri())
    edges = tab.evaluate(
        """() => [...document.querySelectorAll("div.math:has(.eqno)")].map((one) => [
             one.querySelector(".formula").getBoundingClientRect().right,
             one.querySelector(".eqno").getBoundingClientRect().left])"""
    )
    assert len(edges) > 10
    assert all(formula <= number for formula, number in edges)
    assert tab.evaluate("document.fonts.check('16px Guide Math')")


@pytest.mark.nightly
@pytest.mark.parametrize("page", ["theory", "ten-minutes", "tutorials/appendix-a", "tutorials/rbf-from-scratch"])
def test_no_formula_is_cut_off_on_a_phone(guide, tab, page):
    tab.set_viewport_size({"width": 390, "height": 844})
    tab.goto((guide / f"{page}.html").as_uri())
    wide = "[...document.querySelectorAll('div.math .formula')].filter((one) => one.scrollWidth > one.clientWidth)"
    assert tab.evaluate(f"{wide}.map((one) => one.textContent)") == []
    assert tab.locator("div.math").count() > 0


@pytest.mark.mesher
def test_a_report(aileron_run, tab):
    tab.goto((aileron_run[1] / "report.html").as_uri())
    tab.wait_for_selector("#turnable[data-state=deflected]", timeout=60_000)
    tab.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true })")
    assert grave(tab) == {}
    assert tab.asked == []
