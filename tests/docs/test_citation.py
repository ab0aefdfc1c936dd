"""CITATION.cff says what the package says, in the form that others read (schema 1.2.0 of citation-file-format)."""

import json
import re
import tomllib

import pytest
import yaml

from tests.docs.commands import ROOT


@pytest.fixture
def citation():
    """The file; dates as text, as the schema has them."""
    return yaml.load((ROOT / "CITATION.cff").read_text(encoding="utf-8"), Loader=yaml.BaseLoader)


def test_it_is_valid(citation):
    from jsonschema import Draft7Validator  # takes seconds to load

    schema = json.loads((ROOT / "tests" / "docs" / "citation.schema.json").read_text(encoding="utf-8"))
    assert [error.message for error in Draft7Validator(schema).iter_errors(citation)] == []


def test_version_and_licence_are_those_of_the_package(citation):
    package = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert (citation["title"], citation["version"], citation["license"]) == tuple(
        package[key] for key in ("name", "version", "license")
    )


def test_version_and_date_are_those_of_the_newest_entry_of_the_changelog(citation):
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## (\[\d.*)$", text, re.MULTILINE)
    assert newest[1] == f"[{citation['version']}] - {citation['date-released']}"
