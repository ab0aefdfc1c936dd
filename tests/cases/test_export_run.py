"""Exported runs hold the run's mesh, by name, in every format; nothing of the run changes."""

import subprocess
import sys

import numpy as np
import pytest
from click import BadParameter

from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.run.export import export_run
from sdm_deflect.deform.mesh.cells import Polyhedra
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.known import written
from sdm_deflect.meshing.formats.openfoam import MESH
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.formats.vtu import write_vtu
from sdm_deflect.meshing.mesh import Skin, tetrahedral
from tests.calls import files_of_at_most

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
    folder = tmp_path / "aileron"
    folder.mkdir()
    write_vtu(folder / "undeflected.vtu", cube())
    write_vtu(folder / "deflected.vtu", cube(np.pi), {"displacement": np.full((8, 3), np.pi)})
    return folder


@pytest.mark.parametrize("which", ["deflected", "undeflected"])
@pytest.mark.parametrize("form", written())
def test_every_format_holds_the_mesh(run, form, which):
    before = {path: path.read_bytes() for path in run.iterdir()}
    out, lost = export_run(run, form, which)
    assert [line for line in lost if "check them" not in line] == []
    assert len(lost) == (form == "ugrid")  # conditions in its .mapbc are guessed from names
    assert out.parent == run.parent
    mesh = FORMATS[form].read(out)
    np.testing.assert_array_equal(mesh.points, cube(np.pi if which == "deflected" else 0.0).points)
    assert {patch.name: len(patch) for patch in mesh.patches} == {name: len(rows) for name, rows in SIDES.items()}
    assert sum(len(block) for block in mesh.cells) == len(TETS)
    assert {path: path.read_bytes() for path in run.iterdir()} == before


def test_an_overset_pair_is_one_cgns_file_of_two_zones(run, tmp_path):
    write_vtu(run / "background.vtu", cube(-1.0, 5.0))
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
        export_run(run, "vtu", out=run / "deflected.vtu")
    with pytest.raises(InputError, match=r"it has no deflected\.vtu"):
        export_run(tmp_path, "su2")
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "mine").touch()
    with pytest.raises(MeshFileError, match="exists already"):
        export_run(run, "openfoam", out=tmp_path / "case")
    (run / "deflected.vtu").write_bytes((run / "deflected.vtu").read_bytes()[:900])
    with pytest.raises(MeshFileError, match="damaged"):
        export_run(run, "openfoam", out=tmp_path / "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["aileron", "case"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--format", "stl"], "'stl' is not one of 'cgns', 'gmsh', 'openfoam', 'su2', 'tau', 'ugrid', 'vtu'"),
        (["--format", "su2", "--which", "bent"], "'bent' is not one of 'deflected', 'undeflected'"),
    ],
)
def test_words_that_are_not_known_are_named(run, words, said):
    with pytest.raises(BadParameter, match=said):
        cli.main(["export", str(run), *words], standalone_mode=False)
    with pytest.raises(InputError, match=r"^--to-solver: in a clone, `python -m studies case MESH OUT` writes"):
        cli.main(["export", str(run), "--to-solver", "su2"], standalone_mode=False)


def test_a_mistake_is_one_line(run):
    words = ["export", str(run), "--format", "su2", "--out", "/proc/none/mesh.su2"]
    done = subprocess.run([sys.executable, "-m", "sdm_deflect", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "/proc/none/mesh.su2: cannot be written" in done.stderr


def test_the_command_says_what_it_wrote(run):
    words = [sys.executable, "-m", "sdm_deflect", "export", str(run), "--format", "gmsh"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(run.parent / "aileron-deflected.msh")


def test_a_full_disk_names_the_case_to_be(run, tmp_path):
    """A limit of the size of files stands for the disk."""
    with files_of_at_most(100), pytest.raises(MeshFileError, match=rf"^{tmp_path / 'case'}: cannot be written: "):
        export_run(run, "openfoam", out=tmp_path / "case")
    assert not (tmp_path / "case").exists()
