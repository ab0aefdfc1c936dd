"""Files and folders that appear whole or not at all.

Everything is staged in a hidden folder beside its target, brought to the disk, and put in place by one rename. A folder
that is there already goes aside before, and back if the new one cannot take its place. Of several targets all are
staged before the first is put in place. What is new has the permissions of what it replaces, else of its source.
"""

import os
import shutil
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from errno import ENOTDIR
from fnmatch import fnmatchcase
from itertools import product
from pathlib import Path
from stat import S_IMODE
from typing import Any

from sdm_deflect.meshing.files.orphan import watchers
from sdm_deflect.meshing.files.temporary import clear, is_temporary, registered, staging, unused
from sdm_deflect.meshing.formats.format import MeshFileError, WriteError, about

HELD = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that wait while targets are replaced."""
MESHES = ("points*", "constant/polyMesh/*", "processor*/constant/polyMesh/*")
"""Files of a case whose permissions count, whatever its folder has."""
_permitted = ContextVar("_permitted", default=0o7777)


@contextmanager
def permitted_as(*sources: Path | str | None) -> Iterator[None]:
    """Withhold new files and folders that are written in this block from those who may not read or write a source."""
    mode = _permitted.get()
    for source in sources:
        mode &= _permissions(Path(source)) if source else mode
    token = _permitted.set(mode)
    try:
        yield
    finally:
        _permitted.reset(token)


def _permissions(source: Path) -> int:
    """Return the permissions that a copy of a file, a folder or a case may have: any for its owner."""
    mode = 0o7777
    for path in (source, *(path for pattern in MESHES for path in source.glob(pattern))):
        with suppress(OSError):
            shared = path.stat().st_mode & 0o066
            mode &= 0o7700 | shared | (shared & 0o044) >> 2
    return mode


@contextmanager
def fresh(out: Path, source: Path | None = None) -> Iterator[Path]:
    """Give a path to write to that becomes `out` once the block has ended well; a link is followed.

    MeshFileError if `out` is the file `source`, no file, or cannot be written.
    """
    if source is not None and out.exists() and out.samefile(source):
        raise MeshFileError(f"{out}: this is the mesh that is read; write to another file")
    if out.exists() and not out.is_file():
        raise MeshFileError(f"{out}: is there and no file; name another one")
    with written(out), permitted_as(source), replacing(out, [out]) as beside:
        yield beside


@contextmanager
def replacing(path: Path, watched: Sequence[Path] = ()) -> Iterator[Path]:
    """Give a path to write to that becomes `path` once the block has ended well; OSError if that cannot be.

    `watchers` hear of the names `watched`.
    """
    if is_temporary(path):  # it appears with the folder around it
        path.touch()
        yield path
        return
    target = Path(os.path.realpath(path))
    target.parent.mkdir(parents=True, exist_ok=True)
    with staging(target.parent) as folder, renamed(folder / target.name, path):
        beside = folder / target.name
        beside.touch()
        yield beside
        _put({beside: target}, watched)


@contextmanager
def fresh_folder(out: Path, source: Path | None = None) -> Iterator[Path]:
    """Give an empty folder that becomes `out` once the block has ended well.

    MeshFileError if `out` is there and not empty, lies within the folder `source`, or cannot be made.
    """
    if source is not None and out.resolve().is_relative_to(source.resolve()):
        raise MeshFileError(f"{out}: lies in the case that is read; write to a folder outside it")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise MeshFileError(f"{out}: exists already; name a new folder, or delete that one")
    with written(out), permitted_as(source):
        if is_temporary(out):
            out.mkdir(exist_ok=True)
            yield out
            return
        with replacing_folder(out, ()) as beside:
            yield beside


@contextmanager
def replacing_folder(out: Path, stale: Sequence[str]) -> Iterator[Path]:
    """Give an empty folder that replaces the folder `out` as one once the block has ended well; a link is followed.

    Where the old folder has to stay (see `_aside`), its files are replaced one by one.

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
    if target.exists() and not target.is_dir():
        raise NotADirectoryError(ENOTDIR, os.strerror(ENOTDIR), str(out))
    target.parent.mkdir(parents=True, exist_ok=True)
    clear(target.parent)
    inside = target.is_dir() and (_is_mounted(target) or not os.access(target.parent, os.W_OK))
    with staging(target if inside else target.parent) as folder:
        beside = folder / target.name
        beside.mkdir()
        with renamed(beside, out):
            yield beside
            with written(out):
                _put({beside: target}, [out], stale)


@contextmanager
def replacing_files(folder: Path, stale: Sequence[str]) -> Iterator[Path]:
    """Give an empty folder whose files and folders replace those of the same names in `folder`, one after another.

    `stale` and errors are those of `replacing_folder`, for each folder in it.
    """
    home = Path(os.path.realpath(folder))
    home.mkdir(parents=True, exist_ok=True)
    with staging(home) as beside, renamed(beside, folder):
        yield beside
        names = sorted(path.name for path in beside.iterdir())
        moves = {beside / name: Path(os.path.realpath(home / name)) for name in names}
        if far := [new for new, old in moves.items() if old.parent.stat().st_dev != home.stat().st_dev]:
            raise MeshFileError(f"{far[0]}: is a link to another file system; name the file itself")
        with written(folder):
            _put(moves, [folder / name for name in names], stale)


def _put(moves: Mapping[Path, Path], watched: Sequence[Path], stale: Sequence[str] = ()) -> None:
    """Put new files and folders in the places of old ones, once all are on the disk; OSError if that cannot be."""
    inside = {new: [path.relative_to(new) for path in _tree(new)] for new in moves}
    _prepare(moves, inside)
    with ExitStack() as noted:
        asides = {
            new: _aside(new, old, inside[new], stale, noted)
            for new, old in moves.items()
            if new.is_dir() and old.is_dir()
        }
        with _committing(watched), ExitStack() as tidying:
            for new, old in moves.items():
                if new not in asides:
                    new.replace(old)
                elif (aside := asides[new]) and _swapped(new, old, aside):
                    tidying.callback(_tidied, aside, old, inside[new], stale)
                else:
                    _one_by_one(new, old, inside[new], stale)
            for parent in {old.parent for old in moves.values()}:
                _flush(parent)


def _prepare(moves: Mapping[Path, Path], inside: Mapping[Path, Sequence[Path]]) -> None:
    """Give what is new the permissions of what it replaces, and bring it to the disk."""
    for new, old in moves.items():
        mode = _permitted.get() & (_permissions(old) if old.is_dir() else 0o7777)
        for path in (Path(), *inside[new]):
            if path.name and (old / path).is_dir() and not (new / path).is_dir():
                raise MeshFileError(f"{old / path}: is a folder; a file of that name is to be written")
            _permit(new / path, old / path, mode)
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(_flush, [new / path for new, own in inside.items() for path in (Path(), *own)]))


def _tree(folder: Path) -> list[Path]:
    """Return all that a folder holds, folders before what is in them; nothing for a file."""
    return [Path(place, name) for place, inner, files in os.walk(folder) for name in (*inner, *files)]


def _permit(new: Path, old: Path, mode: int) -> None:
    """Give what is new the permissions and owner of what it replaces; if that is nothing, its own within `mode`."""
    try:
        kept = old.stat()
    except (FileNotFoundError, NotADirectoryError):
        mode &= new.stat().st_mode
    else:
        mode = kept.st_mode
        try:
            os.chown(new, -1 if os.geteuid() else kept.st_uid, kept.st_gid)
        except OSError:  # a group that this user is not in
            mode &= 0o7707
    with suppress(OSError):  # file systems without permissions
        new.chmod(S_IMODE(mode))


def _aside(new: Path, old: Path, own: Sequence[Path], stale: Sequence[str], noted: ExitStack) -> Path | None:
    """Put the user's files of an old folder into the new one, too; return a registered name for the old one.

    None where it has to stay: another user's, one with folders of the user's, where a process works, or no hard links.
    """
    ours = {*own, *(Path(pattern).parent for pattern in stale)}
    folders = [path for path in _tree(old) if path.is_dir()]
    theirs = [path for path in folders if path.is_symlink() or path.relative_to(old) not in ours]
    if theirs or old.stat().st_uid != os.geteuid() or _is_worked_in(old):
        return None
    with suppress(OSError):
        for path in _others(old, own, stale):
            _made_like(old / path.parent, new / path.parent)
            os.link(old / path, new / path, follow_symlinks=False)
        aside = unused(old.parent)
        noted.enter_context(registered(aside, old.stat().st_ino, target=str(old), new=new.stat().st_ino))
        return aside
    return None


def _swapped(new: Path, old: Path, aside: Path) -> bool:
    """Put a new folder in the place of an old one, which goes aside; False if that is refused."""
    with suppress(OSError):
        old.rename(aside)
        with suppress(OSError):
            new.rename(old)
            return True
        aside.rename(old)
    return False


def _tidied(aside: Path, new: Path, own: Sequence[Path], stale: Sequence[str]) -> None:
    """Remove an old folder; what the user wrote there meanwhile goes to the new one."""
    for path in _others(aside, own, stale):
        (new / path.parent).mkdir(parents=True, exist_ok=True)
        (aside / path).replace(new / path)
    shutil.rmtree(aside, ignore_errors=True)


def _others(old: Path, own: Sequence[Path], stale: Sequence[str]) -> list[Path]:
    """Return the files of an old folder that are the user's: neither among the new ones nor stale."""
    files = {path.relative_to(old) for path in _tree(old) if path.is_symlink() or not path.is_dir()} - set(own)
    return [path for path in files if not any(fnmatchcase(path.as_posix(), pattern) for pattern in stale)]


def _one_by_one(new: Path, old: Path, own: Sequence[Path], stale: Sequence[str]) -> None:
    """Replace the files of a folder that stays; what is stale in it goes."""
    kept = {*own, *_others(old, own, stale)}
    for path in own:
        if (new / path).is_dir():
            _made_like(new / path, old / path)
        else:
            (new / path).replace(old / path)
    for path in _tree(old):
        if path.relative_to(old) not in kept and not path.is_dir():
            path.unlink()
            with suppress(OSError):
                path.parent.rmdir()


def _made_like(folder: Path, other: Path) -> None:
    """Make another folder, if it is not there, with the permissions of a folder."""
    if not other.exists():
        other.mkdir()
        shutil.copymode(folder, other)


@contextmanager
def _committing(targets: Sequence[Path]) -> Iterator[None]:
    """Hold the signals that end a process until `targets` are replaced, and tell `watchers`."""
    came: list[int] = []
    kept: dict[int, Any] = {}
    try:
        if threading.current_thread() is threading.main_thread():
            for held in HELD:
                if signal.getsignal(held) not in (signal.SIG_IGN, None):
                    kept[held] = signal.signal(held, lambda given, _: came.append(given))
        for watch, target in product(watchers, targets):
            watch(target, False)
        yield
        for watch, target in product(watchers, targets):
            watch(target, True)
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
        for number in came:
            signal.raise_signal(number)


def _is_mounted(folder: Path) -> bool:
    """Whether a folder is where something is mounted."""
    try:
        lines = Path("/proc/self/mountinfo").read_text(errors="replace").splitlines()
    except OSError:
        return folder.is_mount()
    return any(line.split()[4] == str(folder) for line in lines)


def _is_worked_in(folder: Path) -> bool:
    """Whether a folder, or one in it, is the working folder of a process."""
    for work in (Path("/proc/self/cwd"), *Path("/proc").glob("[0-9]*/cwd")):
        with suppress(OSError):
            if work.readlink().is_relative_to(folder):
                return True
    return False


def _flush(path: Path) -> None:
    """Bring a file or a folder to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def written(out: Path) -> Iterator[None]:
    """Name `out` in errors of writing it.

    WriteError in place of an OSError, as ``"out: cannot be written: why"``.
    """
    try:
        yield
    except OSError as error:
        raise WriteError(f"{out}: cannot be written: {error.strerror or error}") from error


@contextmanager
def renamed(beside: Path, out: Path) -> Iterator[None]:
    """Name `out` in errors of what is written for it at `beside`."""
    try:
        yield
    except MeshFileError as error:
        raise MeshFileError(str(error).replace(str(beside), str(out))) from error


def copied(source: Path, into: Path, without: tuple[str, ...]) -> None:
    """Copy all that a folder holds but names of the patterns `without`.

    Links become what they point to, so that a later change of the copy cannot reach the source.
    """
    with about(source):
        for name, folders, files in os.walk(source, onerror=_raised, followlinks=True):
            folders[:] = [folder for folder in folders if not any(fnmatchcase(folder, pattern) for pattern in without)]
            here = into / Path(name).relative_to(source)
            here.mkdir(exist_ok=True)
            here.chmod(here.stat().st_mode & _permissions(Path(name)))
            for path in (Path(name, file) for file in files):
                if path.exists():
                    shutil.copy2(path, here)


def _raised(error: OSError) -> None:
    raise error
