"""A case of one's own by `sdm run --config`: a file with a name of its own."""

import json
import tomllib

import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.aircraft.registry import case_named, resolve
from tests import calls

MINE = """
name = "mine-1"
title = "the rudder and a tail"
deflections = [{surface = "rudder"}, {surface = "tail_left", factor = -0.5}]
angle = 6.0
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(MINE)
    return path


def test_it_starts_from_the_aileron_s_settings(file):
    case, usual = resolve("", config=file), case_named("aileron")
    assert (case.name, case.title, case.angle) == ("mine-1", "the rudder and a tail", 6.0)
    assert [(one.surface, one.factor) for one in case.deflections] == [("rudder", 1.0), ("tail_left", -0.5)]
    assert (case.mesh, case.adaptation, case.fighter) == (usual.mesh, usual.adaptation, usual.fighter)
    assert resolve("mine-1", config=file, angle=-3.0).angle == -3.0


def test_a_block_of_one_s_own_has_the_sizes_of_a_block(tmp_path):
    path = tmp_path / "block.toml"
    path.write_text('name = "b"\ndomain = "block"\ndeflections = [{surface = "aileron_left"}]\naileron.gap = 0.004\n')
    assert resolve("", config=path).mesh == case_named("aileron-chimera").mesh


@pytest.mark.mesher
def test_it_runs_and_its_own_file_repeats_it(file, aileron_mesh, tmp_path):
    file.write_text(MINE.replace(', {surface = "tail_left", factor = -0.5}', ""))
    first, again = tmp_path / "first", tmp_path / "again"
    assert calls.sdm("run", "--config", file, "--out", first, "--no-report", "--quiet") == 0
    assert calls.sdm("run", "--config", first / "case.toml", "--out", again, "--no-report", "--quiet") == 0
    assert tomllib.loads((again / "case.toml").read_text()) == tomllib.loads((first / "case.toml").read_text())
    assert (first / "deflected.vtu").read_bytes() == (again / "deflected.vtu").read_bytes()
    figures = json.loads((first / "metrics.json").read_text())
    assert (figures["case"], figures["mesh"]["guide"]) == ("mine-1", "the mesh of the guide")


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        ('name = "mine"\nangle = 3.0', "", "unknown case 'mine', and its file is none of a case of your own"),
        ("angle = 3.0", "mine", "unknown case 'mine', and its file is none of a case of your own"),
        (MINE, "ailron", "unknown case 'ailron'.*did you mean aileron"),
        (MINE.replace("mine-1", "../mine"), "", "must be of letters, digits, '-' and '_'"),
        (MINE.replace("mine-1", ""), "", "no case given"),
        (MINE.replace("mine-1", "-x"), "", "must be of letters, digits, '-' and '_'"),
        (MINE.replace("rudder", "ruder"), "", "ruder"),
        (
            MINE.replace('[{surface = "rudder"}, {surface = "tail_left", factor = -0.5}]', "[]"),
            "",
            "deflections is empty",
        ),
        (MINE.replace('[{surface = "rudder"}, {surface = "tail_left", factor = -0.5}]', "3"), "", "deflections"),
        (MINE.replace('"mine-1"', "7"), "", "name"),
    ],
)
def test_what_is_no_case_is_refused(tmp_path, text, name, message):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        resolve(name, config=path)
