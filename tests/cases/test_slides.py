"""The slides: by the keyboard alone, with notes, on screen and on paper."""

import pytest
from pages import DOCS, PICTURE, whole

from tests.cases.accessible import grave

SOURCE = DOCS / "slides.html"


@pytest.fixture
def tab(browser, tmp_path):
    """The slides as one file, as in the built guide; they ask for nothing else."""
    page = tmp_path / "slides.html"
    page.write_text(whole(SOURCE.read_text(encoding="utf-8")), encoding="utf-8")
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    tab, asked, complaints = context.new_page(), [], []
    tab.on("request", lambda request: asked.append(request.url[:40]))
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.goto(page.as_uri())
    yield tab
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    assert (len([url for url in asked if url.startswith("file:")]), complaints) == (1, [])
    context.close()


def title(tab):
    return tab.locator("section.shown").locator("h1, h2").inner_text()


def test_there_are_twelve_to_fifteen_with_notes_and_pictures(tab):
    count = tab.locator("section").count()
    assert 12 <= count <= 15
    assert tab.locator("section aside").count() == count
    pictures = tab.locator("img").count()
    assert pictures == len(PICTURE.findall(SOURCE.read_text(encoding="utf-8"))) >= 9
    assert tab.evaluate("[...document.images].every(one => one.complete && one.naturalWidth > 100 && one.alt)")


def test_keys_turn_them(tab):
    first = title(tab)
    tab.keyboard.press("ArrowRight")
    second = title(tab)
    assert second != first
    tab.keyboard.press("End")
    assert tab.inner_text("#where") == "13 of 13"
    assert tab.is_disabled("#next")
    tab.keyboard.press("Home")
    assert title(tab) == first
    assert not tab.is_visible("section.shown aside")
    tab.keyboard.press("n")
    assert tab.is_visible("section.shown aside")
    assert tab.get_attribute("#notes", "aria-pressed") == "true"
    tab.keyboard.press("Tab")
    tab.keyboard.press("Enter")
    assert title(tab) == second


def test_each_is_a_page_on_paper(tab):
    printed = tab.pdf(prefer_css_page_size=True)
    assert printed.count(b"/Type /Page\n") == 13


def test_anyone_can_use_them(tab):
    assert grave(tab) == {}
    tab.keyboard.press("End")
    assert grave(tab) == {}
