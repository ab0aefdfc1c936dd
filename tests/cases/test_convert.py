"""`sdm convert`: a mesh in another format, with its nodes, cells and patches."""

import json
import re

import numpy as np
import pytest

import sdm_deflect as sd
from sdm_deflect.meshing.formats.registration import writable
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.deform.blocks import block_with_body
from tests.deform.plates import plate
from tests.deform.sheets import with_sheet
from tests.meshing.formats.examples import hybrid


def cells_of(mesh):
    return {cells.shape: len(cells) for cells in mesh.cells}


@pytest.mark.parametrize("name", writable())
def test_to_every_format_and_back(name, tmp_path, sdm):
    FORMATS["su2"].write(hybrid(), tmp_path / "mesh.su2")
    mesh = sd.read(tmp_path / "mesh.su2")
    there = tmp_path / ("case" if name == "openfoam" else f"there{FORMATS[name].suffixes[0]}")
    code, out, err = sdm("convert", tmp_path / "mesh.su2", there, "--json")
    assert code == 0, err
    found, told = sd.read(there), json.loads(out)
    assert {patch.name: len(patch) for patch in found.patches} == {patch.name: len(patch) for patch in mesh.patches}
    assert (told["points"], told["cells"]) == (14, 7)
    assert set(told["patches"]) == set(mesh.names)
    code, out, err = sdm("convert", there, tmp_path / "back.su2", "--quiet")
    assert code == 0, err
    assert out.splitlines()[-1].startswith(f"wrote {tmp_path / 'back.su2'}: 14 points, 7 cells, patches ")
    back = sd.read(tmp_path / "back.su2")
    assert {tuple(point) for point in back.points} == {tuple(point) for point in mesh.points}
    assert sum(back.cell_counts) == 7


def test_a_plane_mesh_stays_plane(tmp_path, sdm):
    FORMATS["su2"].write(plate(), tmp_path / "plate.su2")
    assert sdm("convert", tmp_path / "plate.su2", tmp_path / "plate.msh")[0] == 0
    found = sd.read(tmp_path / "plate.msh")
    assert found.plane
    assert cells_of(found) == cells_of(plate())


def test_what_a_format_cannot_hold_is_said(tmp_path, sdm):
    """UGRID has no conditions of boundaries; the file beside it tells those that the names suggest."""
    FORMATS["cgns"].write(hybrid(), tmp_path / "mesh.cgns")
    code, out, _ = sdm("convert", tmp_path / "mesh.cgns", tmp_path / "mesh.b8.ugrid")
    assert code == 0
    assert "lost in this format: mesh.mapbc tells boundary conditions by the names of patches alone" in out


def test_digits_that_a_file_of_32_bits_cannot_hold_are_said(tmp_path, sdm):
    mesh = hybrid()
    FORMATS["su2"].write(mesh.with_points(mesh.points / 3.0), tmp_path / "mesh.su2")
    code, out, _ = sdm("convert", tmp_path / "mesh.su2", tmp_path / "there.b4.ugrid")
    assert code == 0
    assert re.search(r"lost in this format: digits of coordinates, .* to 32 bits by up to [\d.]+e-\d\d", out)
    found = sd.read(tmp_path / "there.b4.ugrid").points
    third = (mesh.points / 3.0).astype(np.float32).astype(np.float64)
    assert {tuple(point) for point in found} == {tuple(point) for point in third}
    code, out, _ = sdm("convert", tmp_path / "there.b4.ugrid", tmp_path / "back.su2")
    assert (code, "rounded" in out) == (0, False)
    assert {tuple(point) for point in sd.read(tmp_path / "back.su2").points} == {tuple(point) for point in third}


def _unchanged(path):
    """Return what only writing changes; the time of the last reading is not part of it."""
    found = path.lstat()
    return found.st_mode, found.st_ino, found.st_size, found.st_mtime_ns


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ("mesh.su2", "exists already"),
        ("link.su2", "exists already"),
        ("taken", "exists already"),
        ("notes.txt", "no mesh format has the suffix '.txt'"),
        ("wing.stl", "no mesh format has the suffix '.stl'"),
    ],
)
def test_nothing_is_replaced(target, said, tmp_path, sdm):
    FORMATS["su2"].write(hybrid(), tmp_path / "mesh.su2")
    (tmp_path / "link.su2").symlink_to("mesh.su2")
    (tmp_path / "taken").mkdir()
    before = {path: _unchanged(path) for path in tmp_path.iterdir()}
    code, _, err = sdm("convert", tmp_path / "mesh.su2", tmp_path / target)
    assert (code, said in " ".join(err.split())) == (2, True)
    assert {path: _unchanged(path) for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("suffix", [".cgns", ".su2", ".msh"])
def test_a_patch_between_cells_is_written_again(suffix, tmp_path, sdm):
    mesh = with_sheet(block_with_body(8), lambda centres: np.abs(np.abs(centres).max(axis=1) - 1.0) < 1e-9)
    FORMATS["su2"].write(mesh, tmp_path / "wake.su2")
    assert sdm("convert", tmp_path / "wake.su2", tmp_path / f"there{suffix}")[0] == 0
    found = sd.read(tmp_path / f"there{suffix}")
    assert len(found["wake"]) == len(mesh.patch("wake"))
