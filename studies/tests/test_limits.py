"""The limits that the pages quote are those of one file, and the file is measured; `docs/fly` writes the sentence."""

import pytest

from studies.limits import pieces
from tests.calls import run_study
from tests.docs.commands import ROOT

TABLE = ROOT / "docs" / "tables" / "limits.csv"


def test_the_guide_has_the_table():
    assert pieces(TABLE)[1] in (ROOT / "docs" / "cases.md").read_text(encoding="utf-8")


@pytest.mark.nightly
@pytest.mark.mesher
def test_the_limits_are_those_of_the_guide_s_mesh(tmp_path):
    assert run_study("limits", "--out", tmp_path / "limits", "--quiet") == 0
    assert (tmp_path / "limits" / "limits.csv").read_text() == TABLE.read_text()
