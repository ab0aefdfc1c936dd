"""Workers of Dask: the bits of one process, whoever is killed, and errors of one sentence."""

import os
import platform
import re
import resource
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import time
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from urllib.request import urlopen

import by_workers
import numpy as np
import psutil
import pytest
from distributed import Client, Security

from benchmarks.large_block import write_block
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import HERE
from sdm_deflect.cases.run import cluster, deflect_file
from sdm_deflect.cases.run.cluster import Cluster, workers
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.volume.step import evaluate
from sdm_deflect.meshing.formats import rewriting
from sdm_deflect.meshing.formats.openfoam import MESH
from sdm_deflect.meshing.formats.registry import FORMATS, in_pieces
from tests import calls
from tests.cases.test_in_pieces import FLAP, written
from tests.limits import limited
from tests.meshing.formats.examples import hybrid
from tests.meshing.formats.wing import wing

OPTIONS = ("--surface", "flap", "--fixed", "wall", "--margin", "0.17", "--no-report", "--repair", "off")
ROOT = Path(__file__).parents[2]
BEFORE = b"what was there"


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """A block with the options that deflect its flap."""
    path = tmp_path_factory.mktemp("block") / "block.cgns"
    write_block(path, 36)
    return path


@pytest.fixture(scope="module", autouse=True)
def small_pieces():
    """Pieces so small that there are some of a small block."""
    with pytest.MonkeyPatch.context() as patch:
        limited(patch, points=6_000, cells=6_000, sent=300, sent_pairs=0)
        patch.setattr(rewriting, "RANGE", 100_003)
        yield


@pytest.fixture(scope="module")
def deflected(block):
    """The bytes of the deflected block as one process has them, from memory and from pieces."""
    assert sdm(block, out(block, "one"))[0] == 0
    with pytest.MonkeyPatch.context() as patch:
        limited(patch, file=1)
        assert sdm(block, out(block, "pieces"))[0] == 0
    found = out(block, "one").read_bytes()
    assert found == out(block, "pieces").read_bytes() != block.read_bytes()
    return found


@pytest.fixture(scope="module")
def two(block):
    """Two workers."""
    with started(2, block) as found:
        yield found


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """The address of a scheduler with a worker, both processes of their own."""
    with scheduler(tmp_path_factory.mktemp("scheduler")) as (address, _), worker(address):
        yield address


@contextmanager
def started(count, block):
    with workers(Stopwatch(), block, block.parent, count=count) as found:
        yield found


@contextmanager
def child(*command, **options):
    with subprocess.Popen(command, stderr=subprocess.DEVNULL, **{"cwd": ROOT, **options}) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def scheduler(folder):
    file = folder / "scheduler.json"
    words = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    with child(sys.executable, "-m", "distributed.cli.dask_scheduler", *words) as process:
        while not (file.exists() and (found := re.search(r"tcp://[\d.:]+", file.read_text()))):
            time.sleep(0.05)
        yield found[0], process


def worker(address, *before, path=""):
    words = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--death-timeout", "20")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(path), str(ROOT)]).lstrip(os.pathsep)}
    command = (*before, sys.executable, "-m", "distributed.cli.dask_worker", address, *words)
    return child(*command, env=environment, cwd=path or ROOT)  # where Python looks first


def out(block, name):
    return block.with_name(f"{name}.cgns")


def sdm(block, to, *more, options=None):
    """Carry out the command in this process; return its code and what it says on the standard error output."""
    options = options or (*OPTIONS, "--table", block.with_suffix(".npz"))
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as said:
        code = calls.sdm("deflect", block, *options, "--no-report", "--out", to, *more)
    return code, said.getvalue()


class Interrupted:
    """A runner that does something once so many results have been taken."""

    shares_memory = False

    def __init__(self, runner, at, deed):
        self.runner, self.at, self.deed, self.taken = runner, sorted(at), deed, 0

    def map(self, work, shared, items):
        for one in self.runner.map(work, shared, items):
            while self.at and self.at[0] <= self.taken:
                self.deed(self.at.pop(0))
            self.taken += 1
            yield one


def deflect(block, to, runner, options=None):
    """Deflect as the command does, with a runner; return its code and what it says."""

    @contextmanager
    def own(*_, **__):
        yield runner

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cluster, "workers", own)
        return sdm(block, to, "--workers", 2, options=options)  # without workers the command takes no runner


def test_two_workers_come_to_the_same_bytes(block, deflected, two):
    assert deflect(block, out(block, "two"), two)[0] == 0
    assert out(block, "two").read_bytes() == deflected


def test_the_script_of_the_guide_comes_to_the_same_bytes(block, deflected, two, monkeypatch):
    @contextmanager
    def own(*_, **__):
        yield two

    monkeypatch.setattr(by_workers, "workers", own)
    table = {"table": str(block.with_suffix(".npz")), "fixed": "wall", "margin": 0.17, "repair": "off"}
    settings = by_workers.settings_of("flap", None, None, table)
    assert by_workers.deflected(block, out(block, "script"), settings, count=2).passed
    assert out(block, "script").read_bytes() == deflected


def test_a_connection_that_is_closed_does_not_end_a_process_that_used_gmsh(block):
    """Gmsh lets SIGPIPE end the process, as Python does not; the sockets of OpenSSL raise that signal."""
    kept = signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    try:
        with workers(Stopwatch(), block, block.parent, count=1):
            assert signal.getsignal(signal.SIGPIPE) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGPIPE, kept)


def test_who_has_not_our_certificate_is_refused(two):
    """Scheduler and workers give nothing to other users of the machine, and their pages are off."""
    ours = psutil.Process()
    ports = {
        one.laddr.port
        for process in (ours, *ours.children(recursive=True))
        for one in process.net_connections("tcp")
        if one.status == psutil.CONN_LISTEN
    }
    addresses = two.client.scheduler.address, *two.client.nthreads()
    assert {int(address.rpartition(":")[2]) for address in addresses} < ports
    for port in ports:
        with pytest.raises(OSError, match=r"404|reset|closed"):
            urlopen(f"http://127.0.0.1:{port}/info/main/workers.html", timeout=5)
    trusting = ssl.create_default_context()
    trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
    for address in addresses:
        port = int(address.rpartition(":")[2])
        for security in (Security.temporary(), None):
            with pytest.raises(OSError):  # noqa: PT011 - in as many words as there are releases of Dask
                Client(address if security else f"tcp://127.0.0.1:{port}", security=security, timeout=1)
        with (
            socket.create_connection(("127.0.0.1", port), 5) as raw,
            pytest.raises(OSError),  # noqa: PT011
            trusting.wrap_socket(raw) as wrapped,
        ):
            wrapped.recv(1)
    assert two.client.submit(sum, (1, 2)).result() == 3


@pytest.mark.nightly
def test_four_workers_of_the_command_come_to_the_same_bytes_and_are_counted(block, deflected):
    code, said = sdm(block, out(block, "four"), "--workers", 4, "--worker-memory", "1.5GB")
    assert code == 0
    assert out(block, "four").read_bytes() == deflected
    assert re.search(r"^workers .* 4 workers$", said, re.MULTILINE), said
    stages = dict.fromkeys(line.split()[0] for line in said.splitlines())  # one that takes long is said several times
    assert [*stages] == ["workers", "read", "plan", "deflect", "quality", "write"]


@pytest.mark.parametrize(
    "suffix",
    [*(pytest.param(one, marks=pytest.mark.nightly) for one in (".lb8.ugrid", ".msh")), pytest.param("", id="case")],
)
def test_other_formats_and_a_repair_come_to_the_same_bytes(suffix, two, tmp_path):
    path = written(wing(cells=3).mesh, tmp_path / f"wing{suffix}")
    words = (*FLAP, "--angles", "4,8", "--repair", "always")
    for name, runner in (("one", HERE), ("two", two)):
        assert deflect(path, tmp_path / f"{name}{suffix}", runner, words)[0] == 0
    for angle in (4, 8):
        meshes = path, *(tmp_path / f"{name}_+{angle}{suffix}" for name in ("one", "two"))
        before, first, second = ((own if suffix else own / MESH / "points").read_bytes() for own in meshes)
        assert first == second != before


@pytest.mark.nightly
def test_killed_workers_lose_nothing(block, deflected, two):
    def kill(_):
        processes = list(two.client.run(os.getpid).values())
        killed.append(processes[len(killed) % len(processes)])
        os.kill(killed[-1], signal.SIGKILL)

    killed, moments = [], np.random.default_rng(0).integers(1, 30, 2).tolist()
    runner = Interrupted(two, moments, kill)
    assert deflect(block, out(block, "killed"), runner)[0] == 0
    assert out(block, "killed").read_bytes() == deflected
    assert len(killed) == 2
    assert runner.taken > 30


def test_sums_have_the_same_bits_whatever_the_chunks(two, monkeypatch):
    rng = np.random.default_rng(1)
    interpolant, points = fit(ThinPlateSpline(), rng.random((301, 3)), rng.random((301, 3))), rng.random((20_001, 3))
    limited(monkeypatch, sent=1_237)
    assert np.array_equal(evaluate(interpolant, points, two), evaluate(interpolant, points, HERE))


def test_an_error_of_a_piece_is_that_of_one_process(block, two, monkeypatch):
    limited(monkeypatch, file=1)
    with in_pieces(block) as mesh:
        own = mesh.pieces.ranges[0]
    place = block.with_name("nan.cgns")
    shutil.copy(block, place)
    with place.open("r+b") as file:
        file.seek(own.table.begin + 8 * 20_000)
        file.write(np.array([np.nan]).tobytes())
    shutil.copy(block.with_suffix(".npz"), place.with_suffix(".npz"))
    code, said = deflect(place, out(block, "never"), two)
    assert (code, said) == (2, f"sdm: {place}: points are not finite, the first is point 20000\n")
    assert deflect(place, out(block, "never"), HERE) == (code, said)


def limit(size):
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))


def test_a_format_without_pieces_is_refused(two, tmp_path, block):
    (tmp_path / "mesh.su2").write_text("NDIME= 3\n")
    wanted = deflect_file.OutputFiles.of(tmp_path / "mesh.su2", None, ((1.0,),))
    with pytest.raises(InputError, match=r"mesh.su2: workers need CGNS files of one .* or convert it"):
        deflect_file.read_needed(wanted, None, lambda *_: None, two)
    wanted = deflect_file.OutputFiles.of(block, block.with_name("out.su2"), ((1.0,),))
    with pytest.raises(InputError, match=r"out.su2: workers write copies of block.cgns alone, and no sensitivity"):
        deflect_file.read_needed(wanted, None, lambda *_: None, two)
    FORMATS["cgns"].write(hybrid(2), tmp_path / "zones.cgns")
    wanted = deflect_file.OutputFiles.of(tmp_path / "zones.cgns", None, ((1.0,),))
    with pytest.raises(InputError, match=r"zones.cgns: workers need CGNS .*, and this file is something else"):
        deflect_file.read_needed(wanted, None, lambda *_: None, two)


def refused(block, *more, code=2, name="refused"):
    """Return the only line that the command says; what stood in the place of the output stays."""
    target = out(block, name)
    target.write_bytes(BEFORE)
    found, said = sdm(block, target, "-q", *more)
    assert (found, said.count("\n")) == (code, 1), said
    assert target.read_bytes() == BEFORE
    assert not list(block.parent.glob(".sdm*"))
    return said.rstrip("\n")


def test_a_scheduler_that_does_not_answer(block, monkeypatch):
    monkeypatch.setattr(cluster, "ANSWER", 1)
    said = refused(block, "--scheduler", "tcp://127.0.0.1:9")
    assert re.fullmatch(
        r"sdm: --scheduler tcp://127.0.0.1:9: no scheduler answers there \(.*\); start one by: dask scheduler", said
    )
    assert "no scheduler answers there (unknown address scheme 'http'" in refused(block, "--scheduler", "http://a:9")
    assert "none.json: no scheduler answers there ([Errno 2] No such file" in refused(block, "--scheduler", "none.json")


def test_a_scheduler_without_workers_and_workers_of_another_version(block, tmp_path, monkeypatch):
    (tmp_path / "sdm_deflect-9.9.dist-info").mkdir()
    (tmp_path / "sdm_deflect-9.9.dist-info" / "METADATA").write_text("Name: sdm-deflect\nVersion: 9.9\n")
    with scheduler(tmp_path) as (address, _):
        with monkeypatch.context() as patch:
            patch.setattr(cluster, "ARRIVAL", 1)
            file = str(tmp_path / "scheduler.json")
            said = refused(block, "--scheduler", file)
            assert said == f"sdm: --scheduler {file}: has no workers; start some by: dask worker {address}"
        with worker(address, path=tmp_path):
            said = refused(block, "--scheduler", address)
            assert re.search(r"worker tcp://\S+ has 9.9 of sdm-deflect, but \S+ is needed: start it in", said), said


def test_a_case_in_a_folder_that_workers_see(elsewhere, tmp_path):
    case = written(wing(cells=3).mesh, tmp_path / "case")
    words = (*FLAP, "--angle", "8", "--quiet")
    code, said = sdm(case, tmp_path / "there", "--scheduler", elsewhere, options=words)
    assert code == 0, said
    assert sdm(case, tmp_path / "here", options=words)[0] == 0
    first, second = ((tmp_path / name / MESH / "points").read_bytes() for name in ("there", "here"))
    assert first == second


def test_workers_of_another_python(block, elsewhere, monkeypatch):
    own = platform.python_version()
    monkeypatch.setattr(platform, "_sys_version", lambda *_: ("CPython", "3.99.1"))
    assert f" has {own} of Python, but 3.99.1 is needed" in refused(block, "--scheduler", elsewhere)


HIDING = """import pathlib
seen = pathlib.Path.stat

def stat(self, **given):
    if str(self) == {hidden!r}:
        raise FileNotFoundError(2, "No such file or directory", str(self))
    return seen(self, **given)

pathlib.Path.stat = stat
"""


@pytest.mark.nightly
def test_workers_that_do_not_see_the_file(block, tmp_path):
    (tmp_path / "sitecustomize.py").write_text(HIDING.format(hidden=str(block)))
    cover = ("env", f"PYTHONPATH={os.pathsep.join([str(tmp_path), *sys.path])}")
    with scheduler(tmp_path) as (address, _), worker(address), worker(address, *cover):
        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=120)
        said = refused(block, "--scheduler", address)
    assert re.fullmatch(
        rf"sdm: 1 of 2 workers cannot read {block} \(No such file or directory\), such as tcp://\S+: put it on a file "
        r"system that all of them see",
        said,
    ), said


@pytest.mark.nightly
def test_a_scheduler_that_goes_away(block, deflected, tmp_path, monkeypatch):
    with scheduler(tmp_path) as (address, process), worker(address):
        assert sdm(block, out(block, "far"), "--scheduler", address)[0] == 0
        assert out(block, "far").read_bytes() == deflected
        ours = Cluster.map
        monkeypatch.setattr(Cluster, "map", lambda self, *given: Interrupted(Plain(self), [20], end).map(*given))

        class Plain:
            def __init__(self, found):
                self.map = lambda *given: ours(found, *given)

        def end(_):
            process.kill()
            process.wait()

        said = refused(block, "--scheduler", address, code=1)
    assert said == f"sdm: the scheduler at {address} is gone: start it again, and then this command"


@pytest.mark.nightly
def test_workers_are_gone_when_the_command_is_killed(block):
    table = str(block.with_suffix(".npz"))
    words = ["deflect", str(block), *OPTIONS, "--table", table, "--out", str(out(block, "never")), "--workers", "2"]
    command = [sys.executable, "-c", "from sdm_deflect.cases.cli import main; main()", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, cwd=ROOT) as process:
        line = process.stderr.readline()
        assert line.startswith("workers "), line
        children = psutil.Process(process.pid).children(recursive=True)
        assert len(children) >= 3
        process.kill()
        said = process.stderr.read()  # until the last of them is gone
    assert "\n" not in said.strip(), said
    assert psutil.wait_procs(children, timeout=5)[1] == []


@pytest.mark.parametrize("library", ["distributed", "cryptography"])
def test_without_the_library_the_command_says_what_to_install(library, block, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    assert refused(block, "--workers", "2").endswith(": in your clone, pip install '.[cluster]'")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--workers", "2", "--scheduler", "tcp://a:1"), "--workers starts processes here and --scheduler joins"),
        (("--worker-memory", "2GB"), "--worker-memory is for workers that are started here: give --workers as well"),
        (("--workers", "1", "--worker-memory", "much"), "--worker-memory much: must be a size such as 2GB"),
        (("--workers", "1", "--worker-memory", "2"), "--worker-memory 2: must be a size such as 2GB, and at least 400"),
    ],
)
def test_options_that_do_not_fit(options, said, block):
    assert refused(block, *options).startswith(f"sdm: {said}")
