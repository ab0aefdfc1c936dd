"""The guide's table of a blended and a rigid flap is what the program measures today."""

import csv
import re

import numpy as np
import pytest

from studies.flap import forces, measured, on_flap, turned, wall
from tests.docs.commands import ROOT


@pytest.mark.filterwarnings("ignore:.*turns by")
def test_table_and_page_are_of_this_version():
    with (ROOT / "docs" / "tables" / "flap.csv").open(encoding="utf-8") as file:
        stored = [[float(cell) for cell in row] for row in list(csv.reader(file))[1:]]
    ratios = np.array([one.ratios for one in measured()])
    np.testing.assert_allclose(ratios, np.array(stored)[:, -3:], rtol=1e-9)
    page = (ROOT / "docs" / "flow.md").read_text(encoding="utf-8")
    shown = re.findall(r"^\| \d+° \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$", page, re.MULTILINE)
    np.testing.assert_allclose(np.array(shown, dtype=float), ratios, atol=5.1e-4)


def test_a_thin_aerofoil_without_deflection_has_no_lift_and_a_turned_flap_has():
    corners = wall()
    none, down = (forces(own, on_flap(corners)) for own in (corners, turned(corners, 5.0)))
    assert abs(none.lift) < 1e-9
    assert down.lift == pytest.approx(5.0 * 0.0739, rel=0.01)
