"""Fields in the time folders of a case: read, and given to another case as its start."""

import re
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.meshing.formats.openfoam import CLASSES, header

# What a compressible flow starts from.
STARTED = ("U", "p", "T")
UNIFORM = re.compile(rb"internalField\s+uniform\s+\(?([^;()]*)\)?\s*;")
LISTED = re.compile(rb"internalField\s+nonuniform\s+List<(scalar|vector)>\s*(\d+)\s*\(")


def iterations_done(case: Path) -> int:
    """Return the largest number of iterations of which a case holds fields; 0 if it has not begun."""
    return max((int(path.name) for path in case.iterdir() if path.is_dir() and path.name.isdigit()), default=0)


def read_field(path: Path, cells: int) -> FloatArray:
    """Return the values (M,) or (M, 3) of a field in the cells, as the solver writes it: binary, or uniform.

    Raises InputError if the file is missing or damaged, or has values of another number of cells.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    if uniform := UNIFORM.search(data):
        value = np.array([float(word) for word in uniform[1].split()])
        return np.full(cells, value[0]) if len(value) == 1 else np.tile(value, (cells, 1))
    listed = LISTED.search(data)
    if listed and int(listed[2]) == cells:
        shape = (cells, 3) if listed[1] == b"vector" else (cells,)
        count = int(np.prod(shape))
        if len(data) > listed.end() + 8 * count:
            return np.frombuffer(data, "<f8", count, listed.end()).astype(np.float64).reshape(shape)
    raise InputError(f"{path}: should have the values of {cells} cells; it is damaged, or of another mesh")


def start_from(case: Path, centres: FloatArray, other: Path, others: FloatArray) -> None:
    """Let a case start from where another one ended: each cell from that with the nearest centre; patches stay.

    Parameters
    ----------
    case, other : the case that is to start, and the one that has ended.
    centres, others : (M, 3) and (K, 3), of their cells.

    Raises InputError if the other one's fields cannot be read.
    """
    done = iterations_done(other)
    _, nearest = KDTree(others).query(centres)
    for name in STARTED:
        values = read_field(other / str(done) / name, len(others))[nearest]
        path = case / "0" / name
        text = path.read_bytes()
        text = text[text.index(b"dimensions") :]
        begin, end = text.index(b"internalField"), text.index(b"boundaryField")
        what = "vector" if values.ndim > 1 else "scalar"
        listed = f"internalField nonuniform List<{what}> {len(values)}\n(".encode()
        numbers = np.ascontiguousarray(values, "<f8").tobytes()
        start = header(CLASSES[name], name, "0", form="binary").encode()
        path.write_bytes(start + text[:begin] + listed + numbers + b");\n" + text[end:])
