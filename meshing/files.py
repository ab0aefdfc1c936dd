"""Files and folders that appear whole or not at all."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path

from sdm_deflect.meshing.formats.format import MeshFileError, about


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a path beside `path` to write to, and rename it to `path` once the block has ended well.

    The temporary file keeps the suffix, because writers choose their format by it; after an error or an
    interruption it is removed and `path` is as it was.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(suffix=path.suffix, prefix=f".{path.stem}-", dir=path.parent)
    os.close(handle)
    beside = Path(name)
    try:
        yield beside
        beside.chmod(0o666 & ~_umask())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextmanager
def fresh(out: Path, source: Path | None = None) -> Iterator[Path]:
    """Give a path to write to that becomes `out` once the block has ended well.

    MeshFileError if `out` is the file `source`, or cannot be written.
    """
    if source is not None and out.exists() and out.samefile(source):
        raise MeshFileError(f"{out}: this is the mesh that is read; write to another file")
    with written(out), replacing(out) as beside:
        yield beside


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
def fresh_folder(out: Path, source: Path | None = None) -> Iterator[Path]:
    """Give an empty folder beside `out` that becomes `out` once the block has ended well.

    MeshFileError if `out` is there and not empty, lies within the folder `source`, or cannot be made.
    """
    if source is not None and out.resolve().is_relative_to(source.resolve()):
        raise MeshFileError(f"{out}: lies in the case that is read; write to a folder outside it")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise MeshFileError(f"{out}: exists already; name a new folder, or delete that one")
    with written(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as name:
            beside = Path(name, "new")
            beside.mkdir()
            with renamed(beside, out):
                yield beside
            if out.exists():
                out.rmdir()
            beside.rename(out)


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
