"""Files and folders that appear completely or not at all: written to a hidden folder beside their place, then renamed.

An existing folder is exchanged for the new one; if the system cannot do that, it is NAME.old meanwhile. No command but
`sdm doctor` touches the hidden folder of another; its lock tells whether its process still runs.
"""

import ctypes
import json
import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from fnmatch import fnmatchcase
from functools import reduce
from operator import and_
from pathlib import Path

from .errors import REQUESTS, MeshFileError, errors_for, write_errors

# Begin and end of the names of hidden folders, with eight letters between.
NAME, END = ".sdm-deflect-", ".tmp"
# The locked file; the file that names the folder NAME.old; the end of that name.
LOCK, NOTE, OLD = ".lock", ".note", ".old"
# The locked file before it is locked.
UNLOCKED = ".locking"
# Files of a case whose permissions count for its copy.
MESHES = ("points*", "constant/polyMesh/*", "processor*/constant/polyMesh/*")
placed: list[Path] = []  # what this process has put in its place
_hidden: set[Path] = set()
_permitted = ContextVar("_permitted", default=0o7777)


@contextmanager
def permitted_as(*sources: Path | str | None) -> Iterator[None]:
    """Limit the permissions of new files and folders in this block to those of the sources."""
    token = _permitted.set(reduce(and_, (_permissions(Path(source)) for source in sources if source), _permitted.get()))
    try:
        yield
    finally:
        _permitted.reset(token)


def _permissions(source: Path) -> int:
    """Return the permissions that a copy of a file, folder or case may have; its owner may have all."""
    mode = 0o7777
    for path in (source, *(path for pattern in MESHES for path in source.glob(pattern))):
        with suppress(OSError):
            shared = path.stat().st_mode & 0o066
            mode &= 0o7700 | shared | (shared & 0o044) >> 2
    return mode


@contextmanager
def hidden_folder(beside: Path | None = None) -> Iterator[Path]:
    """Yield a hidden folder that only its owner can read, by default in the system's temporary folder."""
    home, place = Path(os.path.realpath(beside or tempfile.gettempdir())), Path()
    home.mkdir(parents=True, exist_ok=True)
    try:
        with without_signals():
            place = Path(tempfile.mkdtemp(END, NAME, home))
            _hidden.add(place)
        with (place / UNLOCKED).open("xb") as lock:
            with suppress(OSError, ModuleNotFoundError):  # where there are no locks, nobody removes the folder
                import fcntl

                fcntl.flock(lock, fcntl.LOCK_EX)
            with suppress(OSError):  # it has its name only when it is locked; Windows renames no open file
                Path(lock.name).rename(place / LOCK)
            yield place
    finally:
        with without_signals():
            if place in _hidden:
                _remove(place)
                _hidden.discard(place)


def _remove(place: Path) -> None:
    """Remove a hidden folder. Its lock goes last, for the lock shows whose folder it is if this process is killed."""
    with suppress(OSError):
        for inner in place.iterdir():
            if inner.is_dir() and not inner.is_symlink():
                shutil.rmtree(inner, ignore_errors=True)
            elif inner.name != LOCK:
                inner.unlink()
    shutil.rmtree(place, ignore_errors=True)


@contextmanager
def without_signals() -> Iterator[None]:
    """Delay signals that ask to end until the end of the block."""
    came, before = list[int](), {}
    with suppress(ValueError):  # not the main thread
        before = {request: signal.signal(request, lambda number, _: came.append(number)) for request in REQUESTS}
    try:
        yield
    finally:
        for request, handler in before.items():
            signal.signal(request, handler)
        for number in came:
            signal.raise_signal(number)


@contextmanager
def fresh(out: Path, *sources: Path | None, earlier: Callable[[Path], bool] | None = None) -> Iterator[Path]:
    """Yield a path that becomes `out`, or the target of that link, in the end; MeshFileError if it cannot be written.

    Parameters
    ----------
    out : The file to write.
    sources : Input files; `out` must be none of them, and gets no more permissions than they have.
    earlier : Returns whether a file is an earlier result; only such files may be replaced. None: any file may be.
    """
    if out.exists() and any(source is not None and source.exists() and out.samefile(source) for source in sources):
        raise MeshFileError(f"{out}: this is the mesh that is read; write to another file")
    if out.exists() and not out.is_file():
        raise MeshFileError(f"{out}: is there and no file; name another one")
    if earlier and out.exists() and out.stat().st_size and not earlier(out):
        raise MeshFileError(f"{out}: is there, and this program did not write it; delete it, or name another file")
    with write_errors(out), permitted_as(*sources), replacing(out) as beside:
        beside.touch()
        yield beside


@contextmanager
def fresh_folder(out: Path, source: Path | None = None) -> Iterator[Path]:
    """Yield an empty folder that becomes `out` once the block has ended well.

    MeshFileError if `out` exists and is not empty, lies within the folder `source`, or cannot be made.
    """
    if source is not None and out.resolve().is_relative_to(source.resolve()):
        raise MeshFileError(f"{out}: lies in the case that is read; write to a folder outside it")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise MeshFileError(f"{out}: exists already; name a new folder, or delete that one")
    with write_errors(out), permitted_as(source), replacing(out) as beside:
        beside.mkdir(exist_ok=True)
        yield beside


@contextmanager
def replacing(out: Path, stale: Sequence[str] = ()) -> Iterator[Path]:
    """Yield a path that replaces `out` when the block ends well; it is `out` itself if that is in a hidden folder.

    Files of an old folder stay, unless the new folder has the same name, or the name matches a pattern in `stale`, such
    as ``figures/slices*.png``. OSError or MeshFileError if it cannot be written.
    """
    target = Path(os.path.realpath(out))
    if not _hidden.isdisjoint(target.parents):
        yield out
        return
    with hidden_folder(target.parent) as place, errors_for(place / target.name, out):
        yield place / target.name
        with write_errors(out):
            _put(place, {place / target.name: target}, stale)


@contextmanager
def replacing_files(folder: Path, stale: Sequence[str]) -> Iterator[Path]:
    """Yield an empty folder whose files and folders replace those of `folder` one after another, each as a whole.

    `stale` has patterns for `folder` and for each folder in it; errors are those of `replacing`.
    """
    home = Path(os.path.realpath(folder))
    with hidden_folder(home) as place, errors_for(place / "new", folder):
        (place / "new").mkdir()
        yield place / "new"
        moves = {new: Path(os.path.realpath(home / new.name)) for new in sorted((place / "new").iterdir())}
        with write_errors(folder):
            _put(place, moves, stale)


@contextmanager
def replacing_together(folder: Path) -> Iterator[tuple[Path, dict[Path, Path]]]:
    """Yield a hidden folder in `folder`, and a table to fill with each new file in it and its final place.

    At the end all take their places in the table's order; errors are those of `replacing`.
    """
    with hidden_folder(folder) as place, errors_for(place, folder):
        moves: dict[Path, Path] = {}
        yield place, moves
        with write_errors(folder):
            _put(place, moves, ())


def _put(place: Path, moves: Mapping[Path, Path], stale: Sequence[str]) -> None:
    """Put new files and folders in the places of old ones, once all are on the disk; OSError if impossible."""
    for new, old in moves.items():
        _prepare(new, old)
        if new.is_dir() and old.is_dir():
            _keep(new, old, stale)
            for folder in (new, *new.rglob("*/")):
                _flush(folder)
    with without_signals():
        for new, old in moves.items():
            if new.is_dir() and old.is_dir():
                _exchange(new, old, place / NOTE)
            else:
                new.replace(old)
            placed.append(old)
            _flush(old.parent)


def _prepare(new: Path, old: Path) -> None:
    """Set a new file's or folder's permissions to the old one's, or those permitted, and flush it to the disk."""
    mode = _permitted.get() & (_permissions(old) if old.is_dir() else 0o7777)
    for path in (new, *new.rglob("*")):
        target = old / path.relative_to(new)
        if target.is_dir() and not path.is_dir():
            raise MeshFileError(f"{target}: is a folder; a file of that name is to be written")
        if not path.is_symlink():
            path.chmod(target.stat().st_mode if target.exists() else path.stat().st_mode & mode)
            _flush(path)


def _flush(path: Path) -> None:
    """Flush a file or a folder to the disk; Windows has no handles of folders."""
    if os.name == "posix":
        handle = os.open(path, os.O_RDONLY)
        os.fsync(handle)
        os.close(handle)


def _keep(new: Path, old: Path, stale: Sequence[str]) -> None:
    """Move the user's files from the old folder to the new: those that are neither among the new ones nor stale."""
    patterns = [*stale, *(str(Path(pattern).parent) for pattern in stale)]
    for path in sorted(old.rglob("*")):
        name, place = path.relative_to(old), new / path.relative_to(old)
        gone = any(fnmatchcase(str(own), pattern) for own in (name, old.name / name) for pattern in patterns)
        if path.is_dir() and not path.is_symlink():
            if not gone and not place.exists():
                place.mkdir(mode=path.stat().st_mode)
        elif not gone and not os.path.lexists(place):
            place.parent.mkdir(exist_ok=True)
            try:
                os.link(path, place, follow_symlinks=False)
            except (OSError, AttributeError):  # a file system without hard links, or another user's file
                shutil.copy2(path, place, follow_symlinks=False)


def _exchange(new: Path, old: Path, note: Path) -> None:
    """Exchange a new folder and an old one, or else rename both; the file `note` is read by `sdm doctor`."""
    rename = getattr(ctypes.CDLL(None), "renameat2", None) if os.name == "posix" else None
    if rename and not rename(-100, os.fsencode(new), -100, os.fsencode(old), 2):  # AT_FDCWD; RENAME_EXCHANGE
        return
    aside = old.with_name(old.name + OLD)
    while os.path.lexists(aside):
        aside = aside.with_name(aside.name + OLD)
    note.write_text(json.dumps([old.stat().st_ino, aside.name, old.name]), encoding="utf-8")
    old.rename(aside)
    try:
        new.rename(old)
    except OSError:
        aside.rename(old)
        raise
    shutil.rmtree(aside, ignore_errors=True)
