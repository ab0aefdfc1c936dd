"""Nothing is overwritten but an earlier page, plan or mesh of ours, and nothing of a user is removed."""

import json
import os

import numpy as np
import pytest

from sdm_deflect.base import files
from sdm_deflect.cases.cli import examination as doctor
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.deform.blocks import block_with_body

TURN = ["--surface", "body", "--hinge", "0,-0.6,0", "0,0.6,0", "--no-report", "--quiet"]


@pytest.fixture
def mesh(tmp_path):
    FORMATS["su2"].write(block_with_body(8), tmp_path / "block.su2")
    return tmp_path / "block.su2"


@pytest.mark.parametrize("name", ["block.su2", "block-view.html", "mine.npz", "link.su2", "folder"])
def test_view_replaces_its_earlier_page_alone(name, mesh, sdm):
    folder = mesh.parent
    (folder / "block-view.html").write_text("my own page")
    np.savez(folder / "mine.npz", x=np.arange(3))
    (folder / "link.su2").symlink_to(mesh)
    (folder / "folder").mkdir()
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    words = [] if name == "block-view.html" else ["--out", folder / name]
    code, _, said = sdm("view", mesh, *words, "--no-open", "--quiet")
    assert (code, said.count("\n")) == (2, 1)
    assert {path: path.read_bytes() for path in before} == before
    page = folder / "page.html"
    for _ in range(2):
        assert sdm("view", mesh, "--out", page, "--no-open", "--quiet")[0] == 0


def test_view_does_not_replace_a_file_of_the_case_that_it_reads(sdm, tmp_path):
    OpenFoam().write(block_with_body(8), tmp_path / "case")
    points = tmp_path / "case" / "constant" / "polyMesh" / "points"
    before = points.read_bytes()
    code, _, said = sdm("view", tmp_path / "case", "--out", points, "--no-open", "--quiet")
    assert (code, "this is the mesh that is read" in said) == (2, True)
    assert points.read_bytes() == before


def test_a_plan_replaces_an_earlier_plan_alone(mesh, sdm):
    folder = mesh.parent
    np.savez(folder / "mine.npz", x=np.arange(3))
    before = (folder / "mine.npz").read_bytes()
    words = ["deflect", mesh, *TURN, "--range=-5:5", "--no-mesh", "--plan"]
    code, _, said = sdm(*words, folder / "mine.npz")
    assert (code, "exists already, and only the file that out names, and an earlier plan" in said) == (2, True)
    assert (folder / "mine.npz").read_bytes() == before
    for _ in range(2):
        assert sdm(*words, folder / "plan.npz")[0] == 0


def test_a_run_does_not_replace_files_of_another_folder(sdm, tmp_path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "report.html").write_text("mine")
    code, _, said = sdm("run", "aileron", "--out", tmp_path / "thesis", "--quiet")
    assert (code, said.count("\n")) == (2, 1)
    assert "thesis holds report.html, and is no earlier run: name another folder" in said
    assert (tmp_path / "thesis" / "report.html").read_text() == "mine"


def test_doctor_removes_nothing_whose_name_is_not_ours(monkeypatch, tmp_path):
    monkeypatch.setattr(doctor.tempfile, "gettempdir", lambda: str(tmp_path))
    ours, theirs = tmp_path / ".sdm-deflect-aaaaaaaa.tmp", tmp_path / ".sdm-deflect-mythesis.tmp"
    for folder in (tmp_path / "victim", tmp_path / "exists", theirs):
        folder.mkdir()
        (folder / "thesis.tex").write_text("mine")
    (tmp_path / ".sdm-deflect-empty_00.tmp").mkdir()
    for folder in tmp_path.iterdir():
        os.utime(folder, (0, 0))
    for aside, name in (("victim", "exists"), ("../victim", ".."), ("victim/.old", "victim/"), ("victim", "victim")):
        ours.mkdir()
        (ours / ".lock").write_text("")
        (ours / ".note").write_text(json.dumps([(tmp_path / "victim").stat().st_ino, aside, name]))
        assert "victim" not in doctor.leftovers(tmp_path).text
        assert {folder.name for folder in tmp_path.iterdir()} == {"victim", "exists", theirs.name}
    assert all((tmp_path / name / "thesis.tex").exists() for name in ("victim", "exists", theirs.name))


def test_fields_of_a_case_are_those_of_one_plan(mesh, sdm, monkeypatch):
    """A command that ends between two files leaves no functions, without which no solver adds up the fields."""
    folder = mesh.parent
    OpenFoam().write(block_with_body(8), folder / "case")
    for end in (5, 9):
        plan = ["--no-mesh", "--plan", folder / f"p{end}.npz"]
        assert sdm("deflect", mesh, *TURN, f"--range=-{end}:{end}", *plan)[0] == 0
    words = "--format", "openfoam", "--out", folder / "case", "--quiet"
    assert sdm("export", folder / "p5.npz", *words)[0] == 0
    names = ("0/X0", "0/body.S", "0/body.V", "constant/sdmMotion")

    def content():
        return [path.read_bytes() if (path := folder / "case" / name).exists() else b"" for name in names]

    old = content()
    assert sdm("export", folder / "p9.npz", *words)[0] == 0
    new = content()
    assert old != new
    for count in range(8):
        assert sdm("export", folder / "p5.npz", *words)[0] == 0
        left, own = [count], files._flush

        def dies(path, left=left, own=own):
            own(path)
            left[0] -= not left[0] < 0 and path.is_dir()
            if left[0] < 0:
                raise OSError(5, "it ends here")

        with monkeypatch.context() as patch:
            patch.setattr(files, "_flush", dies)
            sdm("export", folder / "p9.npz", *words)
        now = content()
        assert now in (old, new) or now[-1] == b"", count
    assert not [path for path in (folder / "case").iterdir() if path.name.startswith(".sdm")]
