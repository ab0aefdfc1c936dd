"""The comparison with other tools has a source for each cell."""

import re

import pytest

from tests.docs.commands import ROOT

TEXT = (ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")
NOTE = re.compile(r"\[\^([\w-]+)\](?!:)")
DEFINED = re.findall(r"^\[\^([\w-]+)\]: (.*)$", TEXT, re.MULTILINE)
ROWS = [line.strip("| ").split(" | ") for line in TEXT.splitlines() if line.startswith("| ") and "---" not in line]
BODY = [row for row in ROWS if row[0] != "sdm-deflect"]


def test_every_tool_has_a_cell_in_every_row():
    assert len(BODY) >= 10
    assert {len(row) for row in BODY} == {7}


@pytest.mark.parametrize("row", BODY, ids=lambda row: row[0])
def test_a_cell_has_a_source_or_says_that_none_was_found(row):
    assert [cell for cell in row[1:] if not NOTE.search(cell) and cell != "not stated"] == []


def test_every_source_is_named_once_and_used():
    names = [name for name, _ in DEFINED]
    assert len(names) == len(set(names))
    assert set(names) == set(NOTE.findall(TEXT))


def test_sources_of_others_can_be_looked_up():
    own = ("formats", "own-mesh", "theory", "paper", "cluster", "licence", "peers-motion")
    assert [name for name, text in DEFINED if name not in own and "](http" not in text] == []
