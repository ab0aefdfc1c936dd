"""Files and folders that appear whole or not at all, and what killed processes leave of them.

Everything is written into a temporary folder beside its target, flushed to the disk, then renamed. A folder that is
there already changes places with the new one in one step; where the system cannot do that, and for several targets,
a journal lists the renames, and whoever next looks into the folder finishes them.
"""

import ctypes
import json
import os
import re
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any
from zlib import crc32

from sdm_deflect.meshing.formats.format import MeshFileError, about
from sdm_deflect.meshing.watchers import watchers

BESIDE, SCRATCH = ".sdm-", "sdm-deflect-"
"""Beginnings of the names of temporary folders: beside a target, and in the system's folder for such."""
MARKED = re.compile(r"(?:\.sdm|sdm-deflect)-([0-9a-f]{8})-(\d+)-(\d+)-\w+")
"""Machine, process and its start in the name of a temporary folder."""
JOURNAL = "journal.json"
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


@contextmanager
def fresh(out: Path, source: Path | None = None) -> Iterator[Path]:
    """Give a path to write to that becomes `out` once the block has ended well; a link is followed.

    MeshFileError if `out` is the file `source`, no file, or cannot be written.
    """
    if source is not None and out.exists() and out.samefile(source):
        raise MeshFileError(f"{out}: this is the mesh that is read; write to another file")
    if out.exists() and not out.is_file():
        raise MeshFileError(f"{out}: is there and no file; name another one")
    with written(out), _replacing(out, committing) as beside:
        yield beside


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a path to write to that becomes `path` once the block has ended well; OSError if that cannot be."""
    with _replacing(path, _quietly) as beside:
        yield beside


@contextmanager
def _replacing(path: Path, held: Callable[[Path], Any]) -> Iterator[Path]:
    if _is_temporary(path):  # it appears with the folder around it
        path.touch()
        yield path
        return
    target = Path(os.path.realpath(path))
    target.parent.mkdir(parents=True, exist_ok=True)
    with staging(target.parent) as folder, renamed(folder / target.name, path):
        beside = folder / target.name
        beside.touch()
        yield beside
        _flush(beside)
        with held(path):
            beside.replace(target)
        _flush(target.parent)


@contextmanager
def fresh_folder(out: Path, source: Path | None = None) -> Iterator[Path]:
    """Give an empty folder that becomes `out` once the block has ended well.

    MeshFileError if `out` is there and not empty, lies within the folder `source`, or cannot be made.
    """
    if source is not None and out.resolve().is_relative_to(source.resolve()):
        raise MeshFileError(f"{out}: lies in the case that is read; write to a folder outside it")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise MeshFileError(f"{out}: exists already; name a new folder, or delete that one")
    with written(out):
        if _is_temporary(out):
            out.mkdir(exist_ok=True)
            yield out
            return
        with replacing_folder(out, ()) as beside:
            yield beside


@contextmanager
def replacing_folder(out: Path, stale: Sequence[str]) -> Iterator[Path]:
    """Give an empty folder that replaces the folder `out` as one once the block has ended well; a link is followed.

    Parameters
    ----------
    out : A folder; it need not be there.
    stale : Patterns such as ``figures/slices*.png``: files of the old folder that go. All others are kept, unless the
        new folder has a file of that name.

    Raises
    ------
    OSError, MeshFileError
        If the folder cannot be written, its file system is full for example.
    """
    target = Path(os.path.realpath(out))
    target.parent.mkdir(parents=True, exist_ok=True)
    settle(target)
    inside = target.is_dir() and (_is_mounted(target) or not os.access(target.parent, os.W_OK))
    with staging(target if inside else target.parent) as folder:
        beside = folder / target.name
        beside.mkdir()
        with renamed(beside, out):
            yield beside
            with written(out):
                commit(folder, [_folder(beside, target, stale)], [out])


@contextmanager
def replacing_files(folder: Path, stale: Sequence[str]) -> Iterator[Path]:
    """Give an empty folder whose files and folders replace those of the same names in `folder` together.

    `stale` and errors are those of `replacing_folder`, for each folder in it.
    """
    home = Path(os.path.realpath(folder))
    home.mkdir(parents=True, exist_ok=True)
    with staging(home) as temporary:
        beside = temporary / "new"
        beside.mkdir()
        with renamed(beside, folder):
            yield beside
            names = sorted(path.name for path in beside.iterdir())
            pairs = [(beside / name, Path(os.path.realpath(home / name))) for name in names]
            if far := [new for new, old in pairs if old.parent.stat().st_dev != home.stat().st_dev]:
                raise MeshFileError(f"{far[0]}: is a link to another file system; name the file itself")
            with written(folder):
                moves = [_folder(new, old, stale) if new.is_dir() else Move(new, old) for new, old in pairs]
                commit(temporary, moves, [folder / name for name in names])


@contextmanager
def written(out: Path) -> Iterator[None]:
    """Name `out` in errors of writing it.

    MeshFileError in place of an OSError, as ``"out: cannot be written: why"``.
    """
    try:
        yield
    except OSError as error:
        raise MeshFileError(f"{out}: cannot be written: {error.strerror or error}") from error


@contextmanager
def renamed(beside: Path, out: Path) -> Iterator[None]:
    """Name `out` in errors of what is written for it at `beside`."""
    try:
        yield
    except MeshFileError as error:
        raise MeshFileError(str(error).replace(str(beside), str(out))) from error


@contextmanager
def staging(folder: Path, begin: str = BESIDE) -> Iterator[Path]:
    """Give a temporary folder in `folder` that is removed at the end, after those of processes that are gone.

    It stays only if it holds the journal of what could not be finished.
    """
    settle_in(folder)
    name = Path(tempfile.mkdtemp(prefix=f"{begin}{_machine()}-{os.getpid()}-{_start(os.getpid()) or 0}-", dir=folder))
    try:
        yield name
    finally:
        if not (name / JOURNAL).exists():
            shutil.rmtree(name, ignore_errors=True)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Give a folder among the system's temporary ones that is removed at the end, after those of processes gone."""
    with staging(Path(tempfile.gettempdir()), SCRATCH) as folder:
        yield folder


def settle(folder: Path) -> None:
    """Finish what a process that is gone was about to replace in a folder, and remove what else it left there.

    MeshFileError if a replacement is unfinished and cannot be finished.
    """
    place = Path(os.path.realpath(folder))
    settle_in(place)
    settle_in(place.parent)


def settle_in(folder: Path) -> None:
    """As `settle`, of what lies in this folder alone."""
    with suppress(OSError), os.scandir(folder) as entries:
        names = [entry.name for entry in entries if MARKED.fullmatch(entry.name)]
        for left in (folder / name for name in names):
            if _is_left(left):
                _settled(left)


def _settled(left: Path) -> None:
    if (left / JOURNAL).exists():
        try:
            _carry_out(left, _listed(left), again=True)
            (left / JOURNAL).unlink()
        except OSError as error:
            why = f"{error.filename}: {error.strerror}"
            raise MeshFileError(f"{left.parent}: an earlier replacement cannot be finished: {why}") from error
    shutil.rmtree(left, ignore_errors=True)


def _is_left(path: Path) -> bool:
    """Whether a temporary folder is ours, and its process gone."""
    found = MARKED.fullmatch(path.name)
    with suppress(FileNotFoundError):
        status = path.lstat()
        own = path.is_dir() and not path.is_symlink() and status.st_uid == os.geteuid()
        return bool(own and found and found[1] == _machine() and _start(int(found[2])) != int(found[3]))
    return False


def _is_temporary(path: Path) -> bool:
    """Whether a path lies in a temporary folder of this process."""
    own = f"{_machine()}-{os.getpid()}-"
    return any(MARKED.fullmatch(part) and own in part for part in path.absolute().parent.parts)


def _machine() -> str:
    """Digest of the machine's name and of the space in which its processes have their numbers."""
    space = ""
    with suppress(OSError):
        space = str(Path("/proc/self/ns/pid").readlink())
    return f"{crc32(f'{os.uname().nodename} {space}'.encode()):08x}"


def _start(process: int) -> int | None:
    """When a process started, in the system's own unit (0 where that is not told); None if it is gone."""
    try:
        state, *rest = Path(f"/proc/{process}/stat").read_text(errors="replace").rpartition(") ")[2].split()
        return None if state in "ZX" else int(rest[18])
    except FileNotFoundError:
        if Path("/proc/self/stat").exists():
            return None
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return None
    except PermissionError:
        pass
    return 0


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
        list(pool.map(_flush, everything))
    if not moves:
        return
    with ExitStack() as held:
        for name in names:
            held.enter_context(committing(name))
        if len(moves) == 1 and _at_once(moves[0]):
            _flush(moves[0].target.parent)
            return
        _note(folder, moves)
        _carry_out(folder, moves)
        for parent in {one.target.parent for one in moves}:
            _flush(parent)
        (folder / JOURNAL).unlink()


def _folder(staged: Path, target: Path, patterns: Sequence[str]) -> Move:
    """Move a new folder to its place, with what users keep in the old one."""
    if not target.is_dir():
        return Move(staged, target)
    here = [Path(name, file).relative_to(target) for name, _, files in os.walk(target) for file in files]
    own = [path for path in here if not MARKED.fullmatch(path.parts[0])]
    stale = [path for path in own if any(fnmatchcase(path.as_posix(), pattern) for pattern in patterns)]
    others = [path for path in own if path not in set(stale) and not (staged / path).exists()]
    gone = tuple(path.as_posix() for path in stale if not (staged / path).exists())
    return Move(staged, target, gone, _can_exchange(target) and _linked(others, target, staged, patterns))


def _can_exchange(target: Path) -> bool:
    """Whether no process works in a folder, nothing is mounted there, and it is our own."""
    return target.stat().st_uid == os.geteuid() and not _is_mounted(target) and not _is_worked_in(target)


def _linked(others: Sequence[Path], target: Path, staged: Path, patterns: Sequence[str]) -> bool:
    """Put files of an old folder into the new one as well; False if it holds folders of the user's, or has no links."""
    ours = {target / Path(pattern).parent for pattern in patterns}
    folders = [Path(name, one) for name, inner, _ in os.walk(target) for one in inner]
    if any(one not in ours or one.is_symlink() for one in folders):
        return False
    try:
        for path in others:
            (staged / path).parent.mkdir(exist_ok=True)
            os.link(target / path, staged / path, follow_symlinks=False)
        shutil.copystat(target, staged)
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
    _flush(unfinished)
    unfinished.rename(folder / JOURNAL)
    _flush(folder)


def _listed(folder: Path) -> list[Move]:
    """Return what the journal of a temporary folder lists and is not done."""
    rows = json.loads((folder / JOURNAL).read_text(encoding="utf-8"))
    left = [row for row in rows if (folder / row["staged"]).exists()]
    left = [row for row in left if (folder / row["staged"]).stat().st_ino == row["inode"]]
    return [Move(folder / row["staged"], folder.parent / row["target"], tuple(row["stale"])) for row in left]


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


@contextmanager
def _quietly(_: Path) -> Iterator[None]:
    yield


def _exchange(one: Path, other: Path) -> bool:
    """Let two folders change places in one step; False if the system or the file system cannot do that."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    return rename is not None and not rename(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _EXCHANGE)


def _is_mounted(folder: Path) -> bool:
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


def _flush(path: Path) -> None:
    """Bring a file or a folder to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def copied(source: Path, into: Path, without: tuple[str, ...]) -> None:
    """Copy all that a folder holds but names of the patterns `without`.

    Links become what they point to, so that a later change of the copy cannot reach the source.
    """
    with about(source):
        for name, folders, files in os.walk(source, onerror=_raised, followlinks=True):
            folders[:] = [folder for folder in folders if not any(fnmatchcase(folder, pattern) for pattern in without)]
            here = into / Path(name).relative_to(source)
            here.mkdir(exist_ok=True)
            for path in (Path(name, file) for file in files):
                if path.exists():
                    shutil.copy2(path, here)


def _raised(error: OSError) -> None:
    raise error
