"""What pages lack for keyboards and screen readers: levels of headings, and a way to scroll what is wider than a phone.

Sphinx and the theme write the markup that is mended here.
"""

import re
from typing import Any

from sphinx.application import Sphinx

AFTER_THE_THEME = 900
MENDED = {
    "<pre>": '<pre tabindex="0">',
    '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
    '<div class="output text_html">': '<div tabindex="0" class="output text_html">',
    '<div role="list" class="citation-list">': "<div>",
}
# Parameters of a signature on lines of their own: a list of descriptions without what they describe.
PARAMETERS = re.compile(r"<dl>\n((?:<dd><em class=\"sig-param.*?</dd>\n)+)</dl>")


def reachable(body: str) -> str:
    """Return the body of a page in which the keyboard reaches what scrolls sideways, and lists are lists."""
    for plain, mended in MENDED.items():
        body = body.replace(plain, mended)
    return PARAMETERS.sub(_divisions, body)


def _divisions(found: re.Match[str]) -> str:
    rows = found[1].replace("<dd>", "<div>").replace("</dd>", "</div>")
    return f'<div class="sig-params">\n{rows}</div>'


def with_levels(navigation: str) -> str:
    """Return the list of pages whose captions are headings of a level."""
    return navigation.replace('role="heading"', 'role="heading" aria-level="2"')


def process(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Mend a page before it is written."""
    context["body"] = reachable(context.get("body", ""))
    context["furo_navigation_tree"] = with_levels(context.get("furo_navigation_tree", ""))


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to the writer of pages, after the theme."""
    app.connect("html-page-context", process, priority=AFTER_THE_THEME)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
