"""An angle goes from the command line to the sum over the centres by few files, none of them entered twice.

A whole command enters not many more, and loads few that it does not enter.
"""

import inspect
import subprocess
import sys
from pathlib import Path
from traceback import extract_stack

import pytest
from click.testing import CliRunner

from sdm_deflect.cases.aircraft.metrics import MeshOrigin
from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.frozen.test_frozen import frozen_tets

MOST = 9
ROOT = Path(__file__).parents[1]
ADAPTATION = "deform/rbf/greedy.py"


class ArrivedError(Exception):
    """The files through which the first sum of an adaptation was reached."""


@pytest.fixture
def arrive(monkeypatch):
    """Run a command until its adaptation sums for the first time; return the files passed, in order."""

    def spy(*args, **kwargs):
        places = [Path(frame.filename).resolve() for frame in extract_stack()]
        own = [str(place.relative_to(ROOT)) for place in places if place.is_relative_to(ROOT)]
        entered = [name for name, before in zip(own, ["", *own], strict=False) if name != before]
        files = [name for name in entered if name.startswith(("cases/", "deform/"))]
        if ADAPTATION in files:
            raise ArrivedError([*files, "deform/rbf/kernels.py"])
        return kernel_sum(*args, **kwargs)

    from sdm_deflect.deform.rbf import problem
    from sdm_deflect.deform.rbf.kernels import kernel_sum

    monkeypatch.setattr(problem, "kernel_sum", spy)

    def run(words):
        outcome = CliRunner().invoke(cli, words)
        assert isinstance(outcome.exception, ArrivedError), outcome.output
        return outcome.exception.args[0]

    return run


def test_sdm_run(arrive, monkeypatch, tmp_path):
    from sdm_deflect.cases.aircraft import pipeline

    monkeypatch.setattr(pipeline, "mesh_of_case", lambda *_: (frozen_tets("aircraft"), MeshOrigin(0.0, 1, 0.0)))
    files = arrive(["run", "aileron", "--angle", "-12", "--no-report", "-q", "--out", str(tmp_path / "run")])
    assert len(files) == len(set(files)) <= MOST, files


def test_sdm_deflect(arrive, hybrid_wing, tmp_path):
    FORMATS["su2"].write(hybrid_wing.mesh, tmp_path / "wing.su2")
    hinge = [",".join(map(str, point)) for point in hybrid_wing.hinge]
    words = ["deflect", str(tmp_path / "wing.su2"), "--surface", "flap_*", "--fixed", "wing_*", "--hinge", *hinge]
    files = arrive([*words, "--angle", "5", "--motion", "blended", "--no-report", "-q"])
    assert len(files) == len(set(files)) <= MOST, files


MOST_ENTERED = {"deflect": 78, "run": 78}
MOST_LOADED = 104
LOADED = """
import sys
from sdm_deflect.cases.cli.commands import cli
cli(sys.argv[1:], standalone_mode=False)
print(sum(name.startswith("sdm_deflect.") for name in sys.modules))
"""


def entered(words):
    """Carry out a command; return the files of which functions were entered, comprehensions and lambdas left out."""
    found = set()

    def entering(frame, event, _):
        code = frame.f_code
        if event == "call" and code.co_flags & inspect.CO_OPTIMIZED and not code.co_name.startswith("<"):
            found.add(code.co_filename)

    sys.setprofile(entering)
    try:
        assert cli(words, standalone_mode=False) == 0
    finally:
        sys.setprofile(None)
    places = [place.relative_to(ROOT) for place in (Path(name).resolve() for name in found) if ROOT in place.parents]
    return sorted(str(place) for place in places if place.parts[0] in ("cases", "deform", "geometry", "meshing"))


FLAP = ["--surface", "flap", "--fixed", "wing", "--hinge", "0.7,0.6,0", "0.7,1.4,0", "--angle", "15"]


def test_files_of_a_deflection(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cli(["example"], standalone_mode=False)
    words = ["deflect", "naca.su2", *FLAP, "--motion", "blended", "--no-report", "-q"]
    files = entered(words)
    assert 40 < len(files) <= MOST_ENTERED["deflect"], files
    done = subprocess.run([sys.executable, "-c", LOADED, *words], capture_output=True, text=True, check=True)
    assert int(done.stdout.splitlines()[-1]) <= MOST_LOADED


@pytest.mark.mesher
def test_files_of_a_run(aileron_mesh, tmp_path, monkeypatch):
    from sdm_deflect.cases.aircraft import pipeline

    monkeypatch.setattr(pipeline, "mesh_of_case", lambda *_: aileron_mesh)
    files = entered(["run", "aileron", "--no-report", "-q", "--out", str(tmp_path / "run")])
    assert 40 < len(files) <= MOST_ENTERED["run"], files
