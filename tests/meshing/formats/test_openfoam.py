"""OpenFOAM cases: written whole, rewritten in points alone, from text, binary and packed files."""

import gzip
import shutil
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.formats.openfoam import MESH, OpenFoam, kind_of
from sdm_deflect.meshing.formats.openfoam_files import open_foam, parse
from sdm_deflect.meshing.formats.registry import format_of
from sdm_deflect.meshing.mesh.cells import Polygons
from sdm_deflect.meshing.mesh.mesh import Warned
from tests.meshing.formats.examples import hybrid
from tests.meshing.formats.wing import wing

FILES = ("points", "faces", "owner", "neighbour", "boundary")


@pytest.fixture(scope="module")
def binary(tmp_path_factory):
    """The hybrid mesh as we write it."""
    case = tmp_path_factory.mktemp("foam") / "binary"
    OpenFoam().write(hybrid(), case)
    return case


@pytest.fixture(scope="module")
def text(binary, tmp_path_factory):
    """The same in text with comments, lists on one line, one list packed, in a case with more files."""
    mesh = OpenFoam().read(binary)
    case = tmp_path_factory.mktemp("foam") / "text"
    shutil.copytree(binary, case)
    (case / "processor0").mkdir()
    (case / "0").mkdir()
    (case / "0" / "U").write_bytes(b"\0\1")
    cells, faces = mesh.cells[0], mesh.cells[0].faces
    head = "/*--- a banner (with 3 brackets) ---*/\nFoamFile\n{\n  format ascii;\n  class %s;\n}\n// * * * //\n\n"
    rows = np.split(faces.nodes, faces.offsets[1:-1])
    lists = {
        "points": f"{len(mesh.points)} // all of them\n(\n"
        + "".join(f"({x!r} {y!r}\t{z:.17e})\n" for x, y, z in mesh.points.tolist())
        + ")",
        "faces": f"{len(faces)}\n(\n"
        + "\n".join(f"{len(r)}({' '.join(map(str, r.tolist()))})" for r in rows)
        + "\n)\n",
        "owner": f"{len(faces)}\n(\n" + "\n".join(map(str, cells.owner.tolist())) + "\n)\n\n// ***** //\n",
        "neighbour": f"{len(cells.neighbour)}({' '.join(map(str, cells.neighbour.tolist()))})",
    }
    for name, content in lists.items():
        (case / MESH / name).write_text(head % "aList" + content)
    packed = gzip.compress((case / MESH / "owner").read_bytes())
    (case / MESH / "owner.gz").write_bytes(packed)
    (case / MESH / "owner").unlink()
    return case


def same(found, expected):
    np.testing.assert_array_equal(found.points, expected.points)
    a, b = found.cells[0], expected.cells[0]
    for one, other in ((a.faces.nodes, b.faces.nodes), (a.owner, b.owner), (a.neighbour, b.neighbour)):
        np.testing.assert_array_equal(one, other)
    assert [p.name for p in found.patches] == [p.name for p in expected.patches]


def test_names_faces_and_points_are_those_of_the_mesh(binary):
    mesh, expected = OpenFoam().read(binary), hybrid()
    np.testing.assert_array_equal(mesh.points, expected.points)
    assert len(mesh.cells[0]) == 7
    for patch in expected.patches:
        faces = mesh.patch(patch.name.replace(" ", "_")).faces[0]
        assert isinstance(faces, Polygons)
        found = sorted(_turned(row) for row in np.split(faces.nodes, faces.offsets[1:-1]))
        assert found == sorted(_turned(row) for block in patch.faces for row in block.nodes)


def _turned(row):
    row = list(row)
    first = row.index(min(row))
    return tuple(int(n) for n in row[first:] + row[:first])


def test_faces_point_out_of_their_owner_and_are_in_upper_triangular_order(tmp_path):
    OpenFoam().write(wing(cells=3).mesh, tmp_path / "case")
    mesh = OpenFoam().read(tmp_path / "case")
    cells = mesh.cells[0]
    inner = len(cells.neighbour)
    assert np.all(cells.owner[:inner] < cells.neighbour)
    order = np.lexsort((cells.neighbour, cells.owner[:inner]))
    np.testing.assert_array_equal(order, np.arange(inner))
    closed = np.zeros((len(cells), 3))
    area = _areas(mesh.points, cells.faces)
    np.add.at(closed, cells.owner, area)
    np.subtract.at(closed, cells.neighbour, area[:inner])
    np.testing.assert_allclose(closed, 0.0, atol=1e-12)
    assert _volume(mesh.points, cells.faces, inner) == pytest.approx(50.0, rel=0.03)


def _areas(points, faces):
    first = points[np.repeat(faces.nodes[faces.offsets[:-1]], np.diff(faces.offsets))]
    after = np.arange(len(faces.nodes)) + 1
    after[faces.offsets[1:] - 1] = faces.offsets[:-1]
    cross = np.cross(points[faces.nodes] - first, points[faces.nodes[after]] - first)
    return np.add.reduceat(cross, faces.offsets[:-1]) / 2.0


def _volume(points, faces, inner):
    outer = faces.rows(inner, len(faces))
    centre = np.add.reduceat(points[outer.nodes], outer.offsets[:-1]) / np.diff(outer.offsets)[:, None]
    return np.einsum("ij,ij->", centre, _areas(points, outer)) / 3.0


def test_text_and_packed_files_hold_the_same_mesh(binary, text):
    same(OpenFoam().read(text), OpenFoam().read(binary))
    same(OpenFoam().read(text / MESH), OpenFoam().read(binary))
    (text / "any.foam").touch()
    same(OpenFoam().read(text / "any.foam"), OpenFoam().read(binary))
    assert format_of(text).name == format_of(text / "any.foam").name == "openfoam"


def test_labels_of_64_bits_and_points_of_32_are_read(binary, tmp_path):
    shutil.copytree(binary, tmp_path / "case")
    mesh = OpenFoam().read(binary)
    for name, values, kind in (("owner", mesh.cells[0].owner, "<i8"), ("points", mesh.points, "<f4")):
        path = tmp_path / "case" / MESH / name
        head = path.read_bytes().split(b"}\n")[0].replace(b"label=32", b"label=64").replace(b"scalar=64", b"scalar=32")
        path.write_bytes(head + b"}\n\n%d\n(" % len(values) + values.astype(kind).tobytes() + b")\n")
    again = OpenFoam().read(tmp_path / "case")
    np.testing.assert_array_equal(again.cells[0].owner, mesh.cells[0].owner)
    np.testing.assert_array_equal(again.points, mesh.points.astype(np.float32))


@pytest.mark.parametrize("kind", ["binary", "text"])
def test_only_the_points_that_moved_change(kind, request, tmp_path):
    case = request.getfixturevalue(kind)
    before = {path: path.read_bytes() for path in case.rglob("*") if path.is_file()}
    points = OpenFoam().read(case).points
    OpenFoam().rewrite(case, points, tmp_path / "still")
    for path, data in before.items():
        assert (tmp_path / "still" / path.relative_to(case)).read_bytes() == data
    assert not (tmp_path / "still" / "processor0").exists()
    points = points.copy()
    points[5] += np.pi
    OpenFoam().rewrite(case, points, tmp_path / "moved")
    np.testing.assert_array_equal(OpenFoam().read(tmp_path / "moved").points, points)
    changed = [p for p, data in before.items() if (tmp_path / "moved" / p.relative_to(case)).read_bytes() != data]
    assert changed == [case / MESH / "points"]
    if kind == "text":
        lines = zip(
            before[changed[0]].split(b"\n"),
            (tmp_path / "moved" / MESH / "points").read_bytes().split(b"\n"),
            strict=True,
        )
        assert sum(a != b for a, b in lines) == 1
    assert {path: path.read_bytes() for path in before} == before


def test_packed_points_stay_packed_and_links_are_not_written_through(binary, tmp_path):
    shutil.copytree(binary, tmp_path / "mesh")
    folder = tmp_path / "mesh" / MESH
    (folder / "points.gz").write_bytes(gzip.compress((folder / "points").read_bytes()))
    (folder / "points").unlink()
    (tmp_path / "case" / "constant").mkdir(parents=True)
    (tmp_path / "case" / MESH).symlink_to(folder)
    before = (folder / "points.gz").read_bytes()
    points = OpenFoam().read(tmp_path / "case").points + 1.0
    OpenFoam().rewrite(tmp_path / "case", points, tmp_path / "out")
    np.testing.assert_array_equal(OpenFoam().read(tmp_path / "out").points, points)
    assert (folder / "points.gz").read_bytes() == before
    assert not (tmp_path / "out" / MESH / "points").exists()


def test_links_of_a_case_stay_links_and_lead_where_they_led(binary, tmp_path):
    case, shared = tmp_path / "case", tmp_path / "shared"
    shutil.copytree(binary, case)
    shared.mkdir()
    (shared / "0").mkdir()
    (shared / "faces").write_bytes((case / MESH / "faces").read_bytes())
    (case / MESH / "faces").unlink()
    links = {
        "loop": ".", "again": ".", "study": "..", "away": "nowhere", "itself": "itself", "0": str(shared / "0"),
        "constant/polyMesh/faces": "../../../shared/faces", "constant/mesh": "polyMesh", "constant/up": "../system",
    }  # fmt: skip
    for name, target in links.items():
        (case / name).symlink_to(target)
    mesh = OpenFoam().read(case)
    before = (case / MESH / "points").read_bytes()
    OpenFoam().rewrite(case, mesh.points + 1.0, tmp_path / "deep" / "out")
    out = tmp_path / "deep" / "out"
    assert all((out / name).is_symlink() for name in links)
    for name in ("study", "0", "constant/polyMesh/faces"):
        assert (out / name).resolve() == (case / name).resolve(), name
    assert (out / "loop").resolve() == out
    assert (out / "constant/up").resolve() == out / "system"
    assert (out / "constant/mesh").resolve() == out / MESH
    np.testing.assert_array_equal(OpenFoam().read(out).points, mesh.points + 1.0)
    assert (case / MESH / "points").read_bytes() == before
    assert sum(1 for _ in out.rglob("*")) < 40


def test_a_mesh_behind_a_loop_of_links_is_refused_by_its_name(binary, tmp_path):
    shutil.copytree(binary / MESH, tmp_path / "case" / "polyMesh")
    (tmp_path / "case" / "constant").symlink_to(".")
    mesh = OpenFoam().read(tmp_path / "case")
    with pytest.raises(MeshFileError, match="constant is a link to a folder that it lies in"):
        OpenFoam().rewrite(tmp_path / "case", mesh.points, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("named", [Path(), MESH])
def test_other_points_beside_those_of_the_mesh_are_warned_of(binary, named, tmp_path):
    shutil.copytree(binary, tmp_path / "case")
    assert not any(isinstance(note, Warned) for note in OpenFoam().read(tmp_path / "case" / named).notes)
    for i in range(8):
        shutil.copy(binary / MESH / "points", tmp_path / "case" / MESH / f"points_{i}")
    (warned,) = [note for note in OpenFoam().read(tmp_path / "case" / named).notes if isinstance(note, Warned)]
    assert warned.startswith("beside points there is points_0, points_1, points_2, points_3, points_4 and 3 more, ")
    assert "copy the deflected points over it" in warned
    (tmp_path / "case" / MESH / "points").unlink()
    (tmp_path / "case" / "processor0" / MESH).mkdir(parents=True)
    with pytest.raises(MeshFileError, match=r"polyMesh has no points; there is points_0, .* and 3 more: copy it to"):
        OpenFoam().read(tmp_path / "case" / named)


def test_what_was_read_is_written_as_the_same_bytes(binary, tmp_path):
    OpenFoam().write(OpenFoam().read(binary), tmp_path / "again")
    for name in FILES:
        assert (tmp_path / "again" / MESH / name).read_bytes() == (binary / MESH / name).read_bytes()


def test_boundary_faces_of_no_patch_and_inner_faces_of_one_are_told(tmp_path):
    mesh = hybrid()
    inner = type(mesh.patches[0])("baffle", (type(mesh.patches[0].faces[0])("quad", np.array([[1, 2, 6, 5]])),))
    given = type(mesh)(mesh.points, mesh.cells, (*mesh.patches[1:], inner))
    lost = OpenFoam().write(given, tmp_path / "case")
    assert any("3 boundary faces are on no patch" in sentence for sentence in lost)
    assert any("1 faces of patch baffle are not on the boundary" in sentence for sentence in lost)
    assert {p.name: len(p) for p in OpenFoam().read(tmp_path / "case").patches}["unnamed"] == 3


@pytest.mark.parametrize(
    ("name", "planar", "kind"),
    [("symmetry", True, "symmetryPlane"), ("Sym_left", False, "symmetry"), ("far_field", False, "patch"),
     ("inlet", True, "patch"), ("fuselage", False, "wall"), ("chimera", True, "patch")],
)  # fmt: skip
def test_types_follow_from_names(name, planar, kind):
    assert kind_of(name, planar) == kind


def test_patches_of_any_entries_are_parsed():
    text = b"2(walls{type wall;inGroups 2(wall all);nFaces 3;startFace 4;}"
    text += b'"a b"{type cyclic;transform{x 1;}nFaces 0; startFace 7;})'
    patches = parse(text)
    assert [(p.name, p.type, p.count, p.start) for p in patches] == [("walls", "wall", 3, 4), ("a b", "cyclic", 0, 7)]


@pytest.mark.parametrize("kind", ["binary", "text"])
@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("fraction", [0.1, 0.6, 0.93])
def test_a_truncated_file_is_an_error_that_names_it(kind, name, fraction, request, tmp_path):
    shutil.copytree(request.getfixturevalue(kind), tmp_path / "case")
    path = next((tmp_path / "case" / MESH).glob(f"{name}*"))
    data = path.read_bytes()
    path.write_bytes(data[: int(fraction * len(data.rstrip()))])
    with pytest.raises(MeshFileError, match=str(MESH / name)):
        OpenFoam().read(tmp_path / "case")


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("points", "(0.0 ", "(nan ", "1 points are not finite"),
        ("faces", "4(0 ", "4(99 ", "99, but there are 14 points"),
        ("neighbour", "(", "(-7 ", "holds"),
        ("boundary", "nFaces 3", "nFaces 300", "patch floor has the faces"),
        ("boundary", "    type wall;\n", "", "has no type"),
        ("boundary", "6\n(", "7\n(", "6 patches follow where there should be 7"),
    ],
)
def test_damage_is_named(name, old, new, said, text, tmp_path):
    shutil.copytree(text, tmp_path / "case")
    path = tmp_path / "case" / MESH / name
    content = path.read_text()
    body = content.index("}\n")
    assert old in content[body:]
    path.write_text(content[:body] + content[body:].replace(old, new, 1))
    with pytest.raises(MeshFileError, match=said):
        OpenFoam().read(tmp_path / "case")


def test_existing_folders_and_the_source_are_not_written_to(binary, tmp_path):
    points = OpenFoam().read(binary).points
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes").write_text("mine")
    with pytest.raises(MeshFileError, match="exists already"):
        OpenFoam().rewrite(binary, points, tmp_path / "full")
    with pytest.raises(MeshFileError, match="lies in the case"):
        OpenFoam().rewrite(binary, points, binary / "new")
    with pytest.raises(MeshFileError, match="14 points"):
        OpenFoam().rewrite(binary, points[1:], tmp_path / "new")
    assert [path.name for path in tmp_path.iterdir()] == ["full"]
    with pytest.raises(MeshFileError, match="not an OpenFOAM case"):
        OpenFoam().read(tmp_path)
    with pytest.raises(MeshFileError, match="No such file"):
        OpenFoam().read(tmp_path / "none")


def test_headers_tell_what_a_file_is(binary):
    file = open_foam(binary / MESH, "owner")
    assert file.binary
    assert file.entries["class"] == "labelList"
    assert "nCells:7" in file.entries["note"]
