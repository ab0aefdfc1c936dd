"""Decomposed OpenFOAM cases are one mesh, in the order of the whole; only the points of the parts are rewritten."""

import gzip
import re
import shutil

import numpy as np
import pytest

from sdm_deflect.deform.mesh.mesh import Polygons
from sdm_deflect.deform.mesh.quality import quality_of
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.openfoam import MESH, OpenFoam
from sdm_deflect.meshing.formats.openfoam_files import open_foam, vectors
from sdm_deflect.meshing.formats.openfoam_parts import turned_back
from tests.meshing.formats.examples import hybrid
from tests.meshing.formats.foam_parts import LISTS, parts_of, write_parts
from tests.meshing.formats.wing import wing

KINDS = ("text", "binary", "collated", "collated text")
FORM = OpenFoam()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A wing as a case."""
    case = tmp_path_factory.mktemp("whole") / "case"
    FORM.write(wing(cells=3, layers=3).mesh, case)
    return case


@pytest.fixture(scope="module")
def mesh(whole):
    return FORM.read(whole)


@pytest.fixture(scope="module")
def cases(mesh, tmp_path_factory):
    """The parts of the wing alone, of each kind: halves along the span, of which one is cut at random."""
    folder = tmp_path_factory.mktemp("parts")
    random = np.random.default_rng(3)
    first = np.full(len(mesh.cells[0]), 99)
    np.minimum.at(
        first,
        mesh.cells[0].owner,
        (mesh.points[mesh.cells[0].faces.nodes[mesh.cells[0].faces.offsets[:-1]], 1] > 0.5).astype(int),
    )
    part = np.where(first == 0, random.integers(0, 3, len(first)), 3)
    for kind in KINDS:
        write_parts(folder / kind, parts_of(mesh, part, "text" not in kind), "collated" in kind)
        (folder / kind / "system").mkdir()
        (folder / kind / "system" / "controlDict").write_bytes(b"\0 any")
    return {kind: folder / kind for kind in KINDS}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Seven cells in three parts, in text: part 1 lies between 0 and 2."""
    folder = tmp_path_factory.mktemp("small")
    FORM.write(hybrid(), folder / "whole")
    mesh = FORM.read(folder / "whole")
    write_parts(folder / "parts", parts_of(mesh, np.array([0, 1, 1, 1, 2, 2, 0]), False))
    return folder / "parts"


def same(found, expected):
    np.testing.assert_array_equal(found.points, expected.points)
    a, b = found.cells[0], expected.cells[0]
    for one, other in (
        (a.faces.nodes, b.faces.nodes), (a.faces.offsets, b.faces.offsets), (a.owner, b.owner),
        (a.neighbour, b.neighbour),
        *((p.faces[0].nodes, q.faces[0].nodes) for p, q in zip(found.patches, expected.patches, strict=True)),
    ):  # fmt: skip
        np.testing.assert_array_equal(one, other)
    assert found.names == expected.names


def content(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def unlisted(case, out):
    """The case without the files that say what the parts are in the whole."""
    shutil.copytree(case, out, ignore=shutil.ignore_patterns("*ProcAddressing"))
    return out


@pytest.mark.parametrize("kind", KINDS)
def test_the_parts_are_the_whole_to_the_last_bit(kind, cases, mesh):
    found = FORM.read(cases[kind])
    same(found, mesh)
    assert not found.notes


@pytest.mark.parametrize("kind", KINDS)
def test_only_points_are_rewritten_and_they_are_those_of_the_moved_whole_cut_up(kind, cases, mesh, tmp_path):
    before = content(cases[kind])
    FORM.rewrite(cases[kind], mesh.points, tmp_path / "still")
    assert content(tmp_path / "still") == before
    points = mesh.points.copy()
    points[::3] += np.pi / 100.0
    FORM.rewrite(cases[kind], points, tmp_path / "out")
    same(FORM.read(tmp_path / "out"), mesh.with_points(points))
    after = content(tmp_path / "out")
    changed = {name for name in after if after[name] != before[name]}
    assert after.keys() == before.keys()
    assert changed == {name for name in before if name.endswith("/points")}
    assert content(cases[kind]) == before


@pytest.mark.parametrize("kind", KINDS)
def test_parts_that_were_never_a_whole_are_joined_at_the_patches_between_them(kind, cases, mesh, tmp_path):
    case = unlisted(cases[kind], tmp_path / "case")
    found = FORM.read(case)
    assert "joined at the patches between them" in found.notes[0]
    assert {p.name: len(p) for p in found.patches} == {p.name: len(p) for p in mesh.patches}
    assert len(found.cells[0].faces) == len(mesh.cells[0].faces)
    _, order = np.unique(mesh.points, axis=0, return_index=True)
    _, own = np.unique(found.points, axis=0, return_index=True)
    np.testing.assert_array_equal(found.points[own], mesh.points[order])
    a, b = (quality_of(m.points, m.cells[0]) for m in (found, mesh))
    np.testing.assert_allclose(np.sort(a), np.sort(b), rtol=1e-12)
    points = np.empty_like(mesh.points)
    moved = mesh.points + np.sin(mesh.points[:, ::-1])
    points[own] = moved[order]
    FORM.rewrite(case, points, tmp_path / "joined")
    FORM.rewrite(cases[kind], moved, tmp_path / "listed")
    np.testing.assert_array_equal(FORM.read(tmp_path / "joined").points, points)
    joined, listed = content(tmp_path / "joined"), content(tmp_path / "listed")
    assert joined == {name: data for name, data in listed.items() if name.rpartition("/")[2] not in LISTS}


@pytest.mark.parametrize("kind", ["text", "collated"])
def test_beside_a_whole_the_parts_are_named_by_one_of_them(kind, cases, mesh, whole, tmp_path):
    case = tmp_path / "case"
    shutil.copytree(cases[kind], case)
    shutil.copytree(whole / MESH, case / MESH)
    name = "processors4" if "collated" in kind else "processor0"
    found = FORM.read(case)
    same(found, mesh)
    assert str(case / name) in found.notes[0]
    FORM.rewrite(case, mesh.points + 1.0, tmp_path / "one")
    assert not list((tmp_path / "one").glob("processor*"))
    assert not FORM.read(case / name).notes
    FORM.rewrite(case / name, mesh.points + 1.0, tmp_path / "both")
    np.testing.assert_array_equal(FORM.read(tmp_path / "both").points, mesh.points + 1.0)
    np.testing.assert_array_equal(FORM.read(tmp_path / "both" / name).points, mesh.points + 1.0)
    other = FORM.read(case).points * 2.0
    FORM.rewrite(case, other, tmp_path / "twice")
    shutil.copy(tmp_path / "twice" / MESH / "points", case / MESH / "points")
    FORM.rewrite(case / name, mesh.points + 1.0, tmp_path / "parts")
    np.testing.assert_array_equal(FORM.read(tmp_path / "parts").points, other)


def test_one_part_alone_is_no_mesh(cases):
    with pytest.raises(MeshFileError, match=r"patch procBoundary1to0 joins it to other parts .* name the case"):
        FORM.read(cases["text"] / "processor1" / MESH)


def test_collated_files_of_several_writers_and_packed_ones_are_read_and_rewritten(cases, mesh, tmp_path):
    files = [{name: (cases["binary"] / f"processor{i}" / MESH / name).read_bytes()
              for name in content(cases["binary"] / "processor0" / MESH)} for i in range(4)]  # fmt: skip
    write_parts(tmp_path / "case", files[:2], collated=True)
    (tmp_path / "case" / "processors2").rename(tmp_path / "case" / "processors4_0-1")
    write_parts(tmp_path / "case", files[2:], collated=True, first=2)
    (tmp_path / "case" / "processors4").rename(tmp_path / "case" / "processors4_2-3")
    for path in (tmp_path / "case" / "processors4_0-1" / MESH).iterdir():
        path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    same(FORM.read(tmp_path / "case"), mesh)
    FORM.rewrite(tmp_path / "case", mesh.points + 1.0, tmp_path / "out")
    same(FORM.read(tmp_path / "out"), mesh.with_points(mesh.points + 1.0))
    shutil.rmtree(tmp_path / "case" / "processors4_0-1")
    with pytest.raises(MeshFileError, match="processor0 is missing"):
        FORM.read(tmp_path / "case")


def test_points_that_drifted_apart_by_a_digit_are_one_again(small, tmp_path):
    shutil.copytree(small, tmp_path / "case")
    path = tmp_path / "case" / "processor1" / MESH / "points"
    text = path.read_text()
    path.write_text(re.sub(r"(\d\.\d{6})\d+", r"\1", text))
    points = FORM.read(tmp_path / "case").points
    np.testing.assert_allclose(points, FORM.read(small).points, atol=1e-6)
    FORM.rewrite(tmp_path / "case", points, tmp_path / "out")
    copies = (vectors(open_foam(tmp_path / "out" / f"processor{i}" / MESH, "points")).values for i in range(3))
    rows = [tuple(row) for own in copies for row in own.tolist()]
    assert len(set(rows)) == len(points) < len(rows)


def test_faces_go_backwards_from_the_same_node():
    faces = Polygons(np.array([0, 1, 2, 3, 4, 5, 6]), np.array([0, 3, 7]))
    assert turned_back(faces, np.array([False, True])).nodes.tolist() == [0, 1, 2, 3, 6, 5, 4]


def changed(name, old, new):
    def change(case):
        path = case / name
        text = path.read_text()
        assert re.search(old, text)
        path.write_text(re.sub(old, new, text, count=1))

    return change


def cut(name):
    def change(case):
        path = case / name
        data = path.read_bytes().rstrip()
        path.write_bytes(data[: len(data) * 2 // 3])

    return change


PART1 = f"processor1/{MESH}"
ALL = ("points", "faces", "owner", "neighbour", "boundary", *LISTS)
POINTS, FACES, CELLS, _ = (f"{PART1}/{name}" for name in LISTS)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda case: shutil.rmtree(case / "processor1"), "processor0, processor2, but no mesh in processor1; a part"),
        (lambda case: shutil.rmtree(case / "processor0"), "no mesh in processor0; a part is missing"),
        (lambda case: shutil.rmtree(case / "processor2"), "procBoundary1to2 borders on processor2, which is not there"),
        (lambda case: shutil.copytree(case / "processor1", case / "processors3"), "processor0 and in processors3; del"),
        (lambda case: (case / "processor2").rename(case / "processors"), "processor0 and in processors; delete"),
        (lambda case: shutil.copytree(case / "processor1", case / "processor2", dirs_exist_ok=True),
         "patch procBoundary1to0 is one of processor1; the parts are not of one mesh"),
        *((cut(f"{PART1}/{name}"), f"{PART1}/{name}") for name in ALL),
        *((lambda case, name=name: (case / PART1 / name).unlink(), f"{PART1}/{name}: .*No such file")
          for name in ("points", "pointProcAddressing", "cellProcAddressing")),
        (changed(POINTS, r"\(\n\d+", "(\n13"), "points of the whole are in no|apart"),
        (changed(POINTS, r"\(\n\d+", "(\n99999999999"), "the parts' points are .* to 99999999999 of"),
        (changed(POINTS, r"\(\n\d+", "(\n-1"), "the parts' points are -1 to"),
        (changed(CELLS, r"\(\n\d+", "(\n0"), "cells of the whole are in no part"),
        (changed(FACES, r"\(\n\d+", "(\n0"), "the parts' faces are -1 to"),
        (changed(FACES, r"\n-", "\n"), "other points in one than in the other"),
        (changed(f"{PART1}/boundary", "neighbProcNo 2", "neighbProcNo 9"), "borders on processor9, which is not there"),
        (changed(f"{PART1}/points", r"\((\d)", "(7\\1"), "points that parts share lie up to .* apart"),
        (changed(f"{PART1}/faces", r"\n4\(\d+", "\n4(77"), "faces have the nodes 0 to 77, but there are"),
    ],
)  # fmt: skip
def test_parts_that_do_not_fit_are_one_sentence(change, said, small, tmp_path):
    shutil.copytree(small, tmp_path / "case")
    change(tmp_path / "case")
    with pytest.raises(MeshFileError, match=said) as caught:
        FORM.read(tmp_path / "case")
    assert str(tmp_path / "case") in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (changed(f"{PART1}/boundary", "neighbProcNo 2", "neighbProcNo 0"), "two patches towards processor0"),
        (changed(f"{PART1}/boundary", "(procBoundary1to2[^}]*?type )processor", "\\1wall"), "which has 0 back"),
        (changed(f"{PART1}/faces", r"\n3\((?=[\d ]+\)\n\)\n$)", "\n4(0 "), "have other faces between them"),
    ],
)
def test_parts_without_lists_that_do_not_fit_are_one_sentence(change, said, small, tmp_path):
    change(unlisted(small, tmp_path / "case"))
    with pytest.raises(MeshFileError, match=said):
        FORM.read(tmp_path / "case")


@pytest.mark.parametrize("name", ALL)
def test_a_collated_file_that_is_cut_or_lacks_a_part_is_named(name, cases, tmp_path):
    shutil.copytree(cases["collated"], tmp_path / "case")
    path = tmp_path / "case" / "processors4" / MESH / name
    data = path.read_bytes()
    for end, said in (
        (len(data) // 2, "block|processor|parts"),
        (data.index(b"}"), "header"),
        (data.index(b"}") + 1, "no part"),
        (data.index(b"// Processor3"), "3 parts .* should be 4"),
    ):
        path.write_bytes(data[:end])
        with pytest.raises(MeshFileError, match=f"{path}: .*({said})"):
            FORM.read(tmp_path / "case")


def test_a_file_of_one_part_is_no_collated_one(small, tmp_path):
    shutil.copytree(small / "processor0", tmp_path / "case" / "processors3")
    with pytest.raises(MeshFileError, match="points: is a vectorField, where a collated file of all parts should be"):
        FORM.read(tmp_path / "case")
