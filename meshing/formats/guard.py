"""Errors that name the file, and files that appear whole or not at all."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.meshing.files import replacing
from sdm_deflect.meshing.formats.faces import loose_faces
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.mesh import FloatArray

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of writing alone: no space, a quota, a limit of the size."""


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Name the file in every error that its content causes in the block.

    Raises
    ------
    MeshFileError
        In place of a MeshFileError, a ValueError or an OSError, as ``"file: what is wrong"``; an OSError of a full
        disk passes, because it is of another file.
    """
    try:
        yield
    except OSError as error:
        if error.errno in FULL:
            raise
        raise MeshFileError(f"{path}: {error.strerror or error}") from error
    except (MeshFileError, ValueError) as error:
        raise MeshFileError(f"{path}: {error}") from error


@contextmanager
def fresh(out: Path, source: Path | None = None) -> Iterator[Path]:
    """Give a path to write to that becomes `out` once the block has ended well.

    Raises
    ------
    MeshFileError
        If `out` is the file `source`, or cannot be written.
    """
    if source is not None and out.exists() and out.samefile(source):
        raise MeshFileError(f"{out}: this is the mesh that is read; write to another file")
    with written(out), replacing(out) as beside:
        yield beside


@contextmanager
def written(out: Path) -> Iterator[None]:
    """Name `out` in errors of writing it.

    Raises
    ------
    MeshFileError
        In place of an OSError, as ``"out: cannot be written: why"``.
    """
    try:
        yield
    except OSError as error:
        raise MeshFileError(f"{out}: cannot be written: {error.strerror or error}") from error


def check_points(points: FloatArray, count: int) -> None:
    """Refuse coordinates that do not fit a file of `count` points.

    Raises
    ------
    ValueError
        For another number of points, or coordinates that are not finite.
    """
    if points.shape != (count, 3):
        raise ValueError(f"the file has {count} points, but coordinates {points.shape} were given")
    bad = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
    if bad:
        raise ValueError(f"{bad} of the {count} points to write are not finite")


def check_faces(mesh: Mesh) -> None:
    """Refuse boundary faces that are of no cell.

    Raises
    ------
    MeshFileError
        Naming the patches and how many of their faces are of no cell.
    """
    if not sum(len(block) for block in mesh.cells):
        raise MeshFileError("there are no volume cells")
    loose = loose_faces(mesh)
    if loose:
        counts = (f"{count} of {len(mesh.patch(name))} faces of patch {name}" for name, count in loose.items())
        raise MeshFileError(f"{', '.join(counts)} are of no cell")
