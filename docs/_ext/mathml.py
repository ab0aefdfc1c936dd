r"""Formulas as MathML: browsers draw it themselves, with the font in `_static` and without a script.

A formula of its own is broken on a narrow screen where it has `\qquad` or `\allowbreak` outside of braces.
"""

import re
from html import escape, unescape
from typing import Any
from unicodedata import lookup, name

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

STYLED = re.compile(r'<(m[in]) mathvariant="(bold|script|double-struck)">(&#x\w+;|\w)</')
BREAK = re.compile(r"\\(qquad|allowbreak)(?![a-z])")
# What stands between two parts on one line: a wide space, or none.
BETWEEN = {"qquad": " &#8195;&#8195;", "allowbreak": " "}
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


def block(formula: str) -> str:
    """Return the MathML of a formula of its own: an element for each part that may stand on a line by itself."""
    first, *others = BREAK.split(formula)
    parts = [first, *others[1::2]]
    if any(part.count("{") != part.count("}") or part.count(r"\begin") != part.count(r"\end") for part in parts):
        parts, others = [formula], []
    maths = [
        rendered(part, "block").replace('display="block"', 'display="inline" displaystyle="true"') for part in parts
    ]
    return "".join([maths[0], *(BETWEEN[mark] + math for mark, math in zip(others[::2], maths[1:], strict=True))])


def inline(translator: Any, node: nodes.math) -> None:
    """Write a formula within a line."""
    translator.body.append(rendered(node.astext(), "inline"))
    raise nodes.SkipNode


def display(translator: Any, node: nodes.math_block) -> None:
    """Write a formula of its own, with its number at the right if it has one."""
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    translator.body.append(f'<div class="formula" tabindex="0">{block(node.astext())}</div>')
    if node["number"]:
        translator.body.append(f'<span class="eqno">({escape(str(node["number"]))})</span>')
    translator.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer under the name `mathml`."""
    app.add_html_math_renderer("mathml", inline_renderers=(inline, None), block_renderers=(display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
