"""Exported runs hold the run's mesh, by name, in every format; nothing of the run changes."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from click import BadParameter

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.finished import export_run
from sdm_deflect.meshing.formats.openfoam import MESH
from sdm_deflect.meshing.formats.registration import writable
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Polyhedra
from sdm_deflect.meshing.mesh.labelled import Skin, tetrahedral
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.calls import files_of_at_most
from tests.deform.blocks import block_with_body

CORNERS = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
TETS = np.array([[0, 1, 2, 4], [1, 3, 2, 7], [4, 6, 7, 2], [4, 7, 5, 1], [1, 2, 4, 7]])
SIDES = {
    "wing_left": [[0, 2, 1], [1, 2, 3]], "far_field": [[4, 5, 7], [4, 7, 6]],
    "fuselage": [[0, 1, 4], [1, 5, 4], [2, 6, 7], [2, 7, 3], [0, 4, 2], [2, 4, 6], [1, 3, 7], [1, 7, 5]],
}  # fmt: skip


def cube(shift: float = 0.0, scale: float = 1.0) -> Mesh:
    triangles = np.array([row for rows in SIDES.values() for row in rows])
    patch = np.repeat(np.arange(3), [len(rows) for rows in SIDES.values()])
    return tetrahedral(CORNERS * scale + shift, TETS, Skin(triangles, patch, np.full(len(patch), -1)), tuple(SIDES))


@pytest.fixture
def run(tmp_path):
    """What a finished run has for an export: a mesh, and where it was brought."""
    folder = tmp_path / "aileron"
    folder.mkdir()
    (folder / "deflected.vtu").touch()
    return SimpleNamespace(folder=folder, plan=SimpleNamespace(mesh=cube()), points=cube(np.pi).points, validation=None)


@pytest.fixture
def finished(sdm, tmp_path):
    """The folder beside a mesh that was deflected."""
    FORMATS["su2"].write(block_with_body(), tmp_path / "block.su2")
    words = ["--surface", "body", "--hinge", "0,-0.5,0", "0,0.5,0", "--angle", "5"]
    assert sdm("deflect", tmp_path / "block.su2", *words)[0] == 0
    return tmp_path / "block-deflected-report"


@pytest.mark.parametrize("which", ["deflected", "undeflected"])
@pytest.mark.parametrize("form", writable())
def test_every_format_holds_the_mesh(run, form, which):
    out, lost = export_run(run, form, which)
    assert [line for line in lost if "check them" not in line] == []
    assert len(lost) == (form == "ugrid")  # conditions in its .mapbc are guessed from names
    assert out.parent == run.folder.parent
    mesh = FORMATS[form].read(out)
    np.testing.assert_array_equal(mesh.points, cube(np.pi if which == "deflected" else 0.0).points)
    assert {patch.name: len(patch) for patch in mesh.patches} == {name: len(rows) for name, rows in SIDES.items()}
    assert sum(len(block) for block in mesh.cells) == len(TETS)


def test_an_overset_pair_is_one_cgns_file_of_two_zones(run, tmp_path):
    run.validation = SimpleNamespace(background=cube(-1.0, 5.0))
    out, _ = export_run(run, "cgns", out=tmp_path / "pair.cgns")
    mesh = FORMATS["cgns"].read(out)
    assert [(zone.name, zone.start, zone.stop) for zone in mesh.zones] == [("block", 0, 8), ("background", 8, 16)]
    assert {patch.name for patch in mesh.patches} == {f"{z}/{name}" for z in ("block", "background") for name in SIDES}
    out, _ = export_run(run, "su2", out=tmp_path / "block.su2")
    assert len(FORMATS["su2"].read(out).points) == 8


def test_the_openfoam_case_has_all_it_needs(run, tmp_path):
    case, _ = export_run(run, "openfoam", out=tmp_path / "case")
    files = {str(path.relative_to(case)) for path in case.rglob("*") if path.is_file()}
    assert files == {
        "case.foam", "system/controlDict", "system/fvSchemes", "system/fvSolution",
        *(str(MESH / name) for name in ("points", "faces", "owner", "neighbour", "boundary")),
    }  # fmt: skip
    assert isinstance(FORMATS["openfoam"].read(case).cells[0], Polyhedra)


def test_nothing_is_overwritten_and_nothing_is_left_behind(run, tmp_path):
    with pytest.raises(InputError, match="is a file of the run"):
        export_run(run, "vtu", out=run.folder / "deflected.vtu")
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "mine").touch()
    with pytest.raises(MeshFileError, match="exists already"):
        export_run(run, "openfoam", out=tmp_path / "case")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["aileron", "case"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--format", "stl"], "'stl' is not one of 'cgns', 'gmsh', 'openfoam', 'su2', 'tau', 'ugrid', 'vtu'"),
        (["--format", "su2", "--which", "bent"], "'bent' is not one of 'deflected', 'undeflected'"),
    ],
)
def test_words_that_are_not_known_are_named(tmp_path, words, said):
    with pytest.raises(BadParameter, match=said):
        cli.main(["export", str(tmp_path), *words], standalone_mode=False)


def test_a_mistake_is_one_line(finished):
    words = ["export", str(finished), "--format", "su2", "--out", "/proc/none/mesh.su2"]
    done = subprocess.run([sys.executable, "-m", "sdm_deflect", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "/proc/none/mesh.su2: cannot be written" in done.stderr


@pytest.mark.parametrize("which", ["deflected", "undeflected"])
def test_the_command_says_what_it_wrote(finished, which, sdm):
    before = {path: path.read_bytes() for path in finished.iterdir() if path.is_file()}
    code, text, _ = sdm("export", finished, "--format", "cgns", "--which", which, "--quiet")
    out = finished.with_name(f"{finished.name}-{which}.cgns")
    assert (code, text.strip()) == (0, str(out))
    source = finished.with_name("block-deflected.su2" if which == "deflected" else "block.su2")
    np.testing.assert_array_equal(FORMATS["cgns"].read(out).points, FORMATS["su2"].read(source).points)
    assert {path: path.read_bytes() for path in finished.iterdir() if path.is_file()} == before


def test_a_full_disk_names_the_case_to_be(run, tmp_path):
    """A limit of the size of files stands for the disk."""
    with files_of_at_most(100), pytest.raises(MeshFileError, match=rf"^{tmp_path / 'case'}: cannot be written: "):
        export_run(run, "openfoam", out=tmp_path / "case")
    assert not (tmp_path / "case").exists()
