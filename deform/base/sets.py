"""Sorted sets of whole numbers.

NumPy's `unique` and `union1d` put numbers into a hash table (since 2.3), which takes forty times as long as to sort
them (3 million node indices: 6.1 s and .15 s), so neither is used for many of them.
"""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Number = TypeVar("Number", bound=np.generic)


def distinct(values: NDArray[Number]) -> NDArray[Number]:
    """Return the distinct ones of numbers of any shape, sorted, (K,)."""
    found = np.sort(values, axis=None)
    return found[np.append(True, found[1:] != found[:-1])] if len(found) else found


def counted(values: NDArray[Number]) -> tuple[NDArray[Number], NDArray[np.intp]]:
    """Return the distinct ones of numbers (N,), sorted, and how often each occurs, (K,); `values` is sorted, too."""
    values.sort()
    first = np.flatnonzero(np.append(True, values[1:] != values[:-1])[: len(values)])
    return values[first], np.diff(first, append=len(values))


def union(*parts: NDArray[Any]) -> NDArray[np.intp]:
    """Return all indices in any of the parts, each once, sorted, (K,)."""
    return distinct(np.concatenate([np.empty(0, dtype=np.intp), *(part.ravel() for part in parts)]))
