"""Polyhedra as lists of planar polygons, corner by corner: no lofts, no booleans on thin parts."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Loops = tuple[FloatArray, ...]


def prism(first: FloatArray, last: FloatArray) -> Loops:
    """Faces between two rings of corners (n, 3) of equal length, with both ends closed."""
    following = np.roll(np.arange(len(first)), -1)
    strips = [np.array([first[i], first[j], last[j], last[i]]) for i, j in enumerate(following.tolist())]
    return (first[::-1], last, *strips)
