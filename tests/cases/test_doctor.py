"""What ails a machine is found, named, and something helps."""

import json
import re
import stat
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

from sdm_deflect.cases.cli import examination as doctor
from sdm_deflect.cases.cli.console import findings
from sdm_deflect.cases.run.output import EXTRAS, missing


def test_readme_and_doctor_ask_for_the_same_packages():
    assert doctor.PACKAGES in Path(__file__).parents[2].joinpath("README.md").read_text(encoding="utf-8")


def test_missing_library_is_named(monkeypatch):
    monkeypatch.setattr(doctor, "versions", lambda names: dict.fromkeys(names, "2.0") | {"scipy": ""})
    found = doctor.libraries()
    assert not found.well
    assert "scipy missing" in found.text
    assert found.remedy == "pip install scipy"


def test_every_module_that_may_be_missing_is_of_its_extra():
    project = tomllib.loads(Path(__file__).parents[2].joinpath("pyproject.toml").read_text("utf-8"))["project"]
    wanted = {
        extra: {re.split(r"[<>=\[]", line)[0] for line in lines}
        for extra, lines in project["optional-dependencies"].items()
    }
    brought = packages_distributions()
    for extra, modules in EXTRAS.items():
        for module in modules:
            names = {name.lower() for name in brought[module]}
            others = {"dask"}  # come with those that are named
            assert names & wanted[extra] or module in others, (extra, module)


def test_a_missing_module_is_one_sentence_that_says_what_brings_it():
    assert missing(ModuleNotFoundError("", name="dask.array")) == (
        "this needs dask, which is not installed: in your clone, pip install '.[cluster]'"
    )
    assert missing(ModuleNotFoundError("", name="numpyy")) == ""


def test_a_command_without_its_extra_ends_with_that_sentence(monkeypatch, sdm):
    monkeypatch.setattr("sdm_deflect.cases.run.output.find_spec", lambda name: None)
    code, _, complaint = sdm("view", "nowhere.su2")
    assert code == 2
    assert "pip install '.[report]'" in complaint


def test_an_extra_that_is_not_installed_is_no_fault(monkeypatch):
    for module in ("sdm_deflect.cases.run.output", "sdm_deflect.cases.cli.examination"):
        monkeypatch.setattr(f"{module}.find_spec", lambda name: None)
    assert doctor.extras().well
    assert "work by others (--workers, --scheduler) needs cryptography, dask, distributed" in doctor.extras().text
    assert doctor.compiled_libraries().well


def test_library_that_cannot_be_loaded_says_why(monkeypatch, tmp_path):
    (tmp_path / "broken_library.py").write_text("raise ImportError('libGL.so.1: cannot open shared object file')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    assert doctor.import_complaint("json") == ""
    monkeypatch.setattr(doctor, "COMPILED", ("json", "broken_library", "no_such_library"))
    found = doctor.compiled_libraries()
    assert not found.well
    assert "broken_library: ImportError: libGL.so.1" in found.text
    assert "no_such_library" not in found.text
    assert "json" not in found.text
    assert "apt-get install" in found.remedy


def test_damaged_mesh_in_the_cache_is_found(monkeypatch, tmp_path):
    monkeypatch.setenv("SDM_DEFLECT_CACHE", str(tmp_path / "cache"))
    assert doctor.cache().well
    (tmp_path / "cache" / "0123.npz").write_bytes(bytes(1000))
    found = doctor.cache()
    assert not found.well
    assert "1 damaged" in found.text
    assert str(tmp_path / "cache" / "0123.npz") in found.remedy


def test_cache_that_cannot_be_written_is_found(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("SDM_DEFLECT_CACHE", str(tmp_path / "file"))
    found = doctor.cache()
    assert not found.well
    assert "SDM_DEFLECT_CACHE" in found.remedy


def test_the_place_of_compiled_code_is_told_and_others_may_not_write_there(monkeypatch, tmp_path):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("SDM_DEFLECT_CACHE", str(tmp_path))
    assert doctor.compiled_code() == doctor.Finding("compiled code", True, f"kept in {tmp_path / 'numba'}")
    assert stat.S_IMODE((tmp_path / "numba").stat().st_mode) == 0o700
    (tmp_path / "numba").chmod(0o770)
    found = doctor.compiled_code()
    assert not found.well
    assert "other users can write there" in found.text
    assert "NUMBA_CACHE_DIR" in found.remedy
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    assert doctor.compiled_code().well
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/dev/null/folder")
    assert "Not a directory" in doctor.compiled_code().text


def test_command_prints_and_fails_when_something_is_not_well(monkeypatch, capsys):
    from click.testing import CliRunner

    from sdm_deflect.cases.cli.commands import cli

    ill = doctor.Finding("cache", False, "a [bold]file[/bold]", "rm it")
    monkeypatch.setattr(doctor, "EXAMINATIONS", (lambda: ill,))
    answer = CliRunner().invoke(cli, ["doctor", "--json"], standalone_mode=False)
    assert answer.return_value == 1
    shown, leftovers = json.loads(answer.stdout)
    assert shown == {"name": "cache", "well": False, "text": ill.text, "remedy": "rm it"}
    assert leftovers["name"] == "leftovers"
    answer = CliRunner().invoke(cli, ["doctor"], standalone_mode=False)
    assert "[bold]file[/bold]" in answer.output
    assert "NOT WELL" in answer.output
    assert "rm it" in answer.output
    assert len(findings([ill]).renderables) == 2
