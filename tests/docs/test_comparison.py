"""The comparison with other tools has a source for each cell."""

import re

import pytest

from tests.docs.commands import ROOT

TEXT = (ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")
NOTE = re.compile(r"\[\^([\w-]+)\](?!:)")
DEFINED = re.findall(r"^\[\^([\w-]+)\]: (.*)$", TEXT, re.MULTILINE)
TOOLS = ["sdm-deflect", "SU2", "IDWarp", "PyGeM", "OpenFOAM", "RBF Morph"]
TABLES = [
    [line.strip("| ").split(" | ") for line in block.splitlines()]
    for block in re.findall(r"^\| --- .*\n((?:\| .*\n)+)", TEXT, re.MULTILINE)
]
BODY = [row for table in TABLES for row in table]


def test_every_tool_has_a_cell_in_every_column():
    assert len(TABLES) >= 4
    for table in TABLES:
        assert [row[0] for row in table] == TOOLS
        assert len({len(row) for row in table}) == 1


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
