"""Errors that name the file, and what else the formats share."""

import re
from collections.abc import Container, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import FULL, MeshFileError, WriteError
from sdm_deflect.deform.mesh.precision import DOUBLE

FLUENT = (
    "write it as .cas.h5 or .msh.h5 in Fluent, or convert it, as text, to an OpenFOAM case: fluentMeshToFoam "
    "(fluent3DMeshToFoam for hanging nodes)"
)
"""What to do with Fluent's older files."""


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Name the file in every error that its content causes in the block.

    Raises MeshFileError: in place of a MeshFileError, a ValueError, a MemoryError or an OSError, as ``"file: what is
    wrong"``; a WriteError and an OSError of a full disk pass, because they are of another file.
    """
    try:
        yield
    except OSError as error:
        if error.errno in FULL:
            raise
        raise MeshFileError(f"{path}: {error.strerror or error}") from error
    except WriteError:
        raise
    except MemoryError as error:
        raise MeshFileError(f"{path}: its data need more memory than there is") from error
    except (MeshFileError, ValueError) as error:
        raise MeshFileError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error


def fitting_names(names: Sequence[str], unfit: str, reserved: Container[str] = ()) -> dict[str, str]:
    """Name of each patch in a file: its own where nothing in it matches `unfit`, else one that is not taken."""
    fitted: dict[str, str] = {}
    for name in names:
        fitting = re.sub(unfit, "_", name) or "_"
        while fitting in reserved or (fitting != name and (fitting in names or fitting in fitted.values())):
            fitting += "_"
        fitted[name] = fitting
    return fitted


def fewest_bits(kinds: Iterable[np.dtype[Any]]) -> np.dtype[Any]:
    """Return the real type with the fewest bits, in the machine's byte order; double if `kinds` is empty."""
    return min((*(kind.newbyteorder("=") for kind in kinds), DOUBLE), key=lambda kind: kind.itemsize)


def check_points(points: FloatArray, count: int) -> None:
    """Raise ValueError unless there are `count` points with finite coordinates."""
    if points.shape != (count, 3):
        raise ValueError(f"the file has {count} points, but coordinates {points.shape} were given")
    if bad := np.count_nonzero(~np.isfinite(points).all(axis=1)):
        raise ValueError(f"{bad} of the {count} points to write are not finite")


def only_rewritten(out: Path) -> MeshFileError:
    """Return the error of converting a mesh to a format whose files can only be rewritten."""
    return MeshFileError(f"{out}: only a mesh of this format can be written in it; name another one, such as .cgns")
