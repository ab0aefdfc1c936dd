"""What `sdm deflect` writes never overwrites what it reads, another of its files, or a file of somebody else."""

import os
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.run.mesh_files import OutputFiles, inputs_of, write_mesh, write_sensitivity
from sdm_deflect.meshing.formats.registry import FORMATS, read
from sdm_deflect.meshing.mesh.quality import quality_of
from tests.meshing.formats.examples import hybrid


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def targets(source, out, angles=(8.0,), sensitive=False):
    return OutputFiles.of(Path(source), Path(out) if out else None, [(angle,) for angle in angles], sensitive)


def test_names():
    many = targets("wing.su2", "out/flap.v2.cgns", (-12.0, 0.5, 1e-7), True)
    assert [str(many.mesh(pose)) for pose in many.poses] == [
        "out/flap.v2_-12.cgns", "out/flap.v2_+0.5.cgns", "out/flap.v2_+1e-07.cgns"
    ]  # fmt: skip
    assert [path.name for path in many.sensitivity((-12.0,))] == [
        "flap.v2_-12-sensitivity.npz", "flap.v2_-12-sensitivity.vtu"
    ]  # fmt: skip
    assert len(many.extra) == 6
    assert targets("wing.su2", None).mesh((8.0,)) == Path("wing-deflected.su2")


def test_names_of_cases(folder):
    for name in ("alpha-12.5", "alpha-12.5/constant/polyMesh", "run"):
        Path(name).mkdir(parents=True)
    Path("alpha-12.5/case.foam").touch()
    for source in ("alpha-12.5", "alpha-12.5/case.foam"):
        case = targets(source, None, (5.0, 10.0), True)
        assert case.mesh((5.0,)) == Path("alpha-12.5-deflected_+5")
        assert case.extra[0] == Path("alpha-12.5-deflected_+5-sensitivity.npz")
    assert targets("wing.su2", "new/case.foam").mesh((8.0,)) == Path("new")


@pytest.mark.parametrize("source", [".", "../case", "case.foam", "constant/.."])
def test_a_case_is_named_from_within(source, folder, monkeypatch):
    Path("case/constant").mkdir(parents=True)
    Path("case/case.foam").touch()
    monkeypatch.chdir("case")
    assert targets(source, None).mesh((8.0,)).resolve() == folder / "case-deflected"
    targets(source, None).check()


@pytest.mark.parametrize("out", ["", ".", ".."])
def test_a_folder_without_a_name_has_its_own(out, folder):
    Path("m.su2").touch()
    wanted = OutputFiles.of(Path("m.su2"), Path(out), ((1.0,),), sensitive=True)
    assert wanted.out == Path(out).resolve()
    with pytest.raises(InputError, match="exists already"):
        wanted.check()


def test_the_root_is_no_mesh():
    with pytest.raises(InputError, match="is no place for a mesh"):
        OutputFiles.of(Path("m.su2"), Path("/"), ((1.0,),))


def test_angles_that_differ_have_names_that_differ(folder):
    angles = (10.00001, 10.00002, 10.0, 1e-20)
    sweep = targets("wing.su2", "flap.su2", angles)
    sweep.check()
    assert len({sweep.mesh((angle,)) for angle in angles}) == 4


def test_the_source_is_never_a_target(folder):
    for name, out, angles, sensitive in (
        ("wing.su2", "wing.su2", (8.0,), False),
        ("wing_+5.su2", "wing.su2", (5.0, 10.0), False),
        ("n-sensitivity.vtu", "n.vtu", (5.0,), True),
    ):
        Path(name).write_text("mine")
        with pytest.raises(InputError, match=r"this is a file that is read; name another one in out"):
            targets(name, out, angles, sensitive).check()


def test_a_link_to_the_source_is_the_source(folder):
    Path("wing.su2").touch()
    Path("other.su2").symlink_to("wing.su2")
    with pytest.raises(InputError, match="this is a file that is read"):
        targets("wing.su2", "other.su2").check()


def test_files_that_settings_name_are_inputs(folder):
    for name in ("job.vtu", "held.txt", "box.toml"):
        Path(name).touch()
    given = {"config": Path("job.vtu"), "box": "box.toml", "surface": [{"held": "held.txt", "patches": ["flap"]}]}
    inputs = inputs_of(given, Path())
    assert inputs == (Path("job.vtu"), Path("box.toml"), Path("held.txt"))
    with pytest.raises(InputError, match=r"job\.vtu: this is a file that is read"):
        targets("wing.su2", "job.vtu").check(inputs)


def test_two_targets_of_one_name(folder):
    twice = OutputFiles(Path("w.su2"), Path("flap.vtu"), ((5.0,), (5.0,)), True)
    with pytest.raises(InputError, match=r"flap_\+5\.vtu would be written twice"):
        twice.check()


def test_files_of_others_stay(folder):
    for name in ("flap-sensitivity.npz", "flap-sensitivity.vtu", "flap_+5.su2"):
        Path(name).write_text('{"answer": 42}')
        angles = (5.0, 10.0) if "+5" in name else (8.0,)
        with pytest.raises(InputError, match=r"exists already, and only the file that out names.*choose another"):
            targets("wing.su2", "flap.su2", angles, True).check()
        Path(name).unlink()


def test_a_pipe_is_not_replaced(folder):
    os.mkfifo("flap.su2")
    with pytest.raises(InputError, match="exists already, and is a pipe or a device; delete it, or choose another"):
        targets("wing.su2", "flap.su2").check()


def test_earlier_files_are_replaced(folder):
    job = targets("wing.su2", "flap.su2", sensitive=True)
    mesh = hybrid()
    write_sensitivity(mesh, mesh.points, {"flap": np.ones_like(mesh.points)}, job.sensitivity((8.0,)), "m")
    job.out.write_text("an earlier mesh")
    job.check()


def test_folders(folder):
    Path("case/0").mkdir(parents=True)
    Path("wing.su2").mkdir()
    Path("empty").mkdir()
    Path("flap_+5/0").mkdir(parents=True)
    targets("case", "empty").check()
    for out, angles in (("case", (8.0,)), ("flap", (5.0, 10.0)), ("wing.su2", (8.0,)), ("/dev/null", (8.0,))):
        with pytest.raises(InputError, match="exists already"):
            targets("mesh.su2", out, angles).check()
    with pytest.raises(InputError, match="lies in the case that is read"):
        targets("case", "case/new").check()


def test_a_vtu_of_another_format_shows_displacement_and_quality(folder):
    mesh = hybrid()
    FORMATS["su2"].write(mesh, Path("wing.su2"))
    moved = mesh.points + np.array([0.0, 0.0, 0.25])
    with pytest.raises(ValueError, match=r"read it by registry\.read"):
        write_mesh(Path("wing.su2"), mesh, moved, Path("flap.vtu"))
    assert write_mesh(Path("wing.su2"), read("wing.su2"), moved, Path("flap.vtu")) == ()
    grid = pv.read("flap.vtu")
    np.testing.assert_array_equal(grid.points, moved)
    np.testing.assert_allclose(grid.point_data["displacement"], np.tile([0.0, 0.0, 0.25], (14, 1)), atol=1e-15)
    quality = np.concatenate([quality_of(moved, block) for block in mesh.cells])
    np.testing.assert_array_equal(grid.cell_data["quality"], [*quality, *np.zeros(18)])
