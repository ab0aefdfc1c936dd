"""Binary OpenFOAM cases in pieces: what is read as a whole is found, and what is refused, in the same words."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.meshing.formats import openfoam, openfoam_pieces, rewriting, tables
from sdm_deflect.meshing.formats.openfoam import MESH, OpenFoam
from sdm_deflect.meshing.formats.openfoam_files import open_foam
from sdm_deflect.meshing.formats.registry import in_pieces, read
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.meshing.formats.alike import content
from tests.meshing.formats.examples import hybrid
from tests.meshing.formats.wing import wing

KINDS = {"label 32": ("<i4", "<f8"), "label 64": ("<i8", "<f8"), "scalar 32": ("<i4", "<f4")}


@pytest.fixture(autouse=True)
def few_at_a_time(monkeypatch):
    monkeypatch.setattr(openfoam_pieces, "SPAN", 7)
    monkeypatch.setattr(openfoam_pieces, "BATCH", 21)
    monkeypatch.setattr(tables, "SMALL", 0)
    monkeypatch.setattr(rewriting, "RANGE", 37)


@pytest.fixture(params=KINDS)
def case(request, monkeypatch, tmp_path):
    label, scalar = map(np.dtype, KINDS[request.param])
    monkeypatch.setattr(openfoam, "LABEL", label)
    monkeypatch.setattr(openfoam, "SCALAR", scalar)
    OpenFoam().write(wing(cells=2).mesh, tmp_path / "case")
    return tmp_path / "case"


def test_points_cells_and_patches(case):
    mesh = read(case)
    cells = mesh.cells[0]
    with in_pieces(case) as found:
        pieces = found.pieces
        assert (pieces.points, pieces.blocks) == (len(mesh.points), (("polyhedron", len(cells)),))
        np.testing.assert_array_equal(pieces.coordinates(3, 60), mesh.points[3:60])
        for start, stop in ((0, len(cells)), (0, 1), (40, 90), (len(cells) - 1, len(cells))):
            some = pieces.cells_of(0, start, stop)
            beside = np.pad(cells.neighbour, (0, len(cells.owner) - len(cells.neighbour)), constant_values=-1)
            own = ((cells.owner >= start) & (cells.owner < stop)) | ((beside >= start) & (beside < stop))
            np.testing.assert_array_equal(some.numbers, np.flatnonzero(own))
            np.testing.assert_array_equal(some.sides.owner, cells.owner[own])
            np.testing.assert_array_equal(some.sides.neighbour, beside[own & (beside >= 0)])
            sizes = np.diff(cells.faces.offsets)
            np.testing.assert_array_equal(some.nodes, cells.faces.nodes[np.repeat(own, sizes)])
            np.testing.assert_array_equal(np.diff(some.sides.faces.offsets), sizes[own])
        one, other = (Mesh(mesh.points, (), own.patches, own.zones) for own in (found, mesh))
        assert content(one) == content(other)
        assert (found.name, pieces.source, found.notes) == (mesh.name, mesh.source, mesh.notes)


@pytest.mark.parametrize("named", [Path(), MESH, Path("case.foam"), Path("link.foam")])
def test_a_copy_with_other_coordinates(case, named, tmp_path):
    """The same bytes as rewriting the case as a whole, with all other files, and without its parts."""
    (case / "link.foam").symlink_to(case / "system" / "controlDict")
    (case / "0").mkdir()
    (case / "0" / "U").write_bytes(b"\0\1")
    (case / "processor0").mkdir()
    (case / MESH / "points").chmod(0o640)
    points = read(case / named).points.copy()
    nodes = np.array([0, 2, 3, 5, 13])
    points[nodes[:-1]] += np.pi / 100.0
    with in_pieces(case / named) as found:
        found.pieces.rewrite(nodes, points[nodes], tmp_path / "pieces")
    OpenFoam().rewrite(case / named, points, tmp_path / "whole")
    files = [
        {path.relative_to(out): (path.read_bytes(), path.stat().st_mode) for path in out.rglob("*") if path.is_file()}
        for out in (tmp_path / "pieces", tmp_path / "whole")
    ]
    assert files[0] == files[1]
    inner = MESH if named != MESH else Path()
    assert files[0][inner / "points"][0] != (case / MESH / "points").read_bytes()
    assert (tmp_path / "pieces" / "0" / "U").exists() == (named != MESH)


def test_a_case_that_becomes_shorter(case):
    with in_pieces(case) as found:
        for name in ("points", "faces", "owner"):
            path = case / MESH / name
            path.write_bytes(path.read_bytes()[:400])
        for take in (lambda: found.pieces.coordinates(0, 30), lambda: found.pieces.cells_of(0, 0, 9)):
            with pytest.raises(InputError, match="was changed or replaced while it was in use"):
                take()


@pytest.fixture
def small(tmp_path):
    OpenFoam().write(hybrid(), tmp_path / "case")
    return tmp_path / "case"


def replaced(name: str, old: bytes, new: bytes):
    def change(mesh: Path) -> None:
        data = (mesh / name).read_bytes()
        assert old in data
        (mesh / name).write_bytes(data.replace(old, new))

    return change


def listed(name: str, values):
    """Put another list of labels in place of one."""

    def change(mesh: Path) -> None:
        file = open_foam(mesh, name)
        own = openfoam_pieces.locate_list(file, file.start, "label", 1)
        new = values(np.frombuffer(file.data, own.kind, own.rows, own.begin)).astype(own.kind)
        (mesh / name).write_bytes(file.data[: file.start] + b"\n%d(" % len(new) + new.tobytes() + b")\n")

    return change


@pytest.mark.parametrize(
    "change",
    [
        lambda mesh: shutil.move(mesh / "points", mesh / "points.gz"),
        replaced("owner", b"binary", b"ascii"),
        replaced("faces", b"faceCompactList", b"faceList"),
        listed("neighbour", lambda own: np.append(own, [-1, -1])),
    ],
)
def test_other_lists_are_read_as_a_whole(change, small):
    change(small / MESH)
    with in_pieces(small) as found:
        assert found is None
