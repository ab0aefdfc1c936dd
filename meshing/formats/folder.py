"""Folders that appear whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sdm_deflect.meshing.formats.format import MeshFileError


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
    try:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise MeshFileError(f"{out}: exists already; name a new folder, or delete that one")
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as name:
            beside = Path(name, "new")
            beside.mkdir()
            yield beside
            if out.exists():
                out.rmdir()
            beside.rename(out)
    except OSError as error:
        raise MeshFileError(f"{out}: cannot be written: {error.strerror or error}") from error


def copied(source: Path, into: Path, without: tuple[str, ...]) -> None:
    """Copy all that a folder holds but names of the patterns `without`.

    Links become what they point to, so that a later change of the copy cannot reach the source.
    """
    ignored = shutil.ignore_patterns(*without)
    try:
        shutil.copytree(source, into, dirs_exist_ok=True, ignore=ignored, ignore_dangling_symlinks=True)
    except shutil.Error as error:
        raise MeshFileError(f"{source}: {error.args[0][0][2]}") from error
