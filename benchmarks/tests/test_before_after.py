import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.before_after import ADAPTATIONS, Version, block_with_flap, compared, deflection
from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.meshing.formats.registry import FORMATS

ROOT = Path(__file__).parents[2]


def test_every_face_of_the_block_is_shared_or_on_one_patch() -> None:
    mesh = block_with_flap(10)
    tets = mesh.cells[0].nodes
    inner = np.sort(tets[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3), axis=1)
    outer = np.sort(np.concatenate([patch.faces[0].nodes for patch in mesh.patches]), axis=1)
    _, counts = np.unique(np.concatenate([inner, outer]), axis=0, return_counts=True)
    assert set(counts) == {2}
    assert (np.linalg.det(mesh.points[tets[:, 1:]] - mesh.points[tets[:, :1]]) > 0.0).all()
    assert len(mesh.patches[-1]) == 2 * 2 * (2 * 4 + 2 * 1 + 4 * 1)


@pytest.mark.nightly
def test_the_command_deflects_the_block(tmp_path: Path) -> None:
    FORMATS["su2"].write(block_with_flap(12), tmp_path / "block.su2")
    (tmp_path / "out").mkdir()
    words = [*deflection(tmp_path / "block.su2", tmp_path / "out"), "--repair", "off", "--quiet"]
    with pytest.raises(SystemExit) as ended:
        cli.main(words, standalone_mode=True)
    assert ended.value.code == 0
    before, after = (FORMATS["su2"].read(tmp_path / name).points for name in ("block.su2", "out/block.su2"))
    assert np.abs(after - before).max() == pytest.approx(0.2 * 2.0 * np.sin(np.radians(5.0)), rel=0.1)


def test_a_version_that_fails_is_named(tmp_path: Path) -> None:
    version = Version(tmp_path, (sys.executable, "-c", "raise SystemExit('no such case')"), tmp_path)
    with pytest.raises(RuntimeError, match="ended with 1: no such case"):
        version.taken(tmp_path)


@pytest.mark.nightly
def test_a_slow_version_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = {"slow": 2.0, "fast": 0.5}
    monkeypatch.setattr(Version, "taken", lambda self, mesh: {"work": seconds[self.command[0]]})
    (result,) = compared(*(Version(tmp_path, (name,), tmp_path) for name in seconds), tmp_path, 3)
    assert (result.name, result.value, result.median_of) == ("work", 4.0, 3)


def test_what_is_said_of_adaptations_is_of_this_version() -> None:
    compile(ADAPTATIONS, "adaptations", "exec")
    from benchmarks import adaptation

    assert {"Runs", "GreedyOptions", "Worst", "Separated"} <= set(vars(adaptation))
