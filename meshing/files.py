"""Files and folders that appear whole or not at all.

Everything is written into a temporary folder beside its target, flushed to the disk, then renamed. A folder that is
there already changes places with the new one in one step; where the system cannot do that, and for several targets,
a journal lists the renames, and whoever next looks into the folder finishes them.
"""

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from errno import ENOTDIR
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from sdm_deflect.meshing.formats.format import MeshFileError, about
from sdm_deflect.meshing.replacement import Move, commit, committing, flush, is_mounted, moved_folder
from sdm_deflect.meshing.temporary import is_temporary, settle, staging


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
        flush(beside)
        with held(path):
            beside.replace(target)
        flush(target.parent)


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
        if is_temporary(out):
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
    if target.exists() and not target.is_dir():
        raise NotADirectoryError(ENOTDIR, os.strerror(ENOTDIR), str(out))
    target.parent.mkdir(parents=True, exist_ok=True)
    settle(target)
    inside = target.is_dir() and (is_mounted(target) or not os.access(target.parent, os.W_OK))
    with staging(target if inside else target.parent) as folder:
        beside = folder / target.name
        beside.mkdir()
        with renamed(beside, out):
            yield beside
            with written(out):
                commit(folder, [moved_folder(beside, target, stale)], [out])


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
                moves = [moved_folder(new, old, stale) if new.is_dir() else Move(new, old) for new, old in pairs]
                commit(temporary, moves, [folder / name for name in names])


@contextmanager
def _quietly(_: Path) -> Iterator[None]:
    yield


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
