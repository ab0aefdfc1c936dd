"""What is wrong with an SU2 file is said in one sentence that names the file."""

import numpy as np
import pytest

from sdm_deflect.meshing.formats.su2 import Su2
from tests.meshing.formats.examples import hybrid
from tests.meshing.formats.test_every_format import refused


@pytest.fixture
def text(tmp_path):
    Su2().write(hybrid(), tmp_path / "good.su2")
    return (tmp_path / "good.su2").read_text()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("NDIME= 3", "NDIME= 2", "elements of type"),
        ("NDIME= 3", "NDIME= 4", "NDIME= 4; it must be 2 or 3"),
        ("NDIME= 3", "", "no NDIME="),
        ("NPOIN= 14", "NPOIN= 15", "NPOIN= 15, but 14 lines of numbers follow; the file is truncated or damaged"),
        ("NPOIN= 14", "NPOIN= 13", "NPOIN= 13, but 14 lines"),
        ("NPOIN= 14", "NPOIN= many", "NPOIN= many is not a count"),
        ("NMARK= 6", "NMARK= 7", "NMARK= 7, but there are 6 markers"),
        ("MARKER_ELEMS= 5", "", "marker roof has no MARKER_ELEMS="),
        ("MARKER_ELEMS= 5", "MARKER_ELEMS= 6", "marker roof: MARKER_ELEMS= 6, but 5 lines"),
        ("MARKER_TAG= roof", "MARKER_TAG= floor", "given twice: floor"),
        ("9 4 5 13 12", "9 4 5 13 14", "marker roof: 1 quad elements name points that are not among the 14"),
        ("9 4 5 13 12", "9 4 5 13 11", "1 of 5 faces of patch roof are of no cell"),
        ("9 4 5 13 12", "3 4 5", "marker roof: 1 elements of type 3 where there can be 5 (triangle), 9 (quad)"),
        ("9 4 5 13 12", "9 4 5 13", "marker roof: lines of quad elements have fewer than 4 nodes"),
        ("14 1 2 6 5 8 1", "15 1 2 6 5 8 1", "1 elements of type 15 where there can be 10 (tetra)"),
        ("14 1 2 6 5 8 1", "14 1 2 6 5.0 8 1", "'5.0' is not a number"),
        ("-0.031157651599626007", "nan", "1 points are not finite, the first is point 12"),
        ("NMARK= 6", "", "0 lines NMARK="),
        (" 0.028566421160436638 0", "", "lines of points have fewer than 3 coordinates; the file is truncated"),
    ],
)
def test_damage_is_named(old, new, message, text, tmp_path):
    assert old in text
    path = tmp_path / "bad.su2"
    path.write_text(text.replace(old, new, 1))
    assert message in refused(path)


def test_a_last_line_without_its_end_is_whole(text, tmp_path):
    path = tmp_path / "cut.su2"
    path.write_text(text.rstrip())
    np.testing.assert_array_equal(Su2().read(path).on("roof"), Su2().read(tmp_path / "good.su2").on("roof"))


def test_missing_zones_are_a_truncated_file(tmp_path):
    Su2().write(hybrid(2), tmp_path / "mesh.su2")
    text = (tmp_path / "mesh.su2").read_text()
    (tmp_path / "mesh.su2").write_text(text[: text.index("IZONE= 2")])
    assert "NZONE= 2, but there are 1 zones" in refused(tmp_path / "mesh.su2")
