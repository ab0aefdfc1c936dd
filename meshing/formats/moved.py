"""Numbers replaced where they stand in a file."""

from __future__ import annotations

import numpy as np

from sdm_deflect.meshing.mesh import FloatArray, IntArray


def with_numbers(data: bytes, begin: IntArray, end: IntArray, values: FloatArray) -> bytes:
    """Return text with other numbers in the bytes begin[i] to end[i] - 1, each with as many digits as it needs.

    Parameters
    ----------
    data
        The text.
    begin, end
        (K,) places of the numbers, in rising order.
    values
        (K,) what to write there.
    """
    if not len(values):
        return data
    first, last = begin.tolist(), end.tolist()
    pieces = [b""] * (2 * len(first) + 1)
    pieces[0::2] = [data[a:b] for a, b in zip([0, *last], [*first, len(data)], strict=True)]
    pieces[1::2] = [repr(value).encode() for value in values.tolist()]
    return b"".join(pieces)


def with_bytes(data: bytes, begin: IntArray, values: FloatArray, kind: np.dtype[np.generic]) -> bytes:
    """Return binary data with `values` (K,) as numbers of type `kind` from the bytes begin[i] on."""
    changed = np.frombuffer(data, dtype=np.uint8).copy()
    raw = np.ascontiguousarray(values, dtype=kind).view(np.uint8).reshape(len(values), kind.itemsize)
    for column in range(kind.itemsize):
        changed[begin + column] = raw[:, column]
    return changed.tobytes()
