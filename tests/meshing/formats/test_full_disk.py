"""A disk that fills up: an error that names the file to be, and the file that was there stays.

A limit of the size of files stands for the full disk; each format is tried in a process of its own, because libraries
in C crash on such disks.
"""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.formats.registration import writable
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.formats.vtu import write_vtu
from sdm_deflect.meshing.mesh.labelled import Skin, tetrahedral
from tests.calls import files_of_at_most
from tests.meshing.formats import fluent_files, plot3d_files
from tests.meshing.formats.examples import hybrid

# Of the size of the largest file that is written, what the limit lets pass.
SHARES = (0.02, 0.3, 0.6, 0.9, 0.99)


def test_writing_beyond_the_limit_fails_instead_of_ending_the_process():
    code = "import signal; print(signal.getsignal(signal.SIGXFSZ) is signal.SIG_IGN)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout == b"True\n"


@pytest.mark.parametrize("form", [*writable(), "fluent", "plot3d", "tets", "arrays"])
def test_a_full_disk_is_an_error_that_names_the_file_and_keeps_the_old_one(form, tmp_path, capfd):
    out, tasks = work(form, tmp_path)
    for task in tasks:
        task()
        whole = max(path.stat().st_size for path in [out, *out.rglob("*")] if path.is_file())
        if out.is_dir():
            shutil.rmtree(out)
        else:
            out.write_bytes(b"what was there")
        before = content(tmp_path)
        for share in SHARES:
            with (
                files_of_at_most(int(share * whole)),
                pytest.raises(MeshFileError, match=rf"^{out}: cannot be written: "),
            ):
                task()
            assert content(tmp_path) == before
    assert capfd.readouterr().err == ""


def work(form: str, folder: Path):
    """The file to write, and what writes it."""
    mesh = hybrid()
    if form == "tets":
        return folder / "out.vtu", [lambda: write_vtu(folder / "out.vtu", cube())]
    if form == "arrays":
        rates = {"rates": np.random.default_rng(0).random((14, 3))}
        return folder / "out.vtu", [lambda: write_vtu(folder / "out.vtu", mesh, rates)]
    known = FORMATS[form]
    suffix = "" if form == "openfoam" else known.suffixes[0]
    source, out = folder / f"source{suffix}", folder / f"out{suffix}"
    rewrite = [lambda: known.rewrite(source, mesh.points * np.pi, out)]
    if form == "fluent":
        fluent_files.written(mesh, source)
        return out, rewrite
    if form == "plot3d":
        plot3d_files.written(source, [plot3d_files.box()])
        return out, [lambda: known.rewrite(source, known.read(source).points * np.pi, out)]
    known.write(mesh, source)
    return out, [lambda: known.write(mesh, out), *rewrite]


def content(folder: Path) -> dict[Path, bytes]:
    """All files in a folder."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def cube():
    """A cube of tetrahedra with two patches."""
    corners = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    tets = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])
    faces = np.array([[0, 2, 3], [4, 5, 7]])
    return tetrahedral(corners, tets, Skin(faces, np.array([0, 1]), np.array([0, -1])), ("floor", "roof"))
