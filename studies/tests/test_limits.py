"""The limits that the pages quote are those of one file, and the file is measured; `docs/fly` writes the sentence."""

import csv

import pytest

from studies.limits import LEAST, RESOLUTION, pieces
from tests.calls import run_study
from tests.docs.commands import ROOT

TABLE = ROOT / "docs" / "tables" / "limits.csv"


def test_the_guide_has_the_table():
    assert pieces(TABLE)[1] in (ROOT / "docs" / "cases.md").read_text(encoding="utf-8")


@pytest.mark.nightly
@pytest.mark.mesher
def test_the_limits_are_those_of_the_guide_s_mesh(tmp_path):
    """To a step of the search with repair, which takes other ways on other processors."""
    assert run_study("limits", "--out", tmp_path / "limits", "--quiet") == 0
    files = tmp_path / "limits" / "limits.csv", TABLE
    found, kept = (list(csv.DictReader(path.read_text().splitlines())) for path in files)
    assert [row for row in found if row["repair"] == "off"] == [row for row in kept if row["repair"] == "off"]
    for row, other in zip(found, kept, strict=True):
        assert (row["case"], row["repair"]) == (other["case"], other["repair"])
        assert abs(float(row["angle_deg"]) - float(other["angle_deg"])) <= RESOLUTION
        assert float(row["quality"]) >= LEAST
