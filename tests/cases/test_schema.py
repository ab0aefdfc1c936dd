"""A setting is written in one place: its option, its keyword, its documentation and the guide's line are made of it."""

import subprocess
import sys
from dataclasses import dataclass
from tomllib import loads
from typing import Annotated

import pytest
from click.testing import CliRunner

import sdm_deflect
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.schema import GROUPS, Doc, Range, Spelling, check_settings, describe, settings_in
from sdm_deflect.cases.aircraft.registry import resolve
from sdm_deflect.cases.api import Options
from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.cases.cli.options import TOPICS, DeflectCommand, flag, settings_options
from sdm_deflect.cases.settings.conversion import structure, table_of, to_toml
from sdm_deflect.cases.settings.job_settings import BY_NAME, IN_PYTHON, JobSettings, job_settings, read_job
from tests.derived import GUIDE, KEYWORDS, ROOT, guide, keywords

MISSPELT = """
import sdm_deflect
sdm_deflect.deflect("a.su2", "flap", [[0, 0, 0], [0, 1, 0]], 5.0, fixed="wing", tolerence=1e-5)
sdm_deflect.sweep("a.su2", "flap", [[0, 0, 0], [0, 1, 0]], "1:2:1", slide={"symmetry": "plane"}, steps=3)
sdm_deflect.plan("a.su2", "flap", [[0, 0, 0], [0, 1, 0]], 5.0, strategy="both")
sdm_deflect.deflect("a.su2", "flap", motion="blended", held=[1, 2], box=[[0, 0, 0], [1, 1, 1]], kernel="mq")
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class More(JobSettings):
    """The settings of a job, and one that is nowhere else."""

    smooth_share: Annotated[float, Doc("Accuracy", "How smooth.", "Of `strip`."), Range(0.0, 1.0)] = 0.5

    def __post_init__(self) -> None:
        check_settings(self)


def test_what_is_written_of_the_schema_is_as_it_is_made():
    assert KEYWORDS.read_text(encoding="utf-8") == keywords(BY_NAME.values())
    assert GUIDE.read_text(encoding="utf-8") == guide(BY_NAME.values())


def test_a_setting_is_added_in_one_place():
    settings = settings_in(More).values()
    value = structure({"smooth_share": 0.25, "n_add": 7}, More)
    assert (value.smooth_share, value.fitting.n_add) == (0.25, 7)
    assert structure(loads(to_toml(value)), More) == value
    with pytest.raises(InputError, match=r"unknown setting smooth_shar; did you mean smooth_share\?"):
        structure({"smooth_shar": 0.25}, More)
    with pytest.raises(InputError, match="smooth_share = 2 must be a number from 0 to 1"):
        structure({"smooth_share": 2}, More)
    text = CliRunner().invoke(DeflectCommand("deflect", params=settings_options(settings)), ["--help"]).output
    assert "--smooth-share FLOAT" in text
    assert "How smooth (default: 0.5)." in text
    assert "    smooth_share: float\n" in keywords(settings)
    assert "- `smooth_share`: How smooth. Of `strip`. Default: ``0.5``." in describe(list(settings), "")
    line = "| `smooth_share` | `--smooth-share` | a number from 0 to 1 | `0.5` | How smooth. Of `strip`. |"
    assert line in guide(settings)


def test_every_setting_is_described_in_python():
    for name, setting in BY_NAME.items():
        doc = setting.note(Doc)
        assert doc.group in GROUPS
        assert (
            name in IN_PYTHON
            or name in ("hinge", "angle")
            or f"`{name}`: {doc.text[:30]}" in sdm_deflect.deflect.__doc__
        )
    assert set(Options.__annotations__) == BY_NAME.keys() - IN_PYTHON.keys() - {"hinge", "angle"}


def test_help_is_in_groups_of_80_columns():
    lines = CliRunner().invoke(cli, ["deflect", "--help"], terminal_width=80).output.splitlines()
    titles = [line.removesuffix(":") for line in lines if line and line[0] != " " and line.endswith(":")]
    assert titles == ["Basic", "What moves", "What stays", "Box", "Repair", "Accuracy", "Output", "Options"]
    assert max(map(len, lines)) <= 80


def test_every_word_is_in_the_help_or_under_a_topic():
    run = CliRunner()
    told = run.invoke(cli, ["deflect", "--help"]).output
    assert "sdm help TOPIC" in told
    for topic in TOPICS:
        told += run.invoke(cli, ["help", topic], terminal_width=80).output
    for name, setting in BY_NAME.items():
        assert flag(setting) in told if setting.option.flag is not None else f"--set {name}=VALUE" in told, name
    assert "--workers" in told
    assert "it needs no selection" not in told  # what most runs need is short


def test_an_old_name_says_the_new_one():
    with pytest.raises(InputError, match="unknown setting corners; it is box now"):
        sdm_deflect.deflect("a.su2", "flap", corners=[[0, 0, 0], [1, 1, 1]])
    with pytest.raises(InputError, match="unknown setting corners; it is box now"):
        job_settings({"box_each": True, "surface": [{"patches": ["flap"], "corners": [[0, 0, 0], [1, 1, 1]]}]})


def test_a_setting_may_have_another_name_in_files():
    @dataclass(frozen=True)
    class Named:
        inner: Annotated[float, Spelling("outer")] = 1.0

    assert structure({"outer": 2.0}, Named).inner == 2.0
    with pytest.raises(InputError, match="unknown setting inner"):
        structure({"inner": 2.0}, Named)


def test_a_checker_of_types_finds_what_is_misspelt(tmp_path):
    """What else is imported is left out, so that it takes seconds."""
    (tmp_path / "snippet.py").write_text(MISSPELT)
    parts = (ROOT / "sdm_deflect" / name for name in ("__init__.py", "cases/api.py", "cases/settings/keywords.py"))
    words = ("--follow-imports=skip", "--ignore-missing-imports", "--cache-dir", tmp_path / "cache")
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", *words, *parts, tmp_path / "snippet.py"],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    said = [line for line in checked.stdout.splitlines() if "snippet.py" in line]
    assert [line.partition(".py:")[2][:1] for line in said if "error" in line] == ["3", "4", "5"], checked.stdout
    assert '"tolerence"' in said[0]
    assert "tolerance" in checked.stdout
    assert '"steps"' in checked.stdout
    assert '"strategy"' in checked.stdout


def test_files_of_earlier_versions_say_the_same():
    """`case.toml` of a run and `settings.toml` of a deflection, as version 1.0.0 wrote them."""
    kept = ROOT / "tests" / "kept" / "settings"
    written, case = loads((kept / "case.toml").read_text()), loads(to_toml(resolve("", config=kept / "case.toml")))
    assert [case[name].pop("seed") for name in ("mesh", "background")] == [1, 1]  # there was none
    assert case["adaptation"].pop("processor") == "cpu"  # there was no other
    assert {name: case[name] for name in written} == written
    assert {name: case[name] for name in case.keys() - written.keys()} == {"notch": 0.0}
    told = loads((kept / "settings.toml").read_text())
    del told["mesh"]
    now = table_of(job_settings(read_job(kept / "settings.toml")))
    (surface,), (surface_told,) = now.pop("surface"), told.pop("surface")
    for table, written in ((now, told), (surface, surface_told)):
        assert {name: table[name] for name in written} == written
