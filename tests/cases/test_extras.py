"""Every command, where only what `.[report]` brings is installed."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from sdm_deflect.cases.cli.commands import SUBJECTS
from sdm_deflect.cases.run.output import EXTRAS

RUNNER = """
import contextlib, importlib.machinery as machinery, importlib.metadata as metadata, io, json, sys
names, commands = json.loads(sys.argv[1])
find, version = machinery.PathFinder.find_spec, metadata.version
def found(name, *where):
    return None if name.partition(".")[0] in names else find(name, *where)
def version_of(name):
    if name in ("cadquery-ocp", *names):
        raise metadata.PackageNotFoundError(name)
    return version(name)
machinery.PathFinder.find_spec, metadata.version = found, version_of
from sdm_deflect.cases.cli.commands import carry_out
for command in commands:
    out, err, sys.argv = io.StringIO(), io.StringIO(), ["sdm", *command]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            carry_out()
        except SystemExit as end:
            code = end.code
    print(json.dumps([code, out.getvalue(), err.getvalue()]))
"""
AIRCRAFT = (
    "sdm: making and measuring the SDM's CAD and meshes (sdm run, geometry, limit CASE) needs ",
    "'.[aircraft]'\n",
)
# Checks that only the CAD can make.
NEEDED = ("surface_to_cad", "rigid_cad_predicted", "planarity")
# Nodes of the mesh of `sdm example`.
NODES = 8167
FLAP = ["--surface", "flap", "--fixed", "wing", "--hinge", "0.7,0.6,0", "0.7,1.4,0", "--motion", "blended"]


@pytest.fixture(scope="module")
def answers(aileron_run, tmp_path_factory):
    """Code, output and complaint of each command."""
    folder = tmp_path_factory.mktemp("extras")
    shutil.copytree(aileron_run[1], folder / "aileron")
    np.savez(folder / "s.npz", sensitivity=np.ones((NODES, 3)))
    commands = {
        "list": [], "run": ["aileron"], "geometry": ["--out", "a.step"], "validate": ["aileron"],
        "validate --json": ["aileron"], "report": ["aileron"], "export": ["aileron", "--format", "su2"],
        "example": [], "example --fighter": [], "quality": ["naca.su2"], "limit": ["aileron"],
        "apply": ["f.npz", "--angle", "5", "naca.su2"],
        "deflect": ["naca.su2", *FLAP, "--angle", "5", "--range", "0:5", "--plan", "f.npz"],
        "gradient": ["s.npz", "--plan", "f.npz", "--at", "5"], "view": ["aileron", "--no-open"],
        "compare": ["aileron", "naca-deflected-report"], "convert": ["naca.su2", "naca.b8.ugrid"],
        "doctor": [], "cache": [], "completion": ["bash"], "help": ["blended"],
    }  # fmt: skip
    late = ("apply", "compare", "gradient")
    ordered = sorted(commands, key=lambda name: (name in late, list(commands).index(name)))
    lines = [[*name.split(" "), *commands[name]] for name in ordered]
    absent = [module for extra, modules in EXTRAS.items() if extra != "report" for module in modules]
    asked = json.dumps([absent, lines])
    done = subprocess.run(
        [sys.executable, "-c", RUNNER, asked], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder, dict(zip(ordered, map(json.loads, done.stdout.splitlines()), strict=True))


def test_every_command_is_tried(answers):
    names = {command.name for commands in SUBJECTS.values() for command in commands}
    assert {name.partition(" ")[0] for name in answers[1]} == names


def test_none_ends_in_a_traceback_and_most_work(answers):
    codes = {name: code for name, (code, _, _) in answers[1].items()}
    assert {name for name, code in codes.items() if code} == {"run", "geometry", "limit"}, answers
    assert {codes[name] for name in ("run", "geometry", "limit")} == {2}
    assert not any("Traceback" in complaint for _, _, complaint in answers[1].values())


def test_what_needs_the_aircraft_says_so_in_a_sentence(answers):
    for name in ("run", "limit"):
        complaint = answers[1][name][2]
        assert complaint.startswith(AIRCRAFT[0])
        assert complaint.endswith(AIRCRAFT[1])
        assert complaint.count("\n") == 1


def test_a_finished_run_is_validated_but_for_what_needs_the_cad(answers):
    figures = json.loads(answers[1]["validate --json"][1])
    assert figures["passed"]
    assert set(NEEDED) <= set(figures["skipped"])
    made = {check["name"] for check in figures["checks"]}
    assert {"outside_moved", "held_moved", "quality_min", "inverted_cells"} <= made
    stored = json.loads((answers[0] / "aileron" / "metrics.json").read_text())["validation"]["checks"]
    assert {check["name"] for check in stored} == made | set(figures["skipped"])
    text = answers[1]["validate"][1]
    assert "not measured again: " in text
    assert all(name in text for name in NEEDED)


def test_its_report_says_what_it_could_not_measure(answers):
    page = (answers[0] / "aileron" / "report.html").read_text()
    assert "there are no maps of distances from the CAD" in page


def test_doctor_says_what_the_absent_extras_bring(answers):
    text = " ".join(answers[1]["doctor"][1].split())
    assert "--scheduler) needs cryptography, dask, distributed" in text
    assert "'.[cluster]'" in text
