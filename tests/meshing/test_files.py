import os
import signal
from pathlib import Path

import pytest

from sdm_deflect.meshing import replacement, temporary
from sdm_deflect.meshing.files import fresh, replacing, replacing_files, replacing_folder
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.replacement import Move, commit
from sdm_deflect.meshing.temporary import settle, staging

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


@pytest.mark.parametrize("way", ["exchanged", "file by file", "working folder", "folder of the user's in it", "link"])
def test_a_folder_is_replaced_but_for_what_the_user_keeps_in_it(way, tmp_path, monkeypatch) -> None:
    old = target = put(tmp_path / "run", OLD)
    kept = KEPT | NEW
    before = old.stat().st_ino
    if way == "file by file":
        monkeypatch.setattr(replacement, "_exchange", lambda *_: False)
    elif way == "working folder":
        monkeypatch.chdir(old / "figures")
    elif way == "link":
        target = tmp_path / "link"
        target.symlink_to("run")
    elif way != "exchanged":
        put(old, {"case/0/U": "mine"})
        kept = kept | {"case/0/U": "mine"}
    with replacing_folder(target, STALE) as beside:
        put(beside, NEW)
        assert found(old) == OLD | {name: text for name, text in kept.items() if text == "mine"}
    assert found(target) == kept
    assert (old.stat().st_ino != before) == (way in ("exchanged", "link"))
    assert {path.name for path in tmp_path.iterdir()} == {"run", target.name}


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
    """Let this process end at its next step, a rename or a removal, once it has done `after` of them."""
    left = iter(range(after))

    def step(real):
        def counted(*arguments, **options):
            if next(left, None) is None:
                os._exit(9)
            return real(*arguments, **options)

        return counted

    for owner, name in ((Path, "rename"), (Path, "replace"), (Path, "unlink"), (replacement, "_exchange")):
        monkeypatch.setattr(owner, name, step(getattr(owner, name)))


@pytest.mark.parametrize("exchange", [True, False])
def test_what_a_kill_leaves_half_renamed_is_finished_at_the_next_start(exchange, tmp_path, monkeypatch) -> None:
    """A process ends at each rename and each removal in turn; so does the one after it, which settles what it left."""
    new = {f"run/{name}": text for name, text in NEW.items()} | {"mesh": "new", "wing/case": "new"}
    old = {f"run/{name}": text for name, text in OLD.items()} | {"mesh": "old"}
    if not exchange:
        monkeypatch.setattr(replacement, "_exchange", lambda *_: False)

    def replace(home: Path, after: int) -> None:
        mortal(monkeypatch, after)
        with replacing_files(home, STALE) as beside:
            put(beside, new)

    def settle_and_die(home: Path) -> None:
        mortal(monkeypatch, 1)
        settle(home)

    for after in range(9):
        home = put(tmp_path / str(after), old)
        in_child(lambda home=home, after=after: replace(home, after))
        in_child(lambda home=home: settle_and_die(home))
        settle(home)
        assert found(home) == (new | {f"run/{name}": text for name, text in KEPT.items()} if after else old)
        assert not list(home.glob(".*"))


def test_leftovers_of_processes_that_are_gone_are_cleared_and_no_others(tmp_path: Path) -> None:
    def leave() -> None:
        with staging(tmp_path) as folder:
            put(folder, OLD)
            os._exit(9)

    in_child(leave)
    (left,) = tmp_path.iterdir()
    machine = left.name.removeprefix(temporary.BESIDE).partition("-")[0]
    others = [left.name.replace(machine, "00000000"), ".sdm-notes", f".sdm-{machine}-1-x"]
    for name in others:
        (tmp_path / name).mkdir()
    with staging(tmp_path) as own:
        settle(tmp_path)
        assert sorted(path.name for path in tmp_path.iterdir()) == sorted([own.name, *others])
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(others)


@pytest.mark.parametrize("journal", ["[", "5", "[{}]", '[{"staged": "mesh", "inode": 5}]', "\x00"])
def test_a_journal_that_is_damaged_is_named(journal: str, tmp_path: Path) -> None:
    def leave() -> None:
        with staging(tmp_path) as folder:
            put(folder, {"journal.json": journal, "mesh": "new"})

    in_child(leave)
    (left,) = tmp_path.iterdir()
    if "inode" in journal:
        (left / "journal.json").write_text(journal.replace("5", str((left / "mesh").stat().st_ino)))
    with pytest.raises(MeshFileError, match=f"journal.json: is damaged; delete the folder {left.name}"):
        settle(tmp_path)
    assert list(tmp_path.iterdir()) == [left]


def test_a_signal_waits_until_a_target_is_replaced(tmp_path: Path, monkeypatch) -> None:
    told = []
    monkeypatch.setattr(replacement, "watchers", [lambda path, whole: told.append((path.name, whole))])

    def exchange(*_):
        signal.raise_signal(signal.SIGINT)
        return False

    monkeypatch.setattr(replacement, "_exchange", exchange)
    put(tmp_path / "run", OLD)
    with staging(tmp_path) as folder:
        put(folder / "run", NEW)
        with pytest.raises(KeyboardInterrupt):
            commit(folder, [Move(folder / "run", tmp_path / "run", exchanged=True)], [Path("run")])
    assert found(tmp_path / "run") == OLD | NEW
    assert told == [("run", False), ("run", True)]
