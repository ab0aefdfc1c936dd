"""Tables of the guide that repeat facts of the code."""

from sdm_deflect.cases.aircraft.guide_meshes import GUIDE, mesh_name
from sdm_deflect.cases.aircraft.registry import CASES
from sdm_deflect.deform.checks import FEW, GROWTH, LAYER_CHANGE, MOST_CHANGE, MOST_TILT
from sdm_deflect.meshing.formats.registration import REGISTERED
from tests.docs.commands import ROOT

DOCS = ROOT / "docs"


def test_the_table_of_formats_has_every_suffix():
    rows = (DOCS / "formats.md").read_text(encoding="utf-8")
    assert [s for entry in REGISTERED.values() for s in entry.suffixes if f"{s}`" not in rows] == []


def test_the_table_of_checks_has_the_limits_of_layers():
    text = (DOCS / "quality.md").read_text(encoding="utf-8")
    row = next(line for line in text.splitlines() if "`layer_height`" in line)
    for share in (LAYER_CHANGE, MOST_CHANGE, GROWTH, FEW):
        assert f" {100.0 * share:g} %" in row
    assert f"{MOST_TILT:g} degrees" in row


def test_the_table_of_meshes_is_that_of_the_package():
    text = (DOCS / "cases.md").read_text(encoding="utf-8")
    for (name, scale), one in GUIDE.items():
        own = ", ".join(sorted((f"`{case}`" for case in CASES if mesh_name(CASES[case]) == name), key=text.index))
        assert f"| {own} | `{scale}` | {one.nodes:,} | {one.cells:,} | `{one.hash}` |" in text
