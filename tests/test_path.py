"""An angle goes from the command line to the sum over the centres by few files, none of them entered twice."""

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

    monkeypatch.setattr(pipeline, "meshed", lambda *_: (frozen_tets("aircraft"), MeshOrigin(0.0, 1, 0.0)))
    files = arrive(["run", "aileron", "--angle", "-12", "--no-report", "-q", "--out", str(tmp_path / "run")])
    assert len(files) == len(set(files)) <= MOST, files


def test_sdm_deflect(arrive, hybrid_wing, tmp_path):
    FORMATS["su2"].write(hybrid_wing.mesh, tmp_path / "wing.su2")
    hinge = [",".join(map(str, point)) for point in hybrid_wing.hinge]
    words = ["deflect", str(tmp_path / "wing.su2"), "--surface", "flap_*", "--fixed", "wing_*", "--hinge", *hinge]
    files = arrive([*words, "--angle", "5", "--motion", "blended", "--no-report", "-q"])
    assert len(files) == len(set(files)) <= MOST, files
