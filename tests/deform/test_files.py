"""Files and folders appear whole or not at all, whenever a process ends, and `sdm doctor` clears what is left."""

import ctypes
import os
import shutil
import signal
import stat
from pathlib import Path

import pytest

from sdm_deflect.base import files
from sdm_deflect.base.errors import REQUESTS, MeshFileError
from sdm_deflect.base.files import END, NAME, fresh, hidden_folder, permitted_as, replacing, replacing_files
from sdm_deflect.cases.cli import examination

STALE = ("page.html", "figures/old*.png")
OLD = {"page.html": "old", "figures/old1.png": "old", "figures/mine.png": "mine", "notes.txt": "mine", "data": "old"}
NEW = {"data": "new", "figures/new.png": "new"}
KEPT = {"figures/mine.png": "mine", "notes.txt": "mine"}
pytestmark = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")


def put(folder: Path, content: dict[str, str]) -> Path:
    for name, text in content.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def found(folder: Path) -> dict[str, str]:
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()}


def in_child(work) -> None:
    """Do work in another process, which ends without tidying up."""
    if not (child := os.fork()):
        try:
            work()
        finally:
            os._exit(9)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9


def doctor(folder: Path) -> str:
    """Clear up in a folder, also what was made just now and not locked."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(examination, "YOUNG", 0.0)
        patch.setattr("tempfile.tempdir", str(folder))
        return examination.leftovers(folder).text


def leave(folder: Path, content: dict[str, str]) -> None:
    with hidden_folder(folder) as place:
        put(place, content)
        os._exit(9)


def without_exchange(monkeypatch) -> None:
    """A file system, or a system, that exchanges no folders."""
    monkeypatch.setattr(ctypes, "CDLL", lambda _: object())


@pytest.mark.parametrize("error", [None, ValueError, KeyboardInterrupt])
def test_the_file_appears_only_when_the_block_ends_well(tmp_path, error):
    target = put(tmp_path, {"a.txt": "old"}) / "a.txt"

    def write() -> None:
        with fresh(target) as beside:
            assert beside.suffix == ".txt"
            beside.write_text("new")
            assert target.read_text() == "old"
            if error:
                raise error

    if error:
        with pytest.raises(error):
            write()
    else:
        write()
    assert found(tmp_path) == {"a.txt": "old" if error else "new"}


def test_only_files_are_replaced_and_links_are_followed(tmp_path):
    (tmp_path / "far").mkdir()
    link = tmp_path / "a.txt"
    link.symlink_to(Path("far", "b.txt"))
    with fresh(link) as beside:
        beside.write_text("whole")
    assert link.is_symlink()
    assert (tmp_path / "far" / "b.txt").read_text() == "whole"
    for path in (tmp_path / "far", Path("/dev/null")):
        with pytest.raises(MeshFileError, match=f"{path}: is there and no file"), fresh(path):
            pass


@pytest.mark.parametrize("way", ["exchanged", "two renames", "no hard links", "link"])
def test_a_folder_is_replaced_but_for_what_the_user_keeps_in_it(way, tmp_path, monkeypatch):
    target = put(tmp_path / "run", OLD | {"case/0/U": "mine"})
    (tmp_path / "run" / "far").symlink_to("notes.txt")
    if way == "two renames":
        without_exchange(monkeypatch)
    elif way == "no hard links":
        monkeypatch.delattr(os, "link")
        monkeypatch.setattr(os, "link", lambda *_, **__: (_ for _ in ()).throw(PermissionError()), raising=False)
    elif way == "link":
        target = tmp_path / "link"
        target.symlink_to("run")
    with replacing(target, STALE) as beside:
        beside.mkdir()
        put(beside, NEW)
        assert found(tmp_path / "run") == OLD | {"case/0/U": "mine", "far": "mine"}
    assert found(target) == KEPT | NEW | {"case/0/U": "mine", "far": "mine"}
    assert (tmp_path / "run" / "far").is_symlink()
    assert {path.name for path in tmp_path.iterdir()} == {"run", target.name}


def test_the_old_folder_stays_if_the_new_one_cannot_take_its_place(tmp_path, monkeypatch):
    target, rename = put(tmp_path / "run", OLD), Path.rename

    def refused(old, new):
        if new == target and old.name != "run.old":
            raise PermissionError
        return rename(old, new)

    without_exchange(monkeypatch)
    monkeypatch.setattr(Path, "rename", refused)
    with pytest.raises(MeshFileError, match="cannot be written"), replacing(target, STALE) as beside:
        beside.mkdir()
    assert found(tmp_path) == {f"run/{name}": text for name, text in OLD.items()}


def mortal(monkeypatch, after: int) -> None:
    """Let this process end at its next step, a rename, link or removal, once it has done `after` of them."""
    left = iter(range(after))

    def step(real):
        def counted(*arguments, **options):
            if next(left, None) is None:
                os._exit(9)
            return real(*arguments, **options)

        return counted

    class Library:
        renameat2 = staticmethod(step(lambda *given: ctypes.PyDLL(None).renameat2(*given)))

    monkeypatch.setattr(ctypes, "CDLL", lambda _: Library)
    for owner, names in ((os, "rename replace link rmdir"), (Path, "rename replace unlink")):
        for name in names.split():
            monkeypatch.setattr(owner, name, step(getattr(owner, name)))


@pytest.mark.parametrize("exchange", [True, False])
@pytest.mark.parametrize("again", [False, True])
def test_each_target_is_the_old_or_the_new_one_whenever_a_process_is_killed(again, exchange, tmp_path, monkeypatch):
    """A process ends at each step in turn, and the doctor who clears up after it as well."""
    new = {f"run/{name}": text for name, text in NEW.items()} | {"mesh": "new", "wing/case": "new"}
    old = {f"run/{name}": text for name, text in OLD.items()} | {"mesh": "old"}
    whole = {f"run/{name}": text for name, text in (NEW | KEPT).items()}

    def replace(home: Path, after: int) -> None:
        mortal(monkeypatch, after)
        if not exchange:
            without_exchange(monkeypatch)
        with replacing_files(home, STALE) as beside:
            put(beside, new)

    def clear_and_die(home: Path) -> None:
        mortal(monkeypatch, 1)
        doctor(home)

    seen = set()
    for after in range(16):
        home = put(tmp_path / str(after), old)
        in_child(lambda home=home, after=after: replace(home, after))
        before = {name for name in found(home) if not name.startswith(".")}
        assert {"run/notes.txt", "run.old/notes.txt"} & before  # a person finds the last run without help
        if again:
            in_child(lambda home=home: clear_and_die(home))
        doctor(home)
        now = found(home)
        run = {name: text for name, text in now.items() if name.startswith("run/")}
        assert run in (whole, {name: text for name, text in old.items() if name.startswith("run/")})
        assert (now["mesh"], now.get("wing/case")) in (("old", None), ("new", None), ("new", "new"))
        assert {path.name for path in home.iterdir()} <= {"run", "mesh", "wing"}
        seen.add((run == whole, now["mesh"], "wing/case" in now))
    assert seen == {(False, "old", False), (False, "new", False), (True, "new", False), (True, "new", True)}


def test_what_a_killed_process_left_stays_until_the_doctor_comes(tmp_path, monkeypatch):
    here, there = tmp_path / "here", tmp_path / "there"
    monkeypatch.setattr("tempfile.tempdir", str(there))
    for folder in (here, there):
        folder.mkdir()
        in_child(lambda folder=folder: leave(folder, OLD))
    with hidden_folder(here) as own, fresh(here / "new"):
        assert [len(list(folder.iterdir())) for folder in (here, there)] == [3, 1]  # no command touches another's
        text = examination.leftovers(here).text
        assert text.count("removed") == 2
        assert f"in use, or not ours: {own}" in text or f", {own}" in text
        assert len(list(here.iterdir())) == 2
    assert {path.name for path in tmp_path.rglob("*")} == {"here", "there", "new"}


def test_the_doctor_leaves_alone_what_is_no_hidden_folder_of_this_user(tmp_path):
    """A hidden folder in an archive of somebody's: nothing that its links and notes point to is touched."""
    home, case = put(tmp_path / "home", {"thesis.tex": "mine"}), put(tmp_path / "case", {"thesis.old/a": "mine"})
    for i, name in enumerate((files.NOTE, files.LOCK, "other")):
        put(case / f"{NAME}0000000{i}{END}", {} if name == files.LOCK else {files.LOCK: ""})
        (case / f"{NAME}0000000{i}{END}").mkdir(exist_ok=True)
        (case / f"{NAME}0000000{i}{END}" / name).symlink_to(home)
    (case / f"{NAME}link0000{END}").symlink_to(home)
    put(case, {".sdm-notes/mine": "mine", f"{NAME}notes": "mine"})
    for i, note in enumerate(('[1, "thesis.old", "thesis"]', '[1, "../home", "x"]', "[1]", "{", '["", "", ""]')):
        put(case / f"{NAME}note000{i}{END}", {files.LOCK: "", files.NOTE: note})
    for i, name in enumerate((files.LOCK, files.NOTE)):
        place = put(case / f"{NAME}pipe000{i}{END}", {"a": ""} if name == files.LOCK else {files.LOCK: ""})
        os.mkfifo(place / name)
    text = doctor(case)
    assert found(home) == {"thesis.tex": "mine"}
    left = {path.name for path in case.iterdir()}
    hidden = {f"{NAME}{name}{END}" for name in ("link0000", "00000001", "pipe0000")}
    assert left == {".sdm-notes", f"{NAME}notes", "thesis.old", *hidden}
    assert f"in use, or not ours: {case / f'{NAME}00000001{END}'}" in text


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files to others")
def test_nobody_touches_the_hidden_folder_of_another_user(tmp_path):
    place = put(tmp_path / f"{NAME}00000000{END}", {files.LOCK: "", "a": "theirs"})
    for path in (place, place / files.LOCK, place / "a"):
        os.chown(path, 65534, 65534)
    assert "in use, or not ours" in doctor(tmp_path)
    with hidden_folder(tmp_path), fresh(tmp_path / "new"):
        pass
    assert found(place) == {files.LOCK: "", "a": "theirs"}


def test_a_pipe_in_a_hidden_folder_stops_no_command(tmp_path):
    (tmp_path / f"{NAME}00000000{END}").mkdir()
    os.mkfifo(tmp_path / f"{NAME}00000000{END}" / files.LOCK)
    with fresh(tmp_path / "new"):
        pass
    assert "in use, or not ours" in doctor(tmp_path)


def test_a_folder_of_the_users_that_is_called_old_stays(tmp_path, monkeypatch):
    without_exchange(monkeypatch)
    put(tmp_path / "run.old", {"a": "mine"})
    target = put(tmp_path / "run", OLD)
    with replacing(target, STALE) as beside:
        put(beside, NEW)
    doctor(tmp_path)
    assert found(tmp_path / "run.old") == {"a": "mine"}
    assert found(target) == KEPT | NEW
    assert {path.name for path in tmp_path.iterdir()} == {"run", "run.old"}


@pytest.mark.parametrize("number", REQUESTS)
def test_a_signal_while_a_hidden_folder_goes_leaves_nothing_of_it(number, tmp_path, monkeypatch):
    def interrupted(*given, **more):
        signal.raise_signal(number)
        remove(*given, **more)

    def asked(*_):
        raise KeyboardInterrupt

    remove, before = shutil.rmtree, signal.signal(number, asked)
    monkeypatch.setattr(shutil, "rmtree", interrupted)
    with pytest.raises(KeyboardInterrupt), hidden_folder(tmp_path) as place:
        put(place, OLD)
    signal.signal(number, before)
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_on_the_disk_before_it_takes_its_place(tmp_path, monkeypatch):
    flushed, flush = [], os.fsync

    def noted(handle):
        flushed.append(Path(f"/proc/self/fd/{handle}").readlink())
        flush(handle)

    monkeypatch.setattr(os, "fsync", noted)
    with replacing_files(tmp_path / "out", STALE) as folder:
        put(folder, NEW)
    assert {folder / name for name in NEW} | {tmp_path / "out"} <= set(flushed)


@pytest.mark.parametrize("exchange", [True, False])
def test_a_signal_waits_until_a_target_is_replaced(exchange, tmp_path, monkeypatch):
    def interrupted(new, old, aside):
        signal.raise_signal(signal.SIGINT)
        exchanged(new, old, aside)

    exchanged = files._exchange
    monkeypatch.setattr(files, "_exchange", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    put(tmp_path / "run", OLD)
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "run", STALE) as beside:
        put(beside, NEW)
    signal.signal(signal.SIGINT, before)
    assert found(tmp_path) == {f"run/{name}": text for name, text in (NEW | KEPT).items()}
    assert files.placed[-1] == tmp_path / "run"


def modes(folder: Path) -> dict[str, str]:
    paths = [folder, *folder.rglob("*")]
    return {path.relative_to(folder).as_posix(): f"{stat.S_IMODE(path.stat().st_mode):o}" for path in paths}


@pytest.mark.parametrize(
    ("mode", "umask", "file", "folder"),
    [
        (0o600, 0o022, "600", "700"),
        (0o640, 0o022, "640", "750"),
        (0o444, 0o022, "644", "755"),
        (0o666, 0o077, "600", "700"),
    ],
)
def test_what_is_new_is_as_private_as_its_source(mode, umask, file, folder, tmp_path):
    source = put(tmp_path, {"source": "mesh"}) / "source"
    source.chmod(mode)
    before = os.umask(umask)
    try:
        with fresh(tmp_path / "copy", source) as beside:
            assert stat.S_IMODE(beside.parent.stat().st_mode) == 0o700
        with permitted_as(source), replacing_files(tmp_path / "out", STALE) as beside:
            put(beside, {"mesh": "new", "run/figures/a.png": "new"})
    finally:
        os.umask(before)
    now = modes(tmp_path)
    assert now["copy"] == file
    inside = {name.removeprefix("out/"): one for name, one in now.items() if name.startswith("out/")}
    assert inside == {"mesh": file, "run": folder, "run/figures": folder, "run/figures/a.png": file}


def test_what_is_replaced_keeps_its_permissions(tmp_path):
    home = put(tmp_path, {"mesh": "old", "other": "old"} | {f"run/{name}": text for name, text in OLD.items()})
    for name, mode in {"mesh": 0o600, "run": 0o710, "run/data": 0o640, "run/notes.txt": 0o666}.items():
        (home / name).chmod(mode)
    (home / "source").touch(0o644)
    with permitted_as(home / "source"), replacing_files(home, STALE) as beside:
        put(beside, {"mesh": "new", "run/data": "new", "run/page.html": "new", "run/more": "new"})
    now = modes(home)
    assert [now[name] for name in ("mesh", "run", "run/data", "run/notes.txt")] == ["600", "710", "640", "666"]
    assert now["run/more"] == "600"
    assert (home / "mesh").read_text() == "new"


def test_doctor_leaves_a_folder_that_is_about_to_be_locked(tmp_path, monkeypatch):
    """Between its making and its lock nothing may take it."""
    import fcntl

    real = fcntl.flock

    def late(lock, how):
        if how == fcntl.LOCK_EX:
            examination.leftovers(tmp_path)
        return real(lock, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with files.hidden_folder(tmp_path) as place:
        (place / "kept").touch()
        assert (place / files.LOCK).exists()
