"""Pages of the guide that are files of their own: the slides with their pictures in them, and "Fly the mesh".

In the clone they link to the guide's sources, `*.md`, and say that these are text; in the built guide to its pages.
"""

import base64
import re
from pathlib import Path

from sphinx.application import Sphinx

DOCS = Path(__file__).parents[1]
PAGES = ("slides.html", "fly.html")
PICTURE = re.compile(r'src="(figures/[\w.]+\.png)"')
LINK = re.compile(r'href="([\w-]+)\.md(#[\w-]+)?"')
# What a link says of itself in the clone.
AS_TEXT = "<small> as text</small>"


def whole(page: str) -> str:
    """Return a page with its pictures in it, and with links to pages of the built guide."""

    def inside(found: re.Match[str]) -> str:
        data = base64.b64encode((DOCS / found[1]).read_bytes()).decode()
        return f'src="data:image/png;base64,{data}"'

    return LINK.sub(r'href="\1.html\2"', PICTURE.sub(inside, page.replace(AS_TEXT, "")))


def write(app: Sphinx, error: Exception | None) -> None:
    """Write the pages beside the others."""
    if error is None and app.builder.format == "html":
        for name in PAGES:
            page = whole((DOCS / name).read_text(encoding="utf-8"))
            (Path(app.outdir) / name).write_text(page, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("build-finished", write)
    return {"parallel_read_safe": True}
