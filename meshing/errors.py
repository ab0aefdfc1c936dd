"""Errors that name the mesh file in which something is wrong."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import FULL, MeshFileError, WriteError

# What to do with Fluent's older files.
FLUENT = (
    "write it as .cas.h5 or .msh.h5 in Fluent, or convert it, as text, to an OpenFOAM case: fluentMeshToFoam "
    "(fluent3DMeshToFoam for hanging nodes)"
)


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Put the file's name before every error that its content causes in the block.

    Raises MeshFileError: in place of a MeshFileError, a ValueError, a MemoryError or an OSError, as ``"file: what is
    wrong"``. A WriteError and an OSError of a full disk pass unchanged: they concern another file.
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


def check_points(points: FloatArray, count: int) -> None:
    """Raise ValueError unless there are `count` points with finite coordinates."""
    if points.shape != (count, 3):
        raise ValueError(f"the file has {count} points, but coordinates {points.shape} were given")
    if bad := np.count_nonzero(~np.isfinite(points).all(axis=1)):
        raise ValueError(f"{bad} of the {count} points to write are not finite")


def only_rewritten(out: Path) -> MeshFileError:
    """Return the error for writing a mesh from elsewhere in a format whose files can only be rewritten."""
    return MeshFileError(f"{out}: only a mesh of this format can be written in it; name another one, such as .cgns")
