"""What once did harm does none, nor do random inputs, always the same."""

import json
import subprocess
import sys
from pathlib import Path

from tests.fuzz.targets import TARGETS

ROOT = Path(__file__).resolve().parents[2]


def test_whatever_is_read_is_accepted_or_refused_in_a_sentence(tmp_path):
    words = ["--sample", "--jobs", "2", "--keep", str(tmp_path / "found"), "--json", str(tmp_path / "figures.json")]
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", *words], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert {name: one["inputs"] for name, one in figures.items()} == {
        name: target.sample for name, target in TARGETS.items()
    }
