"""What a user types and what comes back: one line and exit code 2 for a mistake, nothing written."""

import json
import lzma
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import psutil
import pytest

from sdm_deflect import read
from sdm_deflect.cases.cli.commands import cli
from tests.meshing.formats.blunt_wing import EXAMPLE, packed


@pytest.fixture
def sdm(sdm, monkeypatch, tmp_path):
    """`sdm` in an empty folder."""
    monkeypatch.chdir(tmp_path)

    return sdm


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "aleron"], "unknown case 'aleron'; did you mean aileron, aileron-free?"),
        (["run"], "no case given"),
        (["run", "aileron", "--angle", "95"], "angle = 95 deg must be a number from -85 to 85 deg"),
        (["run", "all", "--angle", "69"], "turns the rudder by 86.25 deg; at most 85 deg are possible"),
        (["run", "tail", "--angle", "45"], "its root leaves the fuselage: 2 of 6 lines miss the cylinder"),
        (["geometry", "--out", "sdm.step", "--angle", "86"], "angle = 86 deg must be a number from -85 to 85 deg"),
        (["run", "aileron", "--angle", "nan"], "angle = nan is not a finite number"),
        (["run", "aileron", "--angle", "steep"], "steep"),
        (["run", "aileron", "--scale", "huge"], "'huge' is not one of 'small', 'medium', 'paper'"),
        (["run", "aileron", "--strategy", "both"], "'both' is not one of 'squv', 'mv'"),
        (["run", "aileron", "--set", "confinement.aft=0"], "confinement.aft = 0 m must be a number from 0.005 to 1 m"),
        (["run", "aileron", "--config", "none.toml"], "none.toml"),
        (["run", "aileron", "--out", "/dev/null/results"], "--out /dev/null/results"),
        (["run", "aileron", "--no-such-option"], "--no-such-option"),
        (["geometry", "--out", "sdm.obj"], "the suffix must be .step, .brep or .stl"),
        (["geometry", "--angle", "5"], "--out"),
        (["geometry", "--out", "sdm.step", "--binary"], "only an .stl can be binary"),
        (["quality", "missing.vtu"], "missing.vtu is not a file"),
        (["limit", "aileron", "--quality", "2"], "--quality 2 must be between 0 and 1"),
        (["limit", "aileron", "--resolution", "nan"], "--resolution nan must be between 0 and 30"),
        (["export", "runs/aileron", "--format", "fluent"], "'fluent' is not one of 'cgns', 'gmsh', 'openfoam'"),
        (["study", "table5"], "No such command 'study'"),
        (["validate", "nowhere"], "nowhere is not the output folder of a run"),
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
    rows = json.loads(sdm("list", "--json")[1])
    assert {row["name"]: row["angle_deg"] for row in rows}["tail"] == 12.0


@pytest.mark.parametrize("name", ["", *cli.commands])
def test_every_command_explains_itself(sdm, name):
    short, long = (sdm(*name.split(), switch) for switch in ("-h", "--help"))
    assert short == long
    assert short[0] == 0
    assert f"Usage: {' '.join(['sdm', *name.split()])}" in short[1]


def test_what_the_switches_may_be_is_what_there_is():
    from sdm_deflect.cases.cli import options
    from sdm_deflect.meshing.formats.registration import writable
    from sdm_deflect.meshing.generate.parameters import SCALES

    assert tuple(options.SCALES.choices) == tuple(SCALES)
    assert tuple(options.FORMATS.choices) == writable()


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("sdm r", {"run", "report"}),
        ("sdm run ai", {"aileron", "aileron-chimera", "aileron-free"}),
        ("sdm limit ", {"aileron", "aileron-chimera", "aileron-free", "tail", "rudder", "all"}),
        ("sdm geometry --case ru", {"rudder"}),
        ("sdm run tail --scale ", {"small", "medium", "paper"}),
        ("sdm run tail --strategy m", {"mv"}),
        ("sdm export runs/tail --format ", {"su2", "cgns", "gmsh", "ugrid", "tau", "vtu", "openfoam"}),
        ("sdm export runs/tail --format su2 --which un", {"undeflected"}),
        ("sdm deflect wing.su2 --strategy ", {"squv", "mv"}),
        ("sdm deflect wing.su2 --motion b", {"blended"}),
    ],
)
def test_a_shell_is_told_what_may_follow(typed, offered, sdm, monkeypatch):
    monkeypatch.setenv("_SDM_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(len(typed.split(" ")) - 1))
    code, out, _ = sdm()
    assert code == 0
    assert {line.partition(",")[2] for line in out.splitlines()} == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_gets_its_script(shell, sdm):
    code, out, _ = sdm("completion", shell)
    assert code == 0
    assert f"{shell}_complete" in out


def test_the_help_lists_every_command_but_study_by_subject_and_cuts_no_sentence(sdm):
    lines = [line for line in sdm("--help")[1].splitlines() if line]
    subjects = [line for line in lines if line.endswith(":")]
    assert subjects == ["Options:", "Your mesh:", "The SDM, an aircraft:", "Results:", "This machine:"]
    rows = [line.split(maxsplit=1) for line in lines[lines.index("Your mesh:") :] if line.startswith(" ")]
    assert [name for name, _ in rows] == [name for name in cli.commands if name != "study"]
    assert all(text.endswith(".") and not text.endswith("...") for _, text in rows)


def test_the_example_is_a_mesh_that_its_own_next_line_deflects(sdm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = sdm("example")
    assert code == 0
    assert out.splitlines()[1].startswith("sdm deflect naca.su2 --surface flap ")
    assert sdm(*out.splitlines()[1].split()[1:], "--dry-run")[0] == 0
    written = (tmp_path / "naca.su2").read_bytes()
    code, _, complaint = sdm("example")
    assert code == 2
    assert "naca.su2 is there already" in complaint
    assert (tmp_path / "naca.su2").read_bytes() == written


def test_the_example_with_layers_is_small_and_its_layers_keep_their_heights(sdm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert EXAMPLE.stat().st_size < 60_000
    assert lzma.decompress(EXAMPLE.read_bytes()) == lzma.decompress(packed())
    code, out, _ = sdm("example", "--layers")
    assert code == 0
    cells = read("layers.su2").cells
    assert f"of {round(sum(map(len, cells)), -2):,} cells" in out
    code, told, _ = sdm(*out.splitlines()[1].split()[1:], "--json")
    assert code == 0
    (check,) = (c for c in json.loads(told)["angles"][0]["validation"]["checks"] if c["name"] == "layer_height")
    assert check["over"] > 100
    assert check["passed"]
    assert 0.0 < check["figures"]["tilt_deg"]["p99"] <= check["figures"]["tilt_deg"]["max"] < 20.0
    code, _, complaint = sdm("example", "--layers", "--fighter")
    assert (code, "two examples" in complaint) == (2, True)


HEAVY = ("numba", "scipy", "pyvista", "vtkmodules", "matplotlib", "cadquery", "OCP", "gmsh", "h5py", "trimesh")
LOADED = """
import json, sys
from sdm_deflect.cases.cli.commands import carry_out as main
for words in json.loads(sys.argv[1]):
    sys.argv = ["sdm", *words.split()]
    try:
        main()
    except SystemExit as stop:
        loaded = sorted({name.partition(".")[0] for name in sys.modules})
        print(json.dumps([words, stop.code, loaded]), file=sys.stderr)
"""
# Words of commands that are answered without work, and their exit codes.
LIGHT = {
    "": 2,
    "--help": 0,
    "run -h": 0,
    "--version": 0,
    "list": 0,
    "list --json": 0,
    "run nosuch": 2,
    "run": 2,
    "run aileron --scale huge": 2,
    "run aileron --angle 95": 2,
    "run aileron --set wing.half_spam=1": 2,
    "run aileron --set adaptation.n_add=few": 2,
    "run aileron --config none.toml": 2,
    "run aileron --nope": 2,
    "limit nosuch": 2,
    "limit tail --quality 3": 2,
    "geometry --out sdm.obj": 2,
    "export runs/aileron --format stl": 2,
    "study table9": 2,
    "deflect": 2,
    "deflect wing.su2 --hinge 0,0,0 --angle 5": 2,
    "fly": 2,
}


def test_answers_without_work_load_no_heavy_library(tmp_path):
    """What they load is tested instead of their time, which depends on the machine."""
    command = [sys.executable, "-c", LOADED, json.dumps(list(LIGHT))]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    answers = [json.loads(line) for line in done.stderr.splitlines() if line.startswith("[")]
    assert {words: code for words, code, _ in answers} == LIGHT, done.stderr
    for words, _, loaded in answers:
        assert {*HEAVY, "rich"} & set(loaded) == set(), words


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
    code = tmp_path / "cache" / "numba" / "state" / "rbf" / "sums.1.nbc"
    code.parent.mkdir(parents=True)
    code.write_bytes(bytes(2_000_000))
    foreign = code.with_name("notes.txt")
    foreign.touch()
    assert "1 meshes, 1.0 MB; compiled code, 2.0 MB" in sdm("cache")[1]
    assert "freed 3.0 MB" in sdm("cache", "--clear")[1]
    assert "0 meshes, 0.0 MB; compiled code, 0.0 MB" in sdm("cache")[1]
    assert foreign.exists()
    assert json.loads(sdm("cache", "--json")[1])["bytes"] == 0


def test_a_cache_that_cannot_be_cleared_is_one_sentence(sdm, tmp_path, monkeypatch):
    monkeypatch.setenv("SDM_DEFLECT_CACHE", str(tmp_path))
    (tmp_path / "0123.npz").mkdir()
    code, out, err = sdm("cache", "--clear")
    assert (code, out) == (2, "")
    assert err.startswith(f"sdm: {tmp_path}: cannot be written: ")
    assert err.count("\n") == 1


@pytest.mark.mesher
def test_run_prints_verdict_and_json(sdm, aileron_mesh, tmp_path):
    code, out, _ = sdm("run", "aileron", "-q", "--angle", "5")
    assert code == 0
    assert "all validations passed" in out
    folder = tmp_path / "runs" / "aileron"
    assert (folder / "report.html").is_file()
    code, out, err = sdm("run", "aileron", "--angle", "5", "--json", "--no-report", "--out", "plain")
    assert (code, err) == (0, "")
    assert not {"report.html", "figures"} & {path.name for path in (tmp_path / "plain").iterdir()}
    figures = json.loads((tmp_path / "plain" / "metrics.json").read_text())
    printed = json.loads(out)
    assert printed.keys() == figures.keys()
    assert printed["validation"] == figures["validation"]
    assert figures["angle_deg"] == 5.0
    assert figures["validation"]["passed"]
    code, out, _ = sdm("quality", str(folder / "deflected.vtu"))
    assert code == 0
    assert "tetrahedra" in out
    assert "aileron_left" in out
    assert "aileron_left" in json.loads(sdm("quality", str(folder / "deflected.vtu"), "--json")[1])["patches"]
    code, out, _ = sdm("validate", str(folder), "--json", "-q")
    assert code == 0
    names = {check["name"] for check in json.loads(out)["checks"]}
    assert names == {check["name"] for check in figures["validation"]["checks"]} | {"undeflected_mesh"}


@pytest.mark.nightly
@pytest.mark.mesher
@pytest.mark.parametrize("request_to_end", [signal.SIGINT, signal.SIGHUP])
def test_interrupt_leaves_previous_results(tmp_path, request_to_end):
    folder = tmp_path / "results"
    folder.mkdir()
    earlier = {"case.toml", "metrics.json"}  # by its settings a folder is known as an earlier run
    for name in earlier:
        (folder / name).write_text("previous")
    environment = {**os.environ, "SDM_DEFLECT_CACHE": str(tmp_path / "empty")}
    words = [sys.executable, "-m", "sdm_deflect", "run", "aileron", "--out", str(folder)]
    # A test run in the background of a shell ignores interrupts, and its children would, too.
    with subprocess.Popen(
        words, env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:  # fmt: skip
        descendants = wait_until_meshing(process)
        process.send_signal(request_to_end)
        _, said = process.communicate(timeout=120)
    assert process.returncode == 128 + request_to_end
    assert said.decode().endswith("interrupted; earlier results are as they were\n")
    assert {path.name: path.read_text() for path in folder.iterdir()} == dict.fromkeys(earlier, "previous")
    assert psutil.wait_procs(descendants, timeout=5)[1] == []


def wait_until_meshing(process: subprocess.Popen[bytes]) -> list[psutil.Process]:
    """Wait until the mesher's subprocess runs; return the processes below one."""
    deadline = time.monotonic() + 300.0
    while True:
        assert process.poll() is None, process.stderr and process.stderr.read().decode()
        found = psutil.Process(process.pid).children(recursive=True)
        for child in found:
            with suppress(psutil.Error):  # it has ended
                if "meshing.generate" in " ".join(child.cmdline()):
                    time.sleep(2.0)
                    return found
        assert time.monotonic() < deadline, "the mesher did not start within five minutes"
        time.sleep(0.2)
