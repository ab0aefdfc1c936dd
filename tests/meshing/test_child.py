import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.meshing import child
from sdm_deflect.meshing.child import MeshingError

WORKER = """
import os, sys, time
from collections.abc import Iterator
from pathlib import Path
import numpy as np
from sdm_deflect.meshing.child import serve

def work(question):
    if "note" in question:
        Path(str(question["note"])).write_text(str(os.getpid()))
    print("noise")
    time.sleep(float(question.get("sleep", 0.0)))
    if "fail" in question:
        raise RuntimeError("no luck")
    return {"double": 2.0 * question["x"]}

serve(work)
"""


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "some_worker.py").write_text(WORKER)
    monkeypatch.syspath_prepend(tmp_path)
    return "some_worker"


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def pid_in(note: Path) -> int:
    deadline = time.monotonic() + 60.0
    while not (note.exists() and note.read_text()):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return int(note.read_text())


def test_arrays_go_there_and_back(worker: str, capfd: pytest.CaptureFixture[str]) -> None:
    answer = child.call(worker, {"x": np.array([1.0, 2.0])}, 60.0)
    assert np.array_equal(answer["double"], [2.0, 4.0])
    assert 1e6 < answer["peak_bytes"] < 1e9
    assert capfd.readouterr() == ("", "")


def test_failures_carry_the_last_line(worker: str) -> None:
    with pytest.raises(MeshingError, match="some_worker ended with code 1: RuntimeError: no luck"):
        child.call(worker, {"fail": np.array(1)}, 60.0)
    with pytest.raises(MeshingError, match="No module named no_worker"):
        child.call("no_worker", {}, 60.0)


def test_this_process_goes_on_while_the_child_works(worker: str) -> None:
    with child.start(worker, {"x": np.array([3.0]), "sleep": np.array(0.5)}) as pending:
        assert pending.process.poll() is None
        assert np.array_equal(pending.answer(60.0)["double"], [6.0])


def test_an_answer_that_nobody_waits_for_is_dropped_at_once(worker: str, tmp_path: Path) -> None:
    note, before = tmp_path / "pid", time.monotonic()
    with child.start(worker, {"sleep": np.array(60.0), "note": np.array(str(note))}) as pending:
        pid = pid_in(note)
    assert not alive(pid)
    assert not pending.folder.exists()
    assert time.monotonic() - before < 30.0


def test_a_time_limit_holds(worker: str, tmp_path: Path) -> None:
    with pytest.raises(MeshingError, match="took more than"):
        child.call(worker, {"sleep": np.array(60.0), "note": np.array(str(tmp_path / "pid"))}, 1.5)
    note = tmp_path / "pid"
    assert not note.exists() or not alive(int(note.read_text()))


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Let SIGINT raise KeyboardInterrupt, also where the shell that runs the tests ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interruption_takes_effect_at_once_and_leaves_no_child(worker: str, tmp_path: Path) -> None:
    note = tmp_path / "pid"
    when: list[float] = []

    def interrupt() -> None:
        pid_in(note)
        when.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        child.call(worker, {"sleep": np.array(60.0), "note": np.array(str(note))}, 60.0)
    assert time.monotonic() - when[0] < 5.0  # of 60
    thread.join()
    assert not alive(int(note.read_text()))


def test_the_child_dies_with_a_parent_that_is_killed(worker: str, tmp_path: Path) -> None:
    note = tmp_path / "pid"
    script = (
        "import numpy as np; from sdm_deflect.meshing import child; "
        f"child.call({worker!r}, {{'sleep': np.array(60.0), 'note': np.array({str(note)!r})}}, 60.0)"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path)}
    parent = subprocess.Popen([sys.executable, "-c", script], env=environment)
    pid = pid_in(note)
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 60.0
    while alive(pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not alive(pid)
