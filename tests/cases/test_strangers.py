"""Folders that came from elsewhere, and meshes that are nobody else's to read."""

import json
import os
import stat
from pathlib import Path
from zlib import crc32

import pytest

from sdm_deflect import deflect, read
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.meshing.formats.wing import wing

TURN = (
    "--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion", "blended", "--repair", "off",
    "--hinge", "0.7,0.3,0", "0.7,0.7,0", "--angle", "5", "--quiet",
)  # fmt: skip
COMMANDS = (
    ("quality", "wing.su2"),
    ("deflect", "wing.su2", *TURN, "--dry-run"),
    ("deflect", "wing.su2", *TURN, "--no-report"),
    ("validate", "."),
    ("report", "."),
    ("view", "."),
    ("compare", ".", "."),
)


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_nothing_follows_from_a_folder_of_a_stranger(sdm, tmp_path, monkeypatch):
    """Beside the mesh lies what looks like the folder of a killed command of this very machine, with a journal."""
    home, case = tmp_path / "home", tmp_path / "stranger"
    machine = crc32(f"{os.uname().nodename} {Path('/proc/self/ns/pid').readlink()}".encode())
    left, plain = case / f".sdm-{machine:08x}-4194303-1-abcdefgh", case / ".sdm-0123456789abcdef"
    for folder in (home, left / "empty", plain):
        folder.mkdir(parents=True)
    (home / "bashrc").write_text("mine")
    (home / "thesis.tex").write_text("mine")
    (plain / "wing.su2").write_text("staged")
    (left / "payload").write_text("theirs")
    rows = [
        {"staged": "payload", "target": str(home / "bashrc"), "stale": []},
        {"staged": "empty", "target": ".", "stale": [str(home / "thesis.tex")]},
    ]
    rows = [row | {"inode": (left / row["staged"]).stat().st_ino} for row in rows]
    (left / "journal.json").write_text(json.dumps(rows))
    FORMATS["su2"].write(wing(cells=3).mesh, case / "wing.su2")
    before = content(tmp_path)
    monkeypatch.chdir(case)
    done = [sdm(*words)[0] for words in COMMANDS]
    assert done == [0, 0, 0, 2, 2, 2, 2]
    (case / "wing-deflected.su2").unlink()
    assert content(tmp_path) == before
    assert (left / "empty").is_dir()


def modes(folder: Path) -> dict[str, str]:
    return {path.name: f"{stat.S_IMODE(path.stat().st_mode):o}" for path in folder.rglob("*")}


def test_what_is_written_of_a_private_mesh_is_private(sdm, tmp_path):
    source, out = tmp_path / "wing.su2", tmp_path / "out"
    FORMATS["su2"].write(wing(cells=3).mesh, source)
    source.chmod(0o600)
    code, _, said = sdm("deflect", source, *TURN, "--report", "--sensitivity", "--out", out / "w.su2")
    assert code == 0, said
    found = modes(out)
    assert {"w.su2", "report.html", "w-sensitivity.npz"} < found.keys()
    assert {found.pop("w-report"), found.pop("figures")} == {"700"}
    assert set(found.values()) == {"600"}


@pytest.mark.parametrize(
    ("form", "mode", "file", "folder"), [("su2", 0o600, "600", "700"), ("openfoam", 0o640, "640", "750")]
)
def test_a_private_mesh_stays_private_in_every_format(form, mode, file, folder, tmp_path):
    source, out = tmp_path / {"su2": "wing.su2", "openfoam": "case"}[form], tmp_path / "out"
    FORMATS[form].write(wing(cells=3).mesh, source)
    (source / "constant" / "polyMesh" / "points" if source.is_dir() else source).chmod(mode)
    hinge = {"fixed": "wing_*", "slide": {"symmetry": "plane"}, "hinge": ((0.7, 0.3, 0), (0.7, 0.7, 0))}
    found = deflect(read(source), "flap_*", angle=3, motion="blended", repair="off", **hinge)
    for name in ("w.vtu", "w.cgns", "w.su2", "copy"):
        found.save(out / name)
    paths = list(out.rglob("*"))
    assert {modes(out)[path.name] for path in paths if path.is_file()} == {file}
    assert {modes(out)[path.name] for path in paths if path.is_dir()} == {folder}
