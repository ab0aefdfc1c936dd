"""What `sdm deflect` writes never overwrites what it reads, another of its files, or a file of somebody else."""

import json
from pathlib import Path

import numpy as np
import pytest
from sdm_deflect.cases.own.files import Targets, inputs_of, write_report, write_sensitivity

from sdm_deflect.cases.errors import InputError
from tests.meshing.formats.examples import hybrid

BOTH = frozenset({"sensitivity", "json"})


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def targets(source, out, angles=(8.0,), extras=()):
    return Targets.of(Path(source), Path(out) if out else None, angles, frozenset(extras))


def test_names():
    many = targets("wing.su2", "out/flap.v2.cgns", (-12.0, 0.5, 1e-7), BOTH)
    assert [str(many.mesh(angle)) for angle in many.angles] == [
        "out/flap.v2_-12.cgns", "out/flap.v2_+0.5.cgns", "out/flap.v2_+1e-07.cgns"
    ]  # fmt: skip
    assert [path.name for path in many.sensitivity(-12.0)] == [
        "flap.v2_-12-sensitivity.npz", "flap.v2_-12-sensitivity.vtu"
    ]  # fmt: skip
    assert many.report.name == "flap.v2.json"
    assert len(many.extra) == 7
    assert targets("wing.su2", None).mesh(8.0) == Path("wing-deflected.su2")


def test_names_of_cases(folder):
    for name in ("alpha-12.5", "alpha-12.5/constant/polyMesh", "run"):
        Path(name).mkdir(parents=True)
    Path("alpha-12.5/case.foam").touch()
    for source in ("alpha-12.5", "alpha-12.5/case.foam"):
        case = targets(source, None, (5.0, 10.0), BOTH)
        assert case.mesh(5.0) == Path("alpha-12.5-deflected_+5")
        assert case.report == Path("alpha-12.5-deflected.json")
    assert targets("wing.su2", "new/case.foam").mesh(8.0) == Path("new")


@pytest.mark.parametrize("source", [".", "../case", "case.foam", "constant/.."])
def test_a_case_is_named_from_within(source, folder, monkeypatch):
    Path("case/constant").mkdir(parents=True)
    Path("case/case.foam").touch()
    monkeypatch.chdir("case")
    assert targets(source, None).mesh(8.0).resolve() == folder / "case-deflected"
    targets(source, None).check()


def test_angles_that_differ_have_names_that_differ(folder):
    angles = (10.00001, 10.00002, 10.0, 1e-20)
    sweep = targets("wing.su2", "flap.su2", angles)
    sweep.check()
    assert len({sweep.mesh(angle) for angle in angles}) == 4


def test_the_source_is_never_a_target(folder):
    for name, out, angles, extras in (
        ("wing.su2", "wing.su2", (8.0,), ()),
        ("wing_+5.su2", "wing.su2", (5.0, 10.0), ()),
        ("n-sensitivity.vtu", "n.vtu", (5.0,), {"sensitivity"}),
    ):
        Path(name).write_text("mine")
        with pytest.raises(InputError, match=r"this is a file that is read; name another one in out"):
            targets(name, out, angles, extras).check()


def test_a_link_to_the_source_is_the_source(folder):
    Path("wing.su2").touch()
    Path("other.su2").symlink_to("wing.su2")
    with pytest.raises(InputError, match="this is a file that is read"):
        targets("wing.su2", "other.su2").check()


def test_files_that_settings_name_are_inputs(folder):
    for name in ("job.json", "held.txt", "box.toml"):
        Path(name).touch()
    given = {"config": Path("job.json"), "box": "box.toml", "surface": [{"held": "held.txt", "patches": ["flap"]}]}
    inputs = inputs_of(given, Path())
    assert inputs == (Path("job.json"), Path("box.toml"), Path("held.txt"))
    with pytest.raises(InputError, match=r"job\.json: this is a file that is read"):
        targets("wing.su2", "job.su2", extras={"json"}).check(inputs)


def test_two_targets_of_one_name(folder):
    twice = Targets(Path("w.su2"), Path("flap.vtu"), (5.0, 5.0), BOTH)
    with pytest.raises(InputError, match=r"flap_\+5\.vtu would be written twice"):
        twice.check()


def test_files_of_others_stay(folder):
    for name in ("flap.json", "flap-sensitivity.npz", "flap-sensitivity.vtu", "flap_+5.su2"):
        Path(name).write_text('{"answer": 42}')
        angles = (5.0, 10.0) if "+5" in name else (8.0,)
        with pytest.raises(InputError, match=r"exists already, and only the file that out names.*choose another"):
            targets("wing.su2", "flap.su2", angles, BOTH).check()
        Path(name).unlink()


def test_earlier_files_are_replaced(folder):
    job = targets("wing.su2", "flap.su2", extras=BOTH)
    mesh = hybrid()
    write_sensitivity(mesh, mesh.points, np.ones_like(mesh.points), job.sensitivity(8.0), "m")
    write_report({"mesh": {}, "angles": [], "files": [], "passed": True}, job.report)
    job.out.write_text("an earlier mesh")
    job.check()
    assert json.loads(job.report.read_text())["passed"]


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
