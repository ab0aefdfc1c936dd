"""Formulas as MathML: browsers draw it themselves, with the font in `_static` and without a script."""

import re
from html import escape, unescape
from typing import Any
from unicodedata import lookup, name

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

STYLED = re.compile(r'<(m[in]) mathvariant="(bold|script|double-struck)">(&#x\w+;|\w)</')
SPECIAL = {"DOUBLE-STRUCK R": "\u211d"}


def rendered(formula: str, display: str) -> str:
    """Return the MathML of a formula, with styled letters as characters of their own: browsers know no others."""

    def letter(found: re.Match[str]) -> str:
        plain, style = unescape(found[3]), found[2].upper()
        if f"{style} {plain}" in SPECIAL:
            return f"<{found[1]}>{SPECIAL[f'{style} {plain}']}</"
        described = re.sub("^(LATIN|GREEK) (CAPITAL|SMALL) LETTER ", r"\2 ", name(plain)).removeprefix("LATIN ")
        return f"<{found[1]}>{lookup(f'MATHEMATICAL {style} {described}')}</"

    return STYLED.sub(letter, convert(formula, display=display))


def inline(translator: Any, node: nodes.math) -> None:
    """Write a formula within a line."""
    translator.body.append(rendered(node.astext(), "inline"))
    raise nodes.SkipNode


def display(translator: Any, node: nodes.math_block) -> None:
    """Write a formula of its own, with its number at the right if it has one."""
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    translator.body.append(f'<div class="formula" tabindex="0">{rendered(node.astext(), "block")}</div>')
    if node["number"]:
        translator.body.append(f'<span class="eqno">({escape(str(node["number"]))})</span>')
    translator.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer under the name `mathml`."""
    app.add_html_math_renderer("mathml", inline_renderers=(inline, None), block_renderers=(display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
