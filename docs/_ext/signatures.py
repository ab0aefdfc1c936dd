"""Array types in signatures under the short names that the source gives them, and defaults that are Python."""

import re
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

ARRAYS = {"float64": "FloatArray", "int64": "IndexArray", "intp": "IndexArray", "bool": "BoolArray"}
SHAPE, PREFIX = r"~?(?:tuple\[[^\]]*\]|(?:typing\.)?Any)", r"~?(?:numpy\.)?"
NDARRAY = re.compile(rf"{PREFIX}ndarray\[{SHAPE}, {PREFIX}dtype\[{PREFIX}(\w+)\]\]")
OBJECT = re.compile(r"<(?:function|class) '?([\w.]+)'?[^>]*>")
ARRAY_LIKE = re.compile(r"[~\w.]*_Buffer \| .*?_NestedSequence\[~?complex \| bytes \| str\]")
MADE = re.compile(r"<factory>|<[\w.]+ object at \w+>")


def shorten(text: str | None) -> str | None:
    """Replace NumPy's long array types by the aliases of the source, functions by their names, objects by dots."""
    if text is None:
        return None
    named = NDARRAY.sub(lambda found: ARRAYS.get(found[1].rstrip("_"), "ndarray"), ARRAY_LIKE.sub("ArrayLike", text))
    return MADE.sub("...", OBJECT.sub(r"\1", named))


def process(app: Sphinx, what: str, name: str, thing: Any, options: Any, signature: str, returned: str) -> Any:
    """Shorten a signature and what it returns."""
    return shorten(signature), shorten(returned)


def rename(app: Sphinx, doctree: nodes.document) -> None:
    """Shorten the types of attributes, which are no part of a signature."""
    for node in doctree.findall(addnodes.desc_annotation):
        text = node.astext()
        if shorten(text) != text:
            node.children = [nodes.Text(shorten(text) or "")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to autodoc."""
    app.connect("autodoc-process-signature", process)
    app.connect("doctree-read", rename)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
