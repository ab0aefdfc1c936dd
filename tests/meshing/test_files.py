import json
import os
import signal
import stat
from errno import EPERM
from pathlib import Path

import pytest

from sdm_deflect.meshing.files import staged as files
from sdm_deflect.meshing.files.staged import fresh, permitted_as, replacing, replacing_files, replacing_folder
from sdm_deflect.meshing.files.temporary import registered, scratch_folder, staging
from sdm_deflect.meshing.formats.format import MeshFileError

STALE = ("page.html", "figures/old*.png")
OLD = {"page.html": "old", "figures/old1.png": "old", "figures/mine.png": "mine", "notes.txt": "mine", "data": "old"}
NEW = {"data": "new", "figures/new.png": "new"}
KEPT = {"figures/mine.png": "mine", "notes.txt": "mine"}


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


def refuse(*_, **__) -> None:
    raise OSError(EPERM, os.strerror(EPERM))


def left_in(folder: Path) -> Path:
    """Return what a process leaves that is killed while it writes into a folder."""

    def leave() -> None:
        with staging(folder) as name:
            put(name, OLD)
            os._exit(9)

    in_child(leave)
    (left,) = folder.glob(".sdm-*")
    return left


def next_command(folder: Path) -> None:
    with staging(folder):
        pass


@pytest.fixture(autouse=True)
def state(tmp_path_factory, monkeypatch) -> Path:
    """A register of each test's own."""
    home = tmp_path_factory.mktemp("state")
    monkeypatch.setenv("XDG_STATE_HOME", str(home))
    return home / "sdm-deflect" / "temporary"


pytestmark = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")


def test_the_file_appears_only_when_the_block_ends_well(tmp_path: Path) -> None:
    target = tmp_path / "new" / "a.txt"
    with replacing(target) as beside:
        assert beside.suffix == ".txt"
        beside.write_text("whole")
        assert not target.exists()
    assert target.read_text() == "whole"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_interruption_leaves_the_old_file_and_no_other(tmp_path: Path, error: type[BaseException]) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")

    def write_half() -> None:
        with replacing(target) as beside:
            beside.write_text("half")
            raise error

    with pytest.raises(error):
        write_half()
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_only_files_are_replaced_and_links_are_followed(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    link = tmp_path / "a.txt"
    link.symlink_to(Path("far", "b.txt"))
    with fresh(link) as beside:
        beside.write_text("whole")
    assert link.is_symlink()
    assert (tmp_path / "far" / "b.txt").read_text() == "whole"
    with pytest.raises(MeshFileError, match="far: is there and no file"), fresh(tmp_path / "far"):
        pass
    with pytest.raises(MeshFileError, match="/dev/null: is there and no file"), fresh(Path("/dev/null")):
        pass


@pytest.mark.parametrize(
    "way", ["swapped", "no hard links", "mount point", "working folder", "folder of the user's in it", "link"]
)
def test_a_folder_is_replaced_but_for_what_the_user_keeps_in_it(way, tmp_path, monkeypatch) -> None:
    old = target = put(tmp_path / "run", OLD)
    kept = KEPT | NEW
    before = old.stat().st_ino
    if way == "no hard links":
        monkeypatch.setattr(os, "link", refuse)
    elif way == "mount point":
        monkeypatch.setattr(files, "_is_mounted", lambda _: True)
    elif way == "working folder":
        monkeypatch.chdir(old / "figures")
    elif way == "link":
        target = tmp_path / "link"
        target.symlink_to("run")
    elif way != "swapped":
        put(old, {"case/0/U": "mine"})
        kept = kept | {"case/0/U": "mine"}
    with replacing_folder(target, STALE) as beside:
        put(beside, NEW)
        mine = {name: text for name, text in kept.items() if text == "mine"}
        assert {name: text for name, text in found(old).items() if ".sdm-" not in name} == OLD | mine
    assert found(target) == kept
    assert (old.stat().st_ino != before) == (way in ("swapped", "link"))
    assert {path.name for path in tmp_path.iterdir()} == {"run", target.name}


def test_what_the_user_writes_while_a_folder_is_replaced_is_kept(tmp_path, monkeypatch) -> None:
    """A file is changed, and others appear, after the user's files were linked and before the old folder is aside."""
    target, rename = put(tmp_path / "run", OLD), Path.rename

    def late(old, new):
        if old == target:
            (target / "notes.txt").rename(target / "notes~")
            put(target, {"notes.txt": "changed", "more/notes.txt": "mine", "figures/more.txt": "mine"})
        return rename(old, new)

    monkeypatch.setattr(Path, "rename", late)
    with replacing_folder(target, STALE) as beside:
        put(beside, NEW)
    late_files = {"notes.txt": "changed", "notes~": "mine", "more/notes.txt": "mine", "figures/more.txt": "mine"}
    assert found(target) == KEPT | NEW | late_files
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_the_old_folder_stays_if_the_new_one_cannot_take_its_place(tmp_path, monkeypatch) -> None:
    target, rename = put(tmp_path / "run", OLD), Path.rename
    before = target.stat().st_ino

    def refused(old, new):
        return refuse() if new == target and old.parent != target.parent else rename(old, new)

    monkeypatch.setattr(Path, "rename", refused)
    with replacing_folder(target, STALE) as beside:
        put(beside, NEW)
    assert target.stat().st_ino == before
    assert found(tmp_path) == {f"run/{name}": text for name, text in (NEW | KEPT).items()}


def test_a_folder_whose_writing_fails_stays(tmp_path: Path) -> None:
    def write_half() -> None:
        with replacing_folder(tmp_path / "run", STALE) as beside:
            put(beside, NEW)
            raise KeyboardInterrupt

    put(tmp_path / "run", OLD)
    with pytest.raises(KeyboardInterrupt):
        write_half()
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

    for owner, names in ((os, "rename replace link rmdir"), (Path, "rename replace unlink")):
        for name in names.split():
            monkeypatch.setattr(owner, name, step(getattr(owner, name)))


@pytest.mark.parametrize(("again", "steps"), [(False, range(19)), (True, range(5, 9))])
def test_each_target_is_the_old_or_the_new_one_whenever_a_process_is_killed(
    again, steps, tmp_path, monkeypatch, state
) -> None:
    """A process ends at each step in turn, and the one that clears up after it as well."""
    new = {f"run/{name}": text for name, text in NEW.items()} | {"mesh": "new", "wing/case": "new"}
    old = {f"run/{name}": text for name, text in OLD.items()} | {"mesh": "old"}
    whole = {f"run/{name}": text for name, text in (NEW | KEPT).items()}

    def replace(home: Path, after: int) -> None:
        mortal(monkeypatch, after)
        with replacing_files(home, STALE) as beside:
            put(beside, new)

    def clear_and_die(home: Path) -> None:
        mortal(monkeypatch, 1)
        next_command(home)

    seen = set()
    for after in steps:
        home = put(tmp_path / str(after), old)
        in_child(lambda home=home, after=after: replace(home, after))
        if again:
            in_child(lambda home=home: clear_and_die(home))
        next_command(home)
        now = found(home)
        run = {name: text for name, text in now.items() if name.startswith("run/")}
        assert run in (whole, {name: text for name, text in old.items() if name.startswith("run/")})
        assert (now["mesh"], now.get("wing/case")) in (("old", None), ("new", None), ("new", "new"))
        assert not list(home.glob(".*"))
        seen.add((run == whole, now["mesh"], "wing/case" in now))
    some = {(False, "new", False), (True, "new", False)}
    assert seen == (some if again else some | {(False, "old", False), (True, "new", True)})
    assert not list(state.iterdir())


def test_what_a_killed_process_left_goes_with_the_next_that_writes_there(tmp_path: Path, monkeypatch) -> None:
    here, there = tmp_path / "here", tmp_path / "there"

    def leave_scratch() -> None:
        with scratch_folder():
            os._exit(9)

    for folder in (here, there):
        folder.mkdir()
        monkeypatch.setattr("tempfile.tempdir", str(folder))
        left_in(folder)
        in_child(leave_scratch)
    with scratch_folder():  # what only reads needs this, and removes nothing
        pass
    assert [len(list(folder.iterdir())) for folder in (here, there)] == [2, 2]
    monkeypatch.setattr("tempfile.tempdir", str(here))
    next_command(here)
    assert [len(list(folder.iterdir())) for folder in (here, there)] == [0, 2]


def test_what_is_in_no_register_stays(tmp_path: Path, state: Path) -> None:
    """A folder of a running process, of a stranger, or of another machine; or that is not the registered one."""
    left = left_in(tmp_path)
    left.rename(tmp_path / "moved")
    put(left, {"thesis": "mine"})
    strange = put(tmp_path / ".sdm-0123456789abcdef", {"journal.json": "[]", "mesh": "stranger's"})
    before = found(tmp_path)
    with staging(tmp_path) as own:
        next_command(tmp_path)
        assert own.is_dir()
    assert found(tmp_path) == before
    (entry,) = state.iterdir()
    row = {"machine": "another", "path": str(strange), "inode": strange.stat().st_ino}
    entry.write_text(json.dumps(row) + "\n")
    next_command(tmp_path)
    assert found(tmp_path) == before
    entry.write_text(json.dumps(row | {"machine": os.uname().nodename}) + "\n")
    next_command(tmp_path)
    assert not strange.exists()


@pytest.mark.parametrize("there", ["nothing", "new", "other"])
def test_a_folder_put_aside_comes_back_only_where_nothing_is(there: str, tmp_path: Path) -> None:
    target, aside, new = (put(tmp_path / name, {"who": name}) for name in ("run", ".sdm-aside", "new"))

    def leave() -> None:
        with registered(aside, aside.stat().st_ino, target=str(target), new=new.stat().st_ino):
            os._exit(9)

    in_child(leave)
    target.rename(tmp_path / "other")
    if there != "nothing":
        (tmp_path / there).rename(target)
    next_command(tmp_path)
    assert found(target) == {"who": {"nothing": ".sdm-aside", "new": "new", "other": "run"}[there]}
    assert aside.exists() == (there == "other")


@pytest.mark.parametrize("register", ["no folder", "open to others", "a link"])
def test_without_a_private_register_all_works_and_nothing_is_cleared(register, tmp_path, state) -> None:
    left = left_in(tmp_path)
    if register == "open to others":
        state.chmod(0o755)
    else:
        state.rename(state.with_name("moved"))
        state.touch() if register == "no folder" else state.symlink_to("moved")
    with replacing(tmp_path / "mesh") as beside:
        beside.write_text("new")
    with replacing_folder(put(tmp_path / "run", OLD), STALE) as beside:
        put(beside, NEW)
    assert (tmp_path / "mesh").read_text() == "new"
    assert found(tmp_path / "run") == NEW | KEPT
    assert left.exists()


def test_a_file_is_on_the_disk_before_it_takes_its_place(tmp_path: Path, monkeypatch) -> None:
    flushed, flush = [], os.fsync

    def noted(handle):
        flushed.append(Path(f"/proc/self/fd/{handle}").readlink())
        flush(handle)

    monkeypatch.setattr(os, "fsync", noted)
    with fresh(tmp_path / "mesh.su2") as beside:
        beside.write_text("a mesh")
    assert beside in flushed
    with replacing_folder(tmp_path / "run", STALE) as folder:
        put(folder, NEW)
    assert {folder / name for name in NEW} <= set(flushed)


@pytest.fixture
def interruptible():
    """SIGINT raises KeyboardInterrupt, also where the tests were started in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_a_signal_waits_until_a_target_is_replaced(tmp_path: Path, monkeypatch, interruptible) -> None:
    told = []
    monkeypatch.setattr(files, "watchers", [lambda path, whole: told.append((path.name, whole))])
    rename = Path.rename

    def interrupted(old, new):
        signal.raise_signal(signal.SIGINT)
        return rename(old, new)

    monkeypatch.setattr(Path, "rename", interrupted)
    put(tmp_path / "run", OLD)
    with pytest.raises(KeyboardInterrupt), replacing_folder(tmp_path / "run", STALE) as beside:
        put(beside, NEW)
    assert found(tmp_path / "run") == NEW | KEPT
    assert told == [("run", False), ("run", True)]


def modes(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): f"{stat.S_IMODE(path.stat().st_mode):o}"
        for path in [folder, *folder.rglob("*")]
    }


@pytest.mark.parametrize(
    ("mode", "umask", "file", "folder"),
    [
        (0o600, 0o022, "600", "700"),
        (0o640, 0o022, "640", "750"),
        (0o444, 0o022, "644", "755"),
        (0o666, 0o077, "600", "700"),
    ],
)
def test_what_is_new_is_as_private_as_its_source(mode, umask, file, folder, tmp_path) -> None:
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
    del source
    now = modes(tmp_path)
    assert now["copy"] == file
    inside = {name.removeprefix("out/"): one for name, one in now.items() if name.startswith("out/")}
    assert inside == {"mesh": file, "run": folder, "run/figures": folder, "run/figures/a.png": file}


def test_what_is_replaced_keeps_its_permissions_and_owner(tmp_path: Path) -> None:
    home = put(tmp_path, {"mesh": "old", "other": "old"} | {f"run/{name}": text for name, text in OLD.items()})
    for name, mode in {"mesh": 0o600, "run": 0o710, "run/data": 0o640, "run/notes.txt": 0o666}.items():
        (home / name).chmod(mode)
    owner = (65534, 65534) if not os.geteuid() else (os.geteuid(), os.getegid())
    os.chown(home / "mesh", *owner)
    (home / "source").touch(0o644)
    with permitted_as(home / "source"), replacing_files(home, STALE) as beside:
        put(beside, {"mesh": "new", "run/data": "new", "run/page.html": "new", "run/more": "new"})
    now = modes(home)
    assert [now[name] for name in ("mesh", "run", "run/data", "run/notes.txt")] == ["600", "710", "640", "666"]
    assert now["run/more"] == "600"
    assert ((home / "mesh").stat().st_uid, (home / "mesh").stat().st_gid) == owner
    assert (home / "mesh").read_text() == "new"
