"""Folders that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path

from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.guard import about, written


@contextmanager
def fresh_folder(out: Path, source: Path | None = None) -> Iterator[Path]:
    """Give an empty folder beside `out` that becomes `out` once the block has ended well.

    Raises
    ------
    MeshFileError
        If `out` is there and not empty, lies within the folder `source`, or cannot be made.
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
            yield beside
            if out.exists():
                out.rmdir()
            beside.rename(out)


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
