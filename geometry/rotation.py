"""Rigid rotation about an axis in space."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

FloatArray = NDArray[np.float64]


def rotated(points: FloatArray, axis: FloatArray, degrees: float) -> FloatArray:
    """Points (..., 3) turned right-handed about the line from `axis[0]` to `axis[1]`, (2, 3)."""
    direction = axis[1] - axis[0]
    turn = Rotation.from_rotvec(np.radians(degrees) * direction / np.linalg.norm(direction)).as_matrix()
    return np.asarray((points - axis[0]) @ turn.T + axis[0], dtype=np.float64)
