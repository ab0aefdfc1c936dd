"""What a long run says before it ends, and what a run says last: stages, trials, files that failed, shares reached."""

import json
import re
import subprocess
import sys
import time
from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from sdm_deflect.cases.cli.console import WIDTH
from sdm_deflect.cases.report.page import remedies
from sdm_deflect.cases.run import progress
from sdm_deflect.cases.run.advice import advice
from sdm_deflect.cases.run.limit import Search, Trial
from sdm_deflect.deform.checks import Check, grade, tally, verdict
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.deform.blocks import block_with_body

ROOT = Path(__file__).parents[2]
TURN = ["--surface", "body", "--hinge", "0,-0.5,0", "0,0.5,0"]


def test_a_stage_without_a_terminal_is_told_at_its_beginning_and_again(monkeypatch):
    monkeypatch.setattr(progress, "PATIENCE", 0.02)
    monkeypatch.setattr(progress, "PAUSE", 0.05)
    out = StringIO()
    with progress.lines(Console(file=out, width=WIDTH), every=False)("mesh") as tell:
        time.sleep(0.1)
        tell("refining", 0.5)
        time.sleep(0.2)
    texts = [re.sub(r"\s+", " ", line) for line in out.getvalue().splitlines()]
    assert texts[0].endswith(" s begins")
    assert len([text for text in texts if text.endswith(" s refining")]) > 1


def test_a_short_stage_is_told_once():
    out = StringIO()
    with progress.lines(Console(file=out, width=WIDTH), every=False)("read") as tell:
        tell("done", 1.0)
    assert len(out.getvalue().splitlines()) == 1


def test_each_trial_of_a_limit_is_a_line(tmp_path, sdm):
    FORMATS["su2"].write(block_with_body(), tmp_path / "block.su2")
    code, out, err = sdm("limit", tmp_path / "block.su2", *TURN, "--resolution", 12)
    assert code == 0, err
    assert "RuntimeWarning" not in err
    tried = re.findall(r"repair (off|auto), (\S+) deg: ", err)
    assert {mode for mode, _ in tried} == {"off", "auto"}
    assert len(tried) >= 4
    code, out, err = sdm("limit", tmp_path / "block.su2", *TURN, "--resolution", 12, "--quiet", "--json")
    found = {(one["repair"], f"{trial['angle']:+.4g}") for one in json.loads(out)["limits"] for trial in one["trials"]}
    assert set(tried) <= found  # which have that at 0, and those known from the other mode, too


def test_what_a_stopped_search_knows_is_said(monkeypatch):
    said = []

    def trial(self, angle, repair):
        if len(said) == 3:
            raise KeyboardInterrupt
        return Trial(angle=angle, quality_min=0.5, steps=1, fault="1 inverted cell" if abs(angle) > 50.0 else "")

    search = Search("block", "deg", lambda angle, repair: None, 90.0, 1.0)
    monkeypatch.setattr(Search, "trial", trial)
    with pytest.raises(KeyboardInterrupt):
        search.limits("off", lambda text, fraction: None, said.append)
    assert len(said) == 4
    tried = [abs(float(re.search(r"off, (\S+) deg", line)[1])) for line in said[:3]]
    good, bad = max(one for one in tried if one <= 50.0), min((one for one in tried if one > 50.0), default=None)
    fails = "" if bad is None else f", and not at {-bad:+.4g}"
    assert said[3] == f"known when stopped: repair off: all checks hold up to {-good:+.4g} deg{fails}"


def test_a_sweep_names_the_files_that_failed(tmp_path, sdm, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    FORMATS["su2"].write(block_with_body(), tmp_path / "block.su2")
    words = ["deflect", tmp_path / "block.su2", *TURN, "--no-report", "--quiet", "--repair", "off"]
    code, out, _ = sdm(*words, "--angles", "2,4,60", "--min-quality", "0.8", "--force")
    text = " ".join(out.split())
    assert code == 1
    assert re.search(r"FAILED: do not use block-deflected_\+60\.su2; \d of \d+ checks", text)
    code, out, err = sdm(*words, "--angles", "1,3", "--min-quality", "0.5")
    assert (code, "do not use" in out) == (0, False), err


def failing(name, surfaces):
    """What the page shows of a run in which a check failed."""
    return SimpleNamespace(checks=(Check(name, 2.0, 1.0, "-", ""),), surfaces=surfaces)


@pytest.mark.parametrize(
    ("amount", "wider", "said"),
    [
        (
            5.0,
            "--strip 0.3",
            ["Try --strip 0.3, a smaller angle (`sdm limit` finds the largest) or a larger --margin."],
        ),
        (5.0, "", ["Try a smaller angle (`sdm limit` finds the largest) or a larger --margin."]),
        (0.0, "--strip 1", []),
    ],
)
def test_advice_is_by_case(amount, wider, said):
    data = failing("inverted_cells", (SimpleNamespace(amount=amount, wider=wider),))
    assert list(remedies(data)) == said
    assert list(remedies(failing("rounding", ()))) == ["Write a format of double precision."]


def test_advice_on_several_checks_is_one_sentence_and_a_usable_mesh_has_it_too():
    bad = Check("inverted_cells", 2.0, 0.0, "cells", ""), Check("surfaces_crossed", 2.0, 0.0, "faces", "")
    (told,) = advice(bad, ("--strip 0.3",), True)
    assert told.count("a smaller angle") == 1
    assert told.endswith(" or a hinge farther from the other surface.")
    poor = Check("quality_min:tetra", 0.06, 0.02, "", "", "at least", reservation="11 of 30,926 tetrahedra poor")
    assert list(advice((poor,), ("--strip 0.3",), True)) == [
        "Try --strip 0.3, a smaller angle (`sdm limit` finds the largest) or a larger --margin."
    ]
    assert list(advice((replace(poor, reservation=""),), ("--strip 0.3",), True)) == []


def test_checks_are_counted_in_one_way():
    held = Check("quality_min", 0.5, 0.25, "-", "", "at least")
    known = Check("rounding", 0.5, 0.25, "-", "", "information")
    absent = replace(held, name="layer_height", over=0)
    bad, poor = replace(held, value=0.1), replace(held, reservation="11 of 30,926 tetrahedra poor")
    assert [grade((held, *more)) for more in ((), (poor,), (poor, bad))] == ["passed", "usable", "FAILED"]
    assert verdict((held, poor)) == "usable, with 11 of 30,926 tetrahedra poor"
    assert tally((held, known, absent, bad)) == "1 of 2"
    assert verdict((held, known, absent, bad)) == "FAILED: do not use this mesh; 1 of 2 checks: quality_min"


@pytest.mark.parametrize("name", ["deform", "meshing", "geometry"])
def test_a_folder_of_the_clone_is_no_package(name):
    done = subprocess.run(
        [sys.executable, "-c", f"import {name}"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert f"ImportError: import sdm_deflect.{name}: this is a folder of that package" in done.stderr
    right = [sys.executable, "-c", f"import sdm_deflect.{name}"]
    assert subprocess.run(right, cwd=ROOT, capture_output=True, check=False).returncode == 0
