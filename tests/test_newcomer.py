"""What a test says that lacks a library or a program, and that it fails in a pipeline."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("pipeline", "counts"), [("", "1 failed, 1 passed, 3 skipped"), ("1", "3 failed, 1 passed, 1 error")]
)
def test_what_is_not_installed_skips_with_its_command_and_fails_in_a_pipeline(pipeline, counts):
    words = ["-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", "tests/absent.py"]
    environment = {**os.environ, "CI": pipeline}
    done = subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert counts in done.stdout.splitlines()[-1], done.stdout + done.stderr
    if not pipeline:
        assert "no_such_library is not installed: pip install -c constraints.txt -e '.[dev]'" in done.stdout
        assert "no-such-program is not installed: apt-get install" in done.stdout
