"""Counts, sizes and packings that a file only claims take neither memory nor time: one sentence, at once."""

import gzip
import re
import tracemalloc
from time import process_time

import numpy as np
import pytest

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.unpacking import RATIO_VARIABLE
from sdm_deflect.meshing.formats.gmsh import Gmsh
from sdm_deflect.meshing.formats.openfoam import MESH, OpenFoam
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.meshing.formats.examples import hybrid

SECONDS, BYTES = 4.0, 300e6


def complaint(form, path) -> str:
    """The one sentence with which a file is refused, soon and without much memory."""
    tracemalloc.start()
    begin = process_time()
    with pytest.raises(MeshFileError) as caught:
        form.read(path)
    spent, (_, peak) = process_time() - begin, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    message = str(caught.value)
    assert spent < SECONDS
    assert peak < BYTES
    assert "\n" not in message
    assert len(message) < 600
    assert str(path) in message
    return message


def test_an_entity_in_very_many_groups(tmp_path):
    """Elements are given once for each group: the product of two lengths."""
    faces, groups = 20_000, 20_000
    text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 1 0\n1 0 0 0 1 1 1 "
    text += f"{groups} {' '.join(map(str, range(1, groups + 1)))} 0\n$EndEntities\n"
    text += "$Nodes\n1 3 1 3\n2 1 0 3\n1\n2\n3\n0 0 0\n1 0 0\n0 1 0\n$EndNodes\n"
    rows = "".join(f"{i} 1 2 3\n" for i in range(1, faces + 1))
    (tmp_path / "mesh.msh").write_text(text + f"$Elements\n1 {faces} 1 {faces}\n2 1 2 {faces}\n{rows}$EndElements\n")
    assert RATIO_VARIABLE in complaint(Gmsh(), tmp_path / "mesh.msh")


@pytest.fixture
def case(tmp_path):
    OpenFoam().write(hybrid(), tmp_path / "case")
    return tmp_path / "case"


HEAD = b'FoamFile\n{ format %s; class %s; arch "%s"; }\n'
TEXT = HEAD % (b"ascii", b"labelList", b"")


def binary(arch: bytes, kind: bytes = b"labelList") -> bytes:
    return HEAD % (b"binary", kind, arch)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("owner", TEXT + b"900000000{0}", f"a list of 900000000 would take .*{RATIO_VARIABLE}"),
        ("owner", binary(b"LSB;label=32") + b"900000000{" + bytes(4) + b"}", "a list of 900000000 would take"),
        ("points", TEXT + b"90000000000(", "a list of 90000000000 would take"),
        ("faces", TEXT + b"90000000000(", "a list of 90000000000 would take"),
        ("owner", binary(b"LSB;label=32") + b"90000000000(" + bytes(4) + b")", "90000000000 values should follow"),
        ("owner", binary(b"LSB;label=128") + b"1(" + bytes(16) + b")", "arch has label=128"),
        ("points", binary(b"LSB;scalar=8", b"vectorField") + b"1(" + bytes(3) + b")", "arch has scalar=8"),
        ("owner", TEXT + b"1(" + b"0 " * 2_000_000 + b")", "bytes where 1 numbers or faces should be"),
        ("owner", TEXT + b"9" * 5000 + b"(0)", "digits|Exceeds"),
        ("owner", TEXT + b"1(" + b"word" * 5000 + b")", "is not a number"),
        ("owner", b"FoamFile{" * 110_000, "has no FoamFile header"),
        ("owner", b"FoamFile{" + b"a" * 1_000_000 + b"}", "has no FoamFile header"),
        ("owner", TEXT + b"/*" * 500_000, "no list follows"),
        ("owner", binary(b"") + b"/**/" * 200_000 + b"x", "no list follows"),
        ("owner", binary(b"") + b"//\n" * 200_000 + b"x", "no list follows"),
        ("boundary", TEXT + b"1(a{" + b"b{" * 5000 + b"}" * 5001 + b")", "has no nFaces, startFace, type"),
        ("boundary", TEXT + b"1(a{" + b"b{" * 5000, "truncated or damaged"),
        ("boundary", TEXT + b"1(a{type wall; nFaces 9; startFace 0;})", "begins at face 0, but the faces before 7"),
        ("boundary", TEXT + b"1(a{type wall; nFaces 99999999999; startFace 9;})", "has the faces 9 to 100000000007"),
        ("boundary", TEXT + b"1(a{type wall; nFaces -5; startFace 9;})", "has the faces 9 to 3"),
    ],
)  # fmt: skip
def test_files_of_openfoam(case, name, content, said):
    (case / MESH / name).write_bytes(content)
    assert re.search(said, complaint(OpenFoam(), case))


def test_a_packed_file_that_unpacks_to_far_more(case, monkeypatch):
    monkeypatch.delenv(RATIO_VARIABLE, raising=False)
    (case / MESH / "owner").unlink()
    (case / MESH / "owner.gz").write_bytes(gzip.compress(TEXT + b"2000000(" + b"0 " * 30_000_000, 6))
    assert f"set {RATIO_VARIABLE} to more than" in complaint(OpenFoam(), case)


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, 1e300])
@pytest.mark.parametrize("name", ["su2", "gmsh", "ugrid", "tau", "openfoam"])
def test_coordinates_out_of_all_range_are_refused_without_a_warning(name, value, tmp_path):
    form, mesh, mark = FORMATS[name], hybrid(), 12345.6875
    path = tmp_path / ("case" if name == "openfoam" else f"mesh{form.suffixes[0]}")
    mesh.points[3, 1] = mark
    form.write(mesh, path)
    file = path / MESH / "points" if path.is_dir() else path
    data = file.read_bytes().replace(np.float64(mark).tobytes(), np.float64(value).tobytes())
    data = data.replace(np.array(mark, ">f8").tobytes(), np.array(value, ">f8").tobytes())
    file.write_bytes(re.sub(rb"12345\.68\d*|1\.234568\d*e\+04", b"%r" % value, data))
    assert re.search("1 points are (not finite|beyond)|numbers that are not finite|not a number", complaint(form, path))
