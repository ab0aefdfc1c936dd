"""Packed coordinates replaced by HDF5 in a process of its own: it may crash as it closes a damaged file.

That process loads this file alone, and little else.
"""

from pathlib import Path

import h5py
import numpy as np

from sdm_deflect.meshing.errors import MeshingError
from sdm_deflect.meshing.files.child import Arrays, call, serve
from sdm_deflect.meshing.formats.format import MeshFileError

SECONDS = 3600.0


def overwrite(path: Path, values: Arrays) -> None:
    """Replace the values (N,) of datasets by name in a file, packed as they were.

    MeshFileError if HDF5 cannot do it, or crashes.
    """
    try:
        call(__name__, {"path": np.array(str(path)), **values}, SECONDS)
    except MeshingError as error:
        raise MeshFileError(f"its packed coordinates cannot be replaced ({error})") from error


def _work(question: Arrays) -> Arrays:
    with h5py.File(str(question["path"]), "r+") as file:
        for name in question.keys() - {"path"}:
            file[name][...] = question[name]
    return {}


if __name__ == "__main__":
    serve(_work)
