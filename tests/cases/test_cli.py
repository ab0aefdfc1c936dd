"""What a user types and what comes back: one line and exit code 2 for a mistake, nothing written."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sdm_deflect.cases.cli import main


@pytest.fixture
def sdm(capsys, monkeypatch, tmp_path):
    """Run `sdm` in this process in an empty folder; return exit code, standard output and error."""
    monkeypatch.chdir(tmp_path)

    def call(*words: str):
        monkeypatch.setattr(sys, "argv", ["sdm", *words])
        with pytest.raises(SystemExit) as stop:
            main()
        captured = capsys.readouterr()
        return stop.value.code, captured.out, captured.err

    return call


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "aleron"], "unknown case 'aleron'; did you mean aileron?"),
        (["run"], "no case given"),
        (["run", "aileron", "--angle", "95"], "angle = 95 deg is outside -60 ... 60 deg"),
        (["run", "aileron", "--angle", "nan"], "angle = nan is not a finite number"),
        (["run", "aileron", "--angle", "steep"], "steep"),
        (["run", "aileron", "--scale", "huge"], "unknown scale 'huge'; there are small, medium"),
        (["run", "aileron", "--strategy", "both"], "strategy = 'both' is not one of squv, mv"),
        (["run", "aileron", "--set", "wing.half_span=-1"], "wing.half_span = -1 m is outside"),
        (["run", "aileron", "--set", "wing.half_span=nan"], "wing.half_span = nan is not a finite number"),
        (["run", "aileron", "--set", "aileron.gap=0.25"], "gap"),
        (["run", "aileron", "--set", "adaptation.tolerance=0"], "adaptation.tolerance = 0 m is outside"),
        (["run", "aileron", "--set", "adaptation.max_centers=8"], "is fewer than the 20 initial centres"),
        (["run", "aileron", "--set", "confinement.aft=0"], "confinement.aft = 0 m is outside"),
        (["run", "aileron", "--config", "none.toml"], "none.toml"),
        (["run", "aileron", "--out", "/dev/null/results"], "--out /dev/null/results"),
        (["run", "aileron", "--no-such-option"], "--no-such-option"),
        (["geometry", "--out", "sdm.obj"], "the suffix must be .step, .brep or .stl"),
        (["quality", "missing.vtu"], "missing.vtu is not a file"),
        (["fly"], "fly"),
    ],
)
def test_mistake_is_one_line_and_code_2(sdm, tmp_path, words, message):
    code, out, err = sdm(*words)
    assert code == 2
    assert out == ""
    assert message in err
    assert err.count("\n") == 1
    assert not any(tmp_path.rglob("*"))


def test_list_names_cases_and_angles(sdm):
    code, out, _ = sdm("list")
    assert code == 0
    assert "aileron" in out
    assert "-12.0 deg" in out


@pytest.mark.parametrize("suffix", [".step", ".brep", ".stl"])
def test_geometry_writes_the_cad(sdm, tmp_path, suffix):
    code, out, _ = sdm("geometry", "--angle", "-12", "--out", f"sdm{suffix}")
    assert code == 0
    assert "faces" in out
    assert (tmp_path / f"sdm{suffix}").stat().st_size > 50_000
    assert [path.name for path in tmp_path.iterdir()] == [f"sdm{suffix}"]


def test_cache_tells_and_clears(sdm, tmp_path, monkeypatch):
    monkeypatch.setenv("SDM_DEFLECT_CACHE", str(tmp_path / "cache"))
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache" / "0123.npz").write_bytes(bytes(1_000_000))
    assert "1 meshes, 1.0 MB" in sdm("cache")[1]
    assert "freed 1.0 MB" in sdm("cache", "--clear")[1]
    assert "0 meshes" in sdm("cache")[1]


@pytest.mark.mesher
def test_run_prints_verdict_and_json(sdm, aileron_mesh, tmp_path):
    code, out, _ = sdm("run", "aileron", "--quiet", "--angle", "5")
    assert code == 0
    assert "all validations passed" in out
    folder = tmp_path / "runs" / "aileron"
    figures = json.loads((folder / "metrics.json").read_text())
    assert figures["angle_deg"] == 5.0
    assert figures["validation"]["passed"]
    code, out, _ = sdm("quality", str(folder / "deflected.vtu"))
    assert code == 0
    assert "tetrahedra" in out
    assert "aileron_left" in out


@pytest.mark.mesher
@pytest.mark.parametrize("request_to_end", [signal.SIGINT, signal.SIGTERM])
def test_interrupt_leaves_previous_results(tmp_path, request_to_end):
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / "metrics.json").write_text("previous")
    environment = {**os.environ, "SDM_DEFLECT_CACHE": str(tmp_path / "empty")}
    words = [sys.executable, "-m", "cases", "run", "aileron", "--out", str(folder)]
    # A test run in the background of a shell ignores interrupts, and its children would, too.
    with subprocess.Popen(
        words, env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:  # fmt: skip
        wait_until_meshing(process.pid)
        process.send_signal(request_to_end)
        process.wait(timeout=30)
    assert process.returncode == 130
    assert (folder / "metrics.json").read_text() == "previous"
    assert [path.name for path in folder.iterdir()] == ["metrics.json"]
    assert not children(process.pid)


def wait_until_meshing(pid: int) -> None:
    """Wait until the mesher's subprocess runs."""
    deadline = time.monotonic() + 60.0
    while not any(b"meshing." in Path(f"/proc/{child}/cmdline").read_bytes() for child in children(pid)):
        assert time.monotonic() < deadline, "the mesher did not start within a minute"
        time.sleep(0.2)
    time.sleep(2.0)


def children(pid: int) -> list[int]:
    """Process ids of the living children of a process."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid and fields[0] != "Z":
            found.append(int(path.parent.name))
    return found
