"""PLOT3D grids that are truncated, damaged or ambiguous: one sentence, soon."""

import pytest

from sdm_deflect.meshing.formats.plot3d import Plot3d
from tests.meshing.formats.plot3d_files import VARIANTS, box, written
from tests.meshing.formats.test_hostile import complaint


@pytest.mark.parametrize("variant", VARIANTS)
def test_truncated_files(variant, tmp_path):
    path = written(tmp_path / "a.p3d", [box()], variant)
    data = path.read_bytes().rstrip()
    for length in (0, 1, 4, 12, 20, 200, len(data) // 2, len(data) - 4 - 8 * (variant == "text")):
        path.write_bytes(data[:length].rpartition(b" ")[0] if variant.startswith("text") else data[:length])
        assert "fits no sizes of blocks that its first numbers tell" in complaint(Plot3d(), path), length
    path.write_bytes(data + b" 1.0 " * 3)
    assert "fits no sizes of blocks" in complaint(Plot3d(), path)


@pytest.mark.parametrize("at", [0, 8, 12, 28, 32, -4])
def test_markers_of_records(at, tmp_path):
    path = written(tmp_path / "a.p3d", [box()], "<f8r")
    data = bytearray(path.read_bytes())
    data[at % len(data)] ^= 64
    path.write_bytes(bytes(data))
    assert "fits no sizes of blocks" in complaint(Plot3d(), path)


def test_what_could_be_two_things_is_refused(tmp_path):
    """One block of 2 x 2 x 4 points, or two plane ones of 2 x 4 and 3 x 5: 51 numbers either way."""
    (tmp_path / "a.xyz").write_text(" ".join(["2", "2", "4", "3", "5", *["0.5"] * 46]))
    assert "it could be stored in several ways" in complaint(Plot3d(), tmp_path / "a.xyz")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"2 2 2 3*0.5 " + b"1 " * 21, "numbers are repeated by counts such as 3*0.5"),
        (b"2 2 2 wing " + b"1 " * 23, "'wing' is not a number"),
        (b"1\n3 1 2\n" + b"1.5 " * 18, "block 1 of 3 x 1 x 2 points has no cells"),
        (b"1\n2 2 1\n" + b"1.5 " * 8 + b"1 2 3 4", "all points must have one z, but they lie between 1 and 4"),
        (b"2 2 2 " + b"nan " + b"1 " * 23, "1 points are not finite"),
        (b"", "fits no sizes"), (b"\0" * 4000, "fits no sizes"),
    ],
)  # fmt: skip
def test_other_contents(content, said, tmp_path):
    (tmp_path / "a.p3d").write_bytes(content)
    assert said in complaint(Plot3d(), tmp_path / "a.p3d")
