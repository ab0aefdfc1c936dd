"""The limits that the pages quote are those of one file, and the file is measured."""

import pytest

from studies.limits import pieces
from tests.calls import run_study
from tests.docs.commands import ROOT

TABLE = ROOT / "docs" / "tables" / "limits.csv"
PAGES = ("README.md", "docs/cases.md", "docs/teaching.md", "docs/slides.html")


@pytest.mark.parametrize("page", PAGES)
def test_every_page_has_the_same_sentence(page):
    sentence, _ = pieces(TABLE)
    assert sentence in " ".join((ROOT / page).read_text(encoding="utf-8").split())


def test_the_guide_has_the_table():
    assert pieces(TABLE)[1] in (ROOT / "docs" / "cases.md").read_text(encoding="utf-8")


@pytest.mark.nightly
@pytest.mark.mesher
def test_the_limits_are_those_of_the_guide_s_mesh(tmp_path):
    assert run_study("limits", "--out", tmp_path / "limits", "--quiet") == 0
    assert (tmp_path / "limits" / "limits.csv").read_text() == TABLE.read_text()
