"""What the guide's own Sphinx extensions make of formulas, docstrings and signatures."""

from accessible import reachable, with_levels
from docstrings import escaped, is_elsewhere, rewritten
from matplotlib.figure import Figure
from signatures import shorten
from sphinx.util.inspect import signature, stringify_signature

import sdm_deflect
from sdm_deflect.deform.box.hexahedron import box
from sdm_deflect.meshing.formats.adapters import Accepted


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


def test_formulas_in_docstrings_hold_no_markup():
    assert escaped("    |a| is r**2, `b|c`") == r"    \|a\| is r\*\*2, `b|c`"
    assert escaped("* a bullet") == "* a bullet"
    assert escaped("``*`` for any, ``x_`` and a*b") == r"``*`` for any, ``x_`` and a\*b"


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
