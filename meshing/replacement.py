"""New files and folders take the places of old ones, in one step or by a journal that outlives a killed process."""

import ctypes
import json
import os
import shutil
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.watchers import watchers

JOURNAL = "journal.json"
"""In a temporary folder: what of it is to be renamed, once all of it is on the disk."""
HELD = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals that wait while targets are replaced."""
_AT_FDCWD, _EXCHANGE = -100, 2


@dataclass(frozen=True, slots=True)
class Move:
    """What is renamed to what, and the files (relative) of an old folder that go then.

    `exchanged` says that an old folder may change places with the new one.
    """

    staged: Path
    target: Path
    stale: tuple[str, ...] = ()
    exchanged: bool = False


def commit(folder: Path, moves: Sequence[Move], names: Sequence[Path]) -> None:
    """Rename what lies in a temporary folder to its targets: all of it, now or, if this process is killed, later.

    Parameters
    ----------
    folder : That of `staging`.
    moves : What is renamed.
    names : What users call the targets.

    Raises
    ------
    OSError
        If it cannot be written, or a rename is refused.
    """
    for move in moves:
        if move.staged.is_dir() and (bad := [path for path in _places(move).values() if path.is_dir()]):
            raise MeshFileError(f"{bad[0]}: is a folder; a file of that name is to be written")
    everything = [Path(name, file) for name, _, files in os.walk(folder) for file in (*files, "")]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(flush, everything))
    if not moves:
        return
    with ExitStack() as held:
        for name in names:
            held.enter_context(committing(name))
        if len(moves) == 1 and _at_once(moves[0]):
            flush(moves[0].target.parent)
            return
        _note(folder, moves)
        _carry_out(folder, moves)
        for parent in {one.target.parent for one in moves}:
            flush(parent)
        (folder / JOURNAL).unlink()


def moved_folder(staged: Path, target: Path, patterns: Sequence[str]) -> Move:
    """Move a new folder to its place, with what users keep in the old one."""
    if not target.is_dir():
        return Move(staged, target)
    here = [Path(name, file).relative_to(target) for name, _, files in os.walk(target) for file in files]
    stale = [path for path in here if any(fnmatchcase(path.as_posix(), pattern) for pattern in patterns)]
    others = [path for path in here if path not in set(stale) and not (staged / path).exists()]
    gone = tuple(path.as_posix() for path in stale if not (staged / path).exists())
    return Move(staged, target, gone, _can_exchange(target) and _linked(others, target, staged, patterns))


def _can_exchange(target: Path) -> bool:
    """Whether no process works in a folder, nothing is mounted there, and it is our own."""
    return target.stat().st_uid == os.geteuid() and not is_mounted(target) and not _is_worked_in(target)


def _linked(others: Sequence[Path], target: Path, staged: Path, patterns: Sequence[str]) -> bool:
    """Put files of an old folder into the new one as well; False if it holds folders of the user's, or has no links."""
    ours = {Path(pattern).parent for pattern in patterns}
    folders = [Path(name, one).relative_to(target) for name, inner, _ in os.walk(target) for one in inner]
    if any((target / one).is_symlink() or not (one in ours or (staged / one).is_dir()) for one in folders):
        return False
    try:
        for path in others:
            (staged / path).parent.mkdir(exist_ok=True)
            os.link(target / path, staged / path, follow_symlinks=False)
        shutil.copystat(target, staged)
        os.utime(staged)
    except OSError:
        return False
    return True


def _places(move: Move) -> dict[Path, Path]:
    """Return where each file of a new folder goes."""
    found = (Path(name, file) for name, _, files in os.walk(move.staged) for file in files)
    return {path: move.target / path.relative_to(move.staged) for path in found}


def _at_once(move: Move) -> bool:
    """Carry out a move in one step, if that can be."""
    if move.staged.is_dir() and move.target.is_dir():
        return move.exchanged and _exchange(move.staged, move.target)
    move.staged.replace(move.target)
    return True


def _carry_out(folder: Path, moves: Sequence[Move], again: bool = False) -> None:
    """Rename everything that has not been; what is left of moves that were begun is renamed file by file."""
    for move in moves:
        if not move.staged.exists() or (not again and _at_once(move)):
            continue
        if not (move.staged.is_dir() and move.target.is_dir()):
            _at_once(move)
            continue
        for path, place in _places(move).items():
            place.parent.mkdir(parents=True, exist_ok=True)
            path.replace(place)
        for old in (move.target / name for name in move.stale):
            old.unlink(missing_ok=True)
            with suppress(OSError):
                old.parent.rmdir()


def _note(folder: Path, moves: Sequence[Move]) -> None:
    """Write the journal of a temporary folder; what was renamed has another inode, or is not there."""
    rows = [
        {
            "staged": str(move.staged.relative_to(folder)),
            "inode": move.staged.stat().st_ino,
            "target": os.path.relpath(move.target, folder.parent),
            "stale": move.stale,
        }
        for move in moves
    ]
    unfinished = folder / "journal"
    unfinished.write_text(json.dumps(rows), encoding="utf-8")
    flush(unfinished)
    unfinished.rename(folder / JOURNAL)
    flush(folder)


def _listed(folder: Path) -> list[Move]:
    """Return what the journal of a temporary folder lists and is not done."""
    rows = json.loads((folder / JOURNAL).read_text(encoding="utf-8"))
    left = [row for row in rows if (folder / row["staged"]).exists()]
    left = [row for row in left if (folder / row["staged"]).stat().st_ino == row["inode"]]
    return [Move(folder / row["staged"], folder.parent / row["target"], tuple(row["stale"])) for row in left]


def finish(folder: Path) -> None:
    """Carry out the rest of a journal, if there is one in a temporary folder; OSError if that cannot be."""
    if (folder / JOURNAL).exists():
        _carry_out(folder, _listed(folder), again=True)
        (folder / JOURNAL).unlink()


@contextmanager
def committing(target: Path) -> Iterator[None]:
    """Hold the signals that end a process until `target` is replaced, and tell `watchers`."""
    came: list[int] = []
    kept: dict[int, Any] = {}
    try:
        if threading.current_thread() is threading.main_thread():
            for number in (getattr(signal, name) for name in HELD if hasattr(signal, name)):
                if signal.getsignal(number) not in (signal.SIG_IGN, None):
                    kept[number] = signal.signal(number, lambda given, _: came.append(given))
        for watch in watchers:
            watch(target, False)
        yield
        for watch in watchers:
            watch(target, True)
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
        for number in came:
            signal.raise_signal(number)


def _exchange(one: Path, other: Path) -> bool:
    """Let two folders change places in one step; False if the system or the file system cannot do that."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    return rename is not None and not rename(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _EXCHANGE)


def is_mounted(folder: Path) -> bool:
    """Whether a folder is where something is mounted."""
    try:
        lines = Path("/proc/self/mountinfo").read_text(errors="replace").splitlines()
    except OSError:
        return folder.is_mount()
    return any(line.split()[4] == str(folder) for line in lines)


def _is_worked_in(folder: Path) -> bool:
    """Whether a folder, or one in it, is the working folder of a process."""
    works = set()
    with suppress(OSError):
        works.add(Path.cwd())
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            works.add((process / "cwd").readlink())
    return any(work.is_relative_to(folder) for work in works)


def flush(path: Path) -> None:
    """Bring a file or a folder to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
