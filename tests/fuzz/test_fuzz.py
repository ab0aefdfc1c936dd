"""What once did harm does none, nor does random damage, always the same."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.targets import TARGETS


@pytest.mark.parametrize("choice", ["--known", pytest.param("--inputs=500", marks=pytest.mark.nightly)])
def test_whatever_is_read_is_accepted_or_refused_in_a_sentence(choice, tmp_path):
    words = [choice, "--keep", tmp_path / "found", "--json", tmp_path / "figures.json"]
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", *words],
        capture_output=True, text=True, cwd=Path(__file__).parents[2], check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures.keys() == TARGETS.keys()
    for one in figures.values():
        assert one["inputs"] == one.get("ok", 0) + one.get("clean", 0) > 10
