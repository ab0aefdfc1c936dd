"""The list of licences names what pip installs."""

import re

import licences
import pytest
from packaging.requirements import Requirement

from tests.docs.commands import ROOT

ROWS = re.findall(
    r"^\| ([\w.-]+) \| (.+?) \| (yes)? ?\|$", (ROOT / "docs" / "licences.md").read_text("utf-8"), re.MULTILINE
)
LISTED = {name: licence for name, licence, _ in ROWS}


def test_every_package_that_is_asked_for_is_listed():
    assert {name for name, _, own in ROWS if own} == set(licences.direct())


def test_none_is_without_a_licence():
    assert [name for name, licence in LISTED.items() if licence in ("not stated", "UNKNOWN")] == []


def test_what_is_installed_under_the_gpl_is_listed():
    """Others may come and go with versions of what is asked for."""
    found = {name: licences.licence_of(one) for name, one in licences.all_of(licences.direct()).items()}
    assert len(found) > len(licences.direct())
    copyleft = {name for name, text in found.items() if "GPL" in text or "General Public" in text}
    assert copyleft == {name for name, text in LISTED.items() if "GPL" in text or "General Public" in text}


def test_the_table_alone_is_made_anew(tmp_path):
    page = tmp_path / "licences.md"
    page.write_text(f"before\n{licences.BEGIN}\nold\n{licences.END}\nafter\n", encoding="utf-8")
    licences.main(page)
    text = page.read_text(encoding="utf-8")
    assert text == f"before\n{licences.table()}\nafter\n"
    assert "| numpy | BSD-3-Clause" in text


@pytest.mark.parametrize("text", ["ruamel.yaml>=0.18", "Ruamel_YAML", "ruamel-yaml[x]<1"])
def test_names_are_spelled_as_the_index_does(text):
    assert Requirement(text)
    assert licences.named(text) == "ruamel-yaml"


def test_only_the_mesher_of_the_aircraft_imports_gmsh():
    folders = ("cases", "deform", "geometry", "meshing", "sdm_deflect")
    importers = [path for name in folders for path in (ROOT / name).rglob("*.py")
                 if re.search(r"^\s*(import|from) gmsh", path.read_text(encoding="utf-8"), re.MULTILINE)]  # fmt: skip
    assert [path.name for path in importers] == ["gmsh_worker.py"]
