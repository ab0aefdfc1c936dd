"""Strange surroundings: an output that takes nothing, or not all letters; a working folder that is gone."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from sdm_deflect.meshing.formats.su2 import Su2
from tests.deform.blocks import block_with_body

SDM = [sys.executable, "-m", "sdm_deflect"]
TURN = ["--surface", "bödy→", "--hinge", "0,0,0", "0,1,0", "--angle", "4", "--no-report", "--quiet"]


def ended(words, **surroundings):
    return subprocess.run([*SDM, *words], stderr=subprocess.PIPE, check=False, **surroundings)


@pytest.mark.parametrize("words", [["list"], ["list", "--json"], ["run", "--help"]])
def test_a_full_output_is_one_line(words):
    with Path("/dev/full").open("wb") as full:
        done = ended(words, stdout=full)
    assert (done.returncode, done.stderr) == (2, b"sdm: standard output: No space left on device\n")


def test_whoever_stops_reading_is_told_nothing():
    reading, writing = os.pipe()
    os.close(reading)
    done = ended(["list"], stdout=writing)
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.parametrize("words", [["list"], ["doctor"], ["quality", "wing.su2"]])
def test_a_working_folder_that_is_gone_is_named(words, tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    command = [sys.executable, "-c", f"import os; os.rmdir({str(gone)!r}); os.execv({SDM[0]!r}, {[*SDM, *words]!r})"]
    done = subprocess.run(command, cwd=gone, capture_output=True, text=True, check=False)
    expected = "sdm: the working folder does not exist any more: change to another one\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", expected)


def test_letters_that_the_output_lacks_are_spelled(tmp_path):
    mesh = tmp_path / "blöck→.su2"
    Su2().write(block_with_body(), mesh)
    mesh.write_text(mesh.read_text().replace("= body", "= bödy→"), encoding="utf-8")
    environment = {**os.environ, "PYTHONIOENCODING": "latin-1", "LANG": "C"}
    done = ended(["deflect", mesh, *TURN], stdout=subprocess.PIPE, env=environment)
    assert done.returncode in (0, 1), done.stderr
    assert "bödy\\u2192".encode("latin-1") in done.stdout
    assert done.stderr == b""
