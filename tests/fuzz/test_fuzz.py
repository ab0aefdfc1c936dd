"""What once did harm does none, nor do inputs that are always the same random ones."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
COUNTS = {
    "su2": 900, "cgns": 350, "gmsh": 600, "openfoam": 700, "vtu": 700, "others": 40, "tables": 250, "options": 300,
    "settings": 400, "folders": 150, "geometry": 8, "cache": 500,
}  # fmt: skip
"""Inputs by target: what once did harm first, then random ones; together a minute."""


@pytest.mark.parametrize("target", COUNTS)
def test_whatever_is_read_is_accepted_or_refused_with_a_sentence(target, tmp_path):
    words = [
        "--target",
        target,
        "--inputs",
        COUNTS[target],
        "--jobs",
        1,
        "--keep",
        tmp_path,
        "--json",
        tmp_path / "found",
    ]
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", *map(str, words)], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads((tmp_path / "found").read_text())[target]["inputs"] == COUNTS[target]
