"""What once did harm does none, nor do random inputs, always the same."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.targets import TARGETS

ROOT = Path(__file__).resolve().parents[2]


QUICK = [name for name in TARGETS if name not in ("vtu", "options", "folders", "geometry")]


@pytest.mark.parametrize(
    ("choice", "names"), [("known", QUICK), pytest.param("sample", list(TARGETS), marks=pytest.mark.nightly)]
)
def test_whatever_is_read_is_accepted_or_refused_in_a_sentence(choice, names, tmp_path):
    words = [f"--{choice}", "--jobs", "2", "--keep", str(tmp_path / "found"), "--json", str(tmp_path / "figures.json")]
    words += [word for name in names for word in ("--target", name)]
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", *words], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert list(figures) == names
    assert all(one["inputs"] == TARGETS[name].sample or choice == "known" for name, one in figures.items())


@pytest.mark.parametrize("name", [name for name in TARGETS if name not in QUICK])
def test_seeds_of_what_is_left_to_the_nightly_run_are_made(name, tmp_path):
    assert any(TARGETS[name].seeds(tmp_path))
