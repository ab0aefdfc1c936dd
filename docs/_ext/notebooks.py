"""Tutorials as notebooks: each page that is one can be downloaded, and a gallery shows a picture that it made itself.

The page is executed while the guide is built. Beside `NAME.html` appear `NAME.ipynb`, without outputs and in the
Markdown that every notebook program reads, and `NAME.png`, the picture of the cell with the tag `gallery`.
`python docs/_ext/notebooks.py` writes the notebooks beside their sources, for use without the guide.
"""

import base64
import re
from io import BytesIO
from pathlib import Path
from typing import Any

import nbformat
from docutils import nodes
from docutils.parsers.rst import Directive
from myst_nb.core.read import is_myst_markdown_notebook, read_myst_markdown_notebook
from PIL import Image
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

LINK = re.compile(r"\[([^\]]+)\]\((?!https?:)[^)]+\)")
SMALL = (560, 560)  # pixels, twice as many as a card is wide
HIDDEN = {"hide-cell", "hide-input"}


def is_notebook(page: Path) -> bool:
    """Return whether a page of the guide has cells to execute."""
    return page.suffix == ".md" and is_myst_markdown_notebook(page.read_text(encoding="utf-8"))


def notebook_of(page: Path) -> nbformat.NotebookNode:
    """Return the notebook of a page, with italics for links to other pages, and no word that only Sphinx knows."""
    notebook = read_myst_markdown_notebook(page.read_text(encoding="utf-8"))
    kernel = notebook.metadata["kernelspec"]
    notebook.metadata = nbformat.from_dict({"kernelspec": kernel, "language_info": {"name": "python"}})
    for i, cell in enumerate(notebook.cells):
        cell.id = f"{page.stem}-{i}"[:64]
        hidden = HIDDEN & set(cell.metadata.get("tags", ()))
        cell.metadata = nbformat.from_dict({"jupyter": {"source_hidden": True}} if hidden else {})
        if cell.cell_type == "markdown":
            cell.source = LINK.sub(r"*\1*", cell.source)
    return notebook


def picture_of(executed: nbformat.NotebookNode) -> bytes:
    """Return the picture of the cell with the tag `gallery`, as a small PNG; StopIteration if there is none."""
    cells = (cell for cell in executed.cells if "gallery" in cell.metadata.get("tags", ()))
    found = (out.data["image/png"] for cell in cells for out in cell.outputs if "image/png" in out.get("data", {}))
    with Image.open(BytesIO(base64.b64decode(next(found)))) as picture, BytesIO() as small:
        picture.thumbnail(SMALL)
        picture.save(small, "PNG", optimize=True)
        return small.getvalue()


class Tutorial(Directive):
    """A card of the gallery: `{tutorial} NAME`, and below what one learns on that page."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the picture, the page's title as a link, what was written below, and the link to the notebook."""
        name, card = self.arguments[0], nodes.container(classes=["tutorial"])
        picture = f'<a href="{name}.html" tabindex="-1" aria-hidden="true"><img src="{name}.png" alt=""></a>'
        title = pending_xref("", nodes.inline(classes=["std", "std-doc"]), refdomain="std", reftype="doc")
        env = self.state.document.settings.env
        title.update_all_atts({"reftarget": name, "refdoc": env.docname, "refexplicit": False, "refwarn": True})
        card += [nodes.raw("", picture, format="html"), nodes.paragraph("", "", title)]
        self.state.nested_parse(self.content, self.content_offset, card)
        card += nodes.paragraph("", "", link(name))
        return [card]


def link(name: str) -> nodes.raw:
    """Return the link to the notebook of a page beside this one."""
    return nodes.raw("", f'<a class="notebook" href="{name}.ipynb" download>Download the notebook</a>', format="html")


def offer(app: Sphinx, doctree: nodes.document) -> None:
    """Put the link to the notebook below the title of a page that is one."""
    page = Path(app.env.doc2path(app.env.docname))
    if is_notebook(page):
        title = next(iter(doctree.findall(nodes.title)))
        title.parent.insert(title.parent.index(title) + 1, nodes.paragraph("", "", link(page.stem)))


def write(app: Sphinx, exception: Exception | None) -> None:
    """Write notebooks beside the pages, and their pictures unless nothing was executed."""
    if exception or app.builder.format != "html":
        return
    for docname in sorted(app.env.found_docs):
        page = Path(app.env.doc2path(docname))
        if is_notebook(page):
            out, executed = app.outdir / docname, app.outdir.parent / "jupyter_execute" / f"{docname}.ipynb"
            nbformat.write(notebook_of(page), out.with_suffix(".ipynb"))
            if app.config.nb_execution_mode == "off":
                continue
            try:
                out.with_suffix(".png").write_bytes(picture_of(nbformat.read(executed, as_version=4)))
            except StopIteration:
                raise ExtensionError(f"{page}: no cell with the tag `gallery` shows a picture") from None


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive, and what is done with each page and at the end."""
    app.add_directive("tutorial", Tutorial)
    app.connect("doctree-read", offer)
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    for source in filter(is_notebook, (Path(__file__).parents[1] / "tutorials").glob("*.md")):
        nbformat.write(notebook_of(source), source.with_suffix(".ipynb"))
