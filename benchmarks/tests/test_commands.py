import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.commands import COMMANDS, Command, Run, Version, block_with_flap, main, measured
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


def test_a_command_is_measured_and_its_output_compared(tmp_path: Path) -> None:
    FORMATS["su2"].write(block_with_flap(12), tmp_path / "tets.su2")
    first, second = (Version(ROOT, 1).run(COMMANDS["tetrahedra"], tmp_path, tmp_path / "cache") for _ in range(2))
    nothing = Version(ROOT, 1).run(Command("pass", program=True), tmp_path, tmp_path)
    assert first.digest == second.digest
    assert first.digest != nothing.digest
    assert first.seconds > 0.0
    assert first.peak > 3.0 * nothing.peak > 1e6


def test_a_command_that_fails_is_named(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=r"ended with 2: .*no-such"):
        Version(ROOT, 1).run(Command("quality no-such.su2"), tmp_path, tmp_path / "cache")


@pytest.mark.parametrize(("digest", "said"), [("a", "equal bytes"), ("b", "OTHER BYTES")])
def test_a_slow_version_and_other_bytes_show(
    digest: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = {1: Run(2.0, 2.0, 1e6, "a"), 2: Run(0.5, 0.9, 2e6, digest)}
    monkeypatch.setattr(Version, "run", lambda self, command, meshes, cache: runs[self.threads])
    versions = {"slow": Version(ROOT, 1), "fast": Version(ROOT, 2)}
    first, second = measured({"wing": Command("deflect naca.su2")}, versions, 3, tmp_path)
    assert (first.value, second.value, second.median_of) == (2.0, 0.5, 3)
    assert second.note == f"processor 0.90 s, 2 MB, the first takes 4.00 times as long, {said}"


def test_an_unknown_name_is_refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["commands", "wings"])
    with pytest.raises(SystemExit):
        main()
    assert "no command wings; there are import, wing-cold" in capsys.readouterr().err
