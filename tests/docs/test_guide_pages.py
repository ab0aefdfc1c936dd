"""What the guide's own Sphinx extensions make of formulas, docstrings and signatures."""

import pytest
from accessible import reachable, with_levels
from docstrings import escaped, is_elsewhere, process, rewritten
from docutils.utils import new_document
from mathml import rendered
from matplotlib.figure import Figure
from signatures import rename, shorten
from sphinx import addnodes
from sphinx.util.inspect import signature, stringify_signature

import sdm_deflect
from sdm_deflect.deform.hexahedron import box
from sdm_deflect.meshing.formats.adapters import Accepted


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


def test_what_scrolls_is_reached_by_keys_and_lists_are_lists():
    assert reachable("<pre>a</pre>") == '<pre tabindex="0">a</pre>'
    assert 'tabindex="0"' in reachable('<div class="table-wrapper docutils container">')
    row = '<dd><em class="sig-param"><span>path</span></em>,</dd>\n'
    assert reachable(f"<dl>\n{row}{row}</dl>").count("<div>") == 2
    other = "<dl>\n<dt>a</dt><dd>b</dd>\n</dl>"
    assert reachable(other) == other
    assert 'aria-level="2"' in with_levels('<p class="caption" role="heading">')


def test_text_after_the_colon_is_a_description():
    heading = ["Attributes", "----------"]
    lines = [*heading, "nodes : (K,) indices,", "    ascending.", "faces : tuple of int", "    Indices."]
    assert rewritten(lines)[2:] == [
        "nodes", "    (K,) indices,", "    ascending.", "faces", "    tuple of int.", "    Indices.",
    ]  # fmt: skip


def test_arguments_by_any_name_are_described():
    lines = ["Parameters", "----------", "progress, **options : As elsewhere."]
    assert rewritten(lines)[2:] == ["progress, **options", "    As elsewhere."]


def test_text_outside_sections_is_kept():
    lines = ["A sum : no entry.", "", "Notes", "-----", "length : no entry either."]
    assert rewritten(lines) == lines


def test_formulas_in_docstrings_hold_no_markup():
    assert escaped("    |a| is r**2, `b|c`") == r"    \|a\| is r\*\*2, `b|c`"
    assert escaped("* a bullet") == "* a bullet"
    assert escaped("``*`` for any, ``x_`` and a*b") == r"``*`` for any, ``x_`` and a\*b"


def test_words_before_a_colon_are_no_type_of_an_attribute():
    lines = ["What was decided: the box.", ""]
    process(None, "property", "plan", None, None, lines)
    assert lines[0] == ": What was decided: the box."


def test_members_are_described_once():
    """Public names have a page of their own; of fields of a named tuple Python says nothing."""
    assert is_elsewhere(None, "module", "deflect", sdm_deflect.deflect, False, None)
    assert is_elsewhere(None, "class", "mesh", Accepted.mesh, False, None)
    assert is_elsewhere(None, "class", "set", Figure.set, False, None)
    assert is_elsewhere(None, "module", "box", box, False, None) is None


def test_array_types_have_their_short_names():
    long = "ndarray[tuple[Any, ...], dtype[float64]]"
    assert shorten(f"(a: {long}, b: int) -> tuple[{long}, str]") == "(a: FloatArray, b: int) -> tuple[FloatArray, str]"
    assert shorten(None) is None


def test_signatures_are_python():
    """Else Sphinx shows them as they are, with the marks of its own."""
    assert shorten("(a: ~b.C = <factory>, d: E = <F object at 0x7f00>)") == "(a: ~b.C = ..., d: E = ...)"
    hinge = stringify_signature(signature(sdm_deflect.deflect), unqualified_typehints=True)
    assert "hinge: ArrayLike | None = None" in shorten(hinge)


def test_types_of_properties_have_their_short_names():
    document = new_document("page")
    document += addnodes.desc_annotation("", ": ndarray[tuple[Any, ...], dtype[float64]]")
    rename(None, document)
    assert document.astext() == ": FloatArray"
