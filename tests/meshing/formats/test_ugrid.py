"""UGRID in every encoding: meshio reads what we write, only coordinates change, names come from .mapbc."""

import re
import struct
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.cases.report.folder import folder_of
from sdm_deflect.cases.run.mesh_files import OutputFiles
from sdm_deflect.meshing.formats.registry import read
from sdm_deflect.meshing.formats.shapes import mirror_nodes
from sdm_deflect.meshing.formats.ugrid import Ugrid
from sdm_deflect.meshing.formats.ugrid_file import ENCODINGS, UgridFile, encode
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from tests.deform.blocks import block_with_body
from tests.extras import Library
from tests.meshing.formats.examples import grid, hybrid
from tests.meshing.formats.test_hostile import complaint

meshio = Library("meshio")

SUFFIXES = [".ugrid", *(f".{encoding}.ugrid" for encoding in ENCODINGS)]
BINARY = SUFFIXES[1:]
# Of all encodings, for what does not follow from their tables.
TWO = [".ugrid", ".lr4.ugrid"]
# A pyramid in .b8.ugrid, by hand: the apex is its third node, the base 1 4 5 2, which is the surface 8.
PYRAMID = struct.pack(
    ">7i15d12i4i5i5i",
    *(5, 4, 1, 0, 1, 0, 0),
    *(0, 0, 0, 0, 1, 0, 0.5, 0.5, 1, 1, 0, 0, 1, 1, 0),
    *(1, 4, 3, 4, 5, 3, 5, 2, 3, 2, 1, 3),
    *(1, 2, 5, 4),
    *(7, 7, 7, 9, 8),
    *(1, 2, 3, 4, 5),
)


def test_a_new_file_has_names_beside_it_and_says_which_changed(tmp_path):
    lost = Ugrid().write(hybrid(), tmp_path / "wing.v2.b8.ugrid")
    assert [text for text in lost if text.startswith("patch")] == [
        "patch left wall is called left_wall", "patch right wall is called right_wall",
    ]  # fmt: skip
    assert sorted(p.name for p in tmp_path.iterdir()) == ["wing.v2.b8.ugrid", "wing.v2.mapbc"]


@pytest.mark.parametrize("suffix", TWO)
def test_meshio_reads_the_same_cells(suffix, tmp_path):
    path = tmp_path / f"mesh{suffix}"
    Ugrid().write(hybrid(), path)
    found = meshio.read(path)
    np.testing.assert_allclose(found.points, hybrid().points, rtol=1e-6)
    cells = {block.type: block.data for block in found.cells if block.type not in ("triangle", "quad")}
    for block in hybrid().cells:
        wanted = mirror_nodes("wedge", block.nodes) if block.shape == "wedge" else block.nodes  # meshio leaves prisms
        np.testing.assert_array_equal(cells[block.shape], wanted)
    assert {label for own in found.cell_data["ugrid:ref"] for label in own.tolist()} == {0, *range(1, 7)}


def test_the_apex_of_a_pyramid_is_its_third_node(tmp_path):
    path = tmp_path / "one.b8.ugrid"
    path.write_bytes(PYRAMID)
    mesh = read(path)
    assert grid(mesh).compute_cell_sizes()["Volume"][0] == pytest.approx(1 / 3)
    assert mesh.cells[0].nodes[0, 4] == 2
    assert {patch.name: len(patch) for patch in mesh.patches} == {"7": 3, "8": 1, "9": 1}
    path.write_bytes(PYRAMID[:-20] + struct.pack(">5i", 1, 4, 5, 2, 3))  # as VTK has it
    assert re.search(r"faces of patch .* are of no cell", complaint(Ugrid(), path))


def test_in_text_only_the_words_of_moved_coordinates_change(tmp_path):
    source, out = tmp_path / "a.ugrid", tmp_path / "b.ugrid"
    Ugrid().write(hybrid(), source)
    words = source.read_text().split()
    source.write_text("  " + "\r\n\t".join(words) + " 17 4\n")  # one word a line, and what may follow
    points = hybrid().points.copy()
    points[3, 1] = 0.1
    Ugrid().rewrite(source, points, out)
    np.testing.assert_array_equal(read(out).points, points)
    assert out.read_bytes() == source.read_bytes().replace(words[17].encode(), b"0.1")


@pytest.mark.parametrize("suffix", TWO)
def test_another_encoding_keeps_ids_and_order(suffix, tmp_path):
    source, out = tmp_path / "a.lr8.ugrid", tmp_path / f"b{suffix}"
    Ugrid().write(hybrid(), source)
    Ugrid().rewrite(source, hybrid().points, out)
    direct = tmp_path / f"direct{suffix}"
    Ugrid().write(hybrid(), direct)
    assert out.read_bytes() == direct.read_bytes()


def test_names_of_surfaces(tmp_path):
    path, table = tmp_path / "one.b8.ugrid", tmp_path / "one.mapbc"
    path.write_bytes(PYRAMID)
    table.write_text("\n   2  ! surfaces\n 7  4000   wing  # a comment\n  9 4000 wing\n8 5000 not_counted\n")
    assert {patch.name: len(patch) for patch in read(path).patches} == {"wing": 4, "8": 1}
    table.write_text("2\n7 4000 8\n9 -1\n")
    assert read(path).names == ("8", "8_", "9")
    before = table.read_bytes()
    Ugrid().rewrite(path, read(path).points, tmp_path / "other.b8.ugrid")
    assert table.read_bytes() == before == (tmp_path / "other.mapbc").read_bytes()


@pytest.mark.parametrize(
    ("text", "said"),
    [("", "does not begin with the number"), ("#Thu\n\n\n", "does not begin with the number"),
     ("3\n7 4000 wing\n", "should name 3 surfaces, but names 1"), ("999999999\n", ".*but names 0"),
     ("9" * 5000, "does not begin with"), ("1\nwing 4000 7\n", "1 lines are not a surface id"),
     ("2\n7 4000 a\n7 4000 b\n", "1 of its 2 surface ids are there twice"), ("1\n7\n", "1 lines are not"),
     ("1\n7 4000 \0wing\n", "is a binary file")],
)  # fmt: skip
def test_damaged_names(text, said, tmp_path):
    path = tmp_path / "one.b8.ugrid"
    path.write_bytes(PYRAMID)
    (tmp_path / "one.mapbc").write_text(text)
    assert re.search(rf"one\.mapbc: {said}", complaint(Ugrid(), path))


def test_conditions_of_a_new_mesh_follow_from_names(tmp_path):
    names = ("body", "symmetry", "far_field", "z- inlet", "wing", "Outflow", "symmetry z")
    mesh = block_with_body(3)
    named = tuple(Patch(name, patch.faces) for name, patch in zip(names, mesh.patches, strict=True))
    Ugrid().write(replace(mesh, patches=named), tmp_path / "new.b8.ugrid")
    assert (tmp_path / "new.mapbc").read_text().splitlines() == [
        "7", "1 4000 body", "2 6661 symmetry", "3 5000 far_field", "4 5000 z-_inlet", "5 4000 wing", "6 5000 Outflow",
        "7 6663 symmetry_z",
    ]  # fmt: skip


def test_numbers_are_ids_and_need_no_names(tmp_path):
    mesh = block_with_body(3)
    numbered = tuple(Patch(str(3 * i + 5), patch.faces) for i, patch in enumerate(mesh.patches))
    assert Ugrid().write(replace(mesh, patches=numbered), tmp_path / "new.b8.ugrid") == ()
    assert read(tmp_path / "new.b8.ugrid").names == tuple(patch.name for patch in numbered)
    assert not (tmp_path / "new.mapbc").exists()


def test_names_that_are_there_are_not_replaced(tmp_path):
    Ugrid().write(hybrid(), tmp_path / "a.b8.ugrid")
    Ugrid().write(hybrid(), tmp_path / "a.lb8.ugrid")
    (tmp_path / "b.mapbc").write_text("0\n")
    with pytest.raises(MeshFileError, match=r"b\.mapbc: is there and names other surfaces"):
        Ugrid().write(hybrid(), tmp_path / "b.b8.ugrid")
    with pytest.raises(MeshFileError, match=r"b\.mapbc: is there and names other surfaces"):
        Ugrid().rewrite(tmp_path / "a.b8.ugrid", hybrid().points, tmp_path / "b.b8.ugrid")
    with pytest.raises(InputError, match=r"b\.mapbc exists already"):
        OutputFiles.of(tmp_path / "a.b8.ugrid", tmp_path / "b.b8.ugrid", ((3.0,),)).check()
    elsewhere = OutputFiles.of(tmp_path / "a.su2", tmp_path / "b.b8.ugrid", ((3.0,),))
    elsewhere.check()
    with pytest.raises(MeshFileError, match=r"b\.mapbc: is there and names other surfaces"):
        elsewhere.check_names(hybrid())
    (tmp_path / "c.mapbc").mkdir()
    with pytest.raises(MeshFileError, match=r"c\.mapbc: Is a directory"):
        Ugrid().rewrite(tmp_path / "a.b8.ugrid", hybrid().points, tmp_path / "c.b8.ugrid")
    assert not (tmp_path / "b.b8.ugrid").exists()
    assert (tmp_path / "b.mapbc").read_text() == "0\n"


def test_names_of_files_keep_the_encoding(tmp_path):
    one = OutputFiles.of(tmp_path / "wing.v2.LB8.ugrid", None, ((3.0,),))
    assert one.mesh((3.0,)).name == "wing.v2-deflected.LB8.ugrid"
    several = OutputFiles.of(tmp_path / "wing.b8.ugrid", None, ((3.0,), (-12.5,)), True, True)
    assert [several.mesh(pose).name for pose in several.poses] == [
        "wing-deflected_+3.b8.ugrid", "wing-deflected_-12.5.b8.ugrid",
    ]  # fmt: skip
    assert several.report((3.0,)).name == folder_of(several.mesh((3.0,))).name == "wing-deflected_+3-report"
    assert several.sensitivity((3.0,))[0].name == "wing-deflected_+3-sensitivity.npz"
    assert OutputFiles.of(tmp_path / "wing.v2.ugrid", None, ((3.0,),)).mesh((3.0,)).name == "wing.v2-deflected.ugrid"


@pytest.mark.parametrize("suffix", BINARY)
@pytest.mark.parametrize("other", TWO)
def test_another_encoding_than_the_name_says(suffix, other, tmp_path):
    if suffix == other:
        return
    Ugrid().write(hybrid(), tmp_path / f"mesh{suffix}")
    path = (tmp_path / f"mesh{suffix}").rename(tmp_path / f"wrong{other}")
    assert f"is stored as {suffix} says; give it that name in place of {other}" in complaint(Ugrid(), path)


@pytest.mark.parametrize("at", [0, 32, 36, -4])
def test_markers_of_records(at, tmp_path):
    path = tmp_path / "mesh.r8.ugrid"
    Ugrid().write(hybrid(), path)
    data = bytearray(path.read_bytes())
    data[at % len(data)] ^= 64
    path.write_bytes(bytes(data))
    assert re.search(r"the Fortran record of \d+ bytes has another length", complaint(Ugrid(), path))


@pytest.mark.parametrize("node", [0, -3, 15, 2**31 - 1])
@pytest.mark.parametrize("name", ["triangle", "quad", "tetra", "pyramid", "wedge", "hexahedron"])
@pytest.mark.parametrize("suffix", [".ugrid", ".lb8.ugrid"])
def test_nodes_that_are_not_there(suffix, name, node, tmp_path):
    path = tmp_path / f"mesh{suffix}"
    Ugrid().write(hybrid(), path)
    encoding = suffix.split(".")[1] if suffix != ".ugrid" else ""
    with path.open("rb") as file:
        tables = UgridFile.open(file, encoding, lambda _: None).tables(path)
    arrays = {name: table.read(0, table.rows).copy() for name, table in tables.items()}
    arrays[name][0, 1] = node
    path.write_bytes(b"".join(encode(arrays, encoding)))
    assert f"1 {name} elements name points that are not among the 14 (1 to 14)" in complaint(Ugrid(), path)


@pytest.mark.parametrize("word", ["1.5", "nan", "inf", "1e300", "wing", "-"])
def test_words_of_text_that_are_no_whole_numbers(word, tmp_path):
    path = tmp_path / "mesh.ugrid"
    Ugrid().write(hybrid(), path)
    head, _, last = path.read_text().rstrip().rpartition(" ")
    path.write_text(f"{head} {word.ljust(len(last))}\n")
    assert re.search("no whole numbers|is not a number", complaint(Ugrid(), path))


def test_a_surface_id_for_each_face(tmp_path):
    faces = np.tile([[1, 2, 3]], (200_000, 1))
    path = tmp_path / "mesh.b8.ugrid"
    data = struct.pack(">7i", 4, len(faces), 0, 1, 0, 0, 0) + np.eye(4, 3).astype(">f8").tobytes()
    data += (
        faces.astype(">i4").tobytes() + np.arange(len(faces)).astype(">i4").tobytes() + struct.pack(">4i", 1, 2, 3, 4)
    )
    path.write_bytes(data)
    assert "has 200000 surface ids" in complaint(Ugrid(), path)


def test_no_cells_and_an_empty_patch(tmp_path):
    path = tmp_path / "mesh.b8.ugrid"
    path.write_bytes(struct.pack(">7i", *[0] * 7))
    assert "there are no volume cells" in complaint(Ugrid(), path)
    mesh = hybrid()
    empty = Patch("nothing", (Cells("triangle", np.empty((0, 3), dtype=np.intp)),))
    lost = Ugrid().write(replace(mesh, patches=(*mesh.patches, empty)), tmp_path / "one.b8.ugrid")
    assert "patch nothing has no faces and is left out" in lost
    assert len(read(tmp_path / "one.b8.ugrid").patches) == 6


def test_a_record_too_long_for_fortran_is_refused():
    assert ENCODINGS["r8"].marker(28) == b"\0\0\0\x1c"
    assert ENCODINGS["lb8"].marker(28) == b""
    with pytest.raises(MeshFileError, match=r"its record of 2\.1 GB is too long for Fortran"):
        ENCODINGS["r8"].marker(2**31)
