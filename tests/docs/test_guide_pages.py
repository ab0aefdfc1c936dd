"""What the guide's own Sphinx extensions make of formulas, docstrings and signatures."""

import re

import pytest
from docstrings import escaped, rewritten
from mathml import rendered
from signatures import shorten

from tests.docs.commands import ROOT

PICTURE = re.compile(r"!\[([^\]]*)\]\((figures/[^)]+)\)")


@pytest.mark.parametrize(
    ("formula", "letter"),
    [(r"\mathbf A", "𝐀"), (r"\mathbf{Q}", "&#x1D410;"), (r"\mathbf \Phi", "𝚽"), (r"\mathcal O", "𝒪"),
     (r"\mathbb R", "ℝ")],
)  # fmt: skip
def test_styled_letters_are_characters_of_their_own(formula, letter):
    made = rendered(formula, "inline")
    assert letter in made
    assert "mathvariant" not in made


def test_display_formulas_are_blocks():
    assert 'display="block"' in rendered("x^2", "block")


def test_text_after_the_colon_is_a_description():
    heading = ["Attributes", "----------"]
    lines = [*heading, "nodes : (K,) indices,", "    ascending.", "faces : tuple of int", "    Indices."]
    assert rewritten(lines)[2:] == [
        "nodes", "    (K,) indices,", "    ascending.", "faces", "    tuple of int.", "    Indices.",
    ]  # fmt: skip


def test_text_outside_sections_is_kept():
    lines = ["A sum : no entry.", "", "Notes", "-----", "length : no entry either."]
    assert rewritten(lines) == lines


def test_formulas_in_docstrings_hold_no_markup():
    assert escaped("    |a| is r**2, `b|c`") == r"    \|a\| is r\*\*2, `b|c`"
    assert escaped("* a bullet") == "* a bullet"


def test_array_types_have_their_short_names():
    long = "ndarray[tuple[Any, ...], dtype[float64]]"
    assert shorten(f"(a: {long}, b: int) -> tuple[{long}, str]") == "(a: FloatArray, b: int) -> tuple[FloatArray, str]"
    assert shorten(None) is None


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_pictures_are_small_and_have_a_text_alternative(page):
    for text, path in PICTURE.findall(page.read_text(encoding="utf-8")):
        assert len(text) > 20
        assert (page.parent / path).stat().st_size < 300_000
