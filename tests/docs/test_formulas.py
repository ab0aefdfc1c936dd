"""Every formula of the guide becomes MathML without a command that stays as text."""

import re

from docs._ext.mathml import block, rendered
from tests.docs.commands import pages

FORMULA = re.compile(r"\$\$(.+?)\$\$|(?<![\\$\w])\$([^$\n]+)\$(?![\w$])", re.DOTALL)


def formulas():
    for page in pages():
        text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for found in FORMULA.finditer(text):
            yield page.name, found[1] or found[2], "block" if found[1] else "inline"


def test_no_formula_has_a_backslash_left():
    every = list(formulas())
    assert len(every) > 50
    left = [
        (page, formula)
        for page, formula, display in every
        if "\\" in (block(formula) if display == "block" else rendered(formula, display))
    ]
    assert left == []


def test_a_command_that_is_not_known_stays_as_text():
    assert "\\" in rendered(r"\arg\max_i x", "block")


def test_a_formula_is_broken_where_it_may_be_but_not_within_brackets():
    assert block(r"a = b , \qquad c = d \allowbreak + e").count("<math") == 3
    assert block(r"\sqrt{a \qquad b}").count("<math") == 1
    assert block(r"\begin{bmatrix} a \qquad b \end{bmatrix}").count("<math") == 1
    assert "munder" in block(r"\sum_i x_i")
