"""The slides of the guide as one file: pictures are put into `slides.html` when the guide is built."""

import base64
import re
from pathlib import Path

from sphinx.application import Sphinx

SOURCE = Path(__file__).parents[1] / "slides.html"
PICTURE = re.compile(r'src="(figures/[\w.]+\.png)"')


def whole(page: str) -> str:
    """Return a page with its pictures in it."""

    def inside(found: re.Match[str]) -> str:
        data = base64.b64encode((SOURCE.parent / found[1]).read_bytes()).decode()
        return f'src="data:image/png;base64,{data}"'

    return PICTURE.sub(inside, page)


def write(app: Sphinx, error: Exception | None) -> None:
    """Write the slides beside the pages."""
    if error is None and app.builder.format == "html":
        page = whole(SOURCE.read_text(encoding="utf-8"))
        (Path(app.outdir) / SOURCE.name).write_text(page, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("build-finished", write)
    return {"parallel_read_safe": True}
